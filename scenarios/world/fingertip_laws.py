"""The compiled part of the fingertip: vibration of the pads, springs with friction bristles under
rough contact, and codes.

Numba's cache does not detect changes in an imported kernel, so all kernels are in this file, which
imports none. Lengths in millimetres, forces in newtons, in the pad's frame (x along the columns, y
across the rows).

Spring j is at r_j; springs near the centre come first. In contact its tip sticks to the surface by
a bristle (deflection b_j), so it touches the surface point q = R(-turn) (r_j + b_j - pose), whose
height determines its depth. The common approach of the pad is the one at which all springs carry
the given load.
A bristle follows the surface until its traction exceeds the friction of its spring's load; then it
slides (return mapping; statically 1-D: Jenkins element). Prony terms relax both loads:
f = k (d - sum phi_i rho_i), rho_i' = (d - rho_i) / tau_i.

The pad is carried by a mount. Along the normal it is a spring (stiffness 0: the load is an input).
Friction Q on the pad's face acts on the mount's joint through a lever, which loads or unloads it
(as a leading or trailing shoe of a drum brake). Laterally the mount is a damped spring with a mass.
docs/simulation.md has the equations.

For speed each property of the springs is one contiguous row, and loops over all springs have no
branch, so that LLVM vectorises them.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.numba_cache import compiled

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Codes = NDArray[np.int16]
Indices = NDArray[np.int64]
Rests = NDArray[np.int64]

# Layout of the parameter vector, common to all pads.
(
    K_NORMAL, K_SHEAR, STEP_MM, STEP_S, NORMAL_PEAK, NORMAL_WIDTH, SHEAR_PEAK, SHEAR_WIDTH,
    LEVER_X, LEVER_Y, LATERAL_NPMM, LATERAL_RADPS, LATERAL_DAMPING, HALF_X, HALF_Y, WIDEST,
    WANDER_MM, FAST_S, SLOW_S, MODE_MM, MODE_RADPS, MODE_DAMPING, SWAY_MM, SHIFT_MM, ROCK_RAD,
    JITTER_S, HELD_RADPS, HELD_DAMPING, NOISE_COUNTS, CODE_MAX, FOLD, RELAXATION,
) = range(32)  # fmt: skip
TERMS = 3  # of the relaxation: shares from RELAXATION on, then time constants
RELAXATION_TIME = RELAXATION + TERMS
PARAMETERS = RELAXATION_TIME + TERMS
# Layout of each pad's constants. SHAKING: unit vector along which the arm's mode sways the pad.
# SIDE: side of the held object, +1 or -1.
(
    CURVATURE_X, CURVATURE_Y, MU_STATIC, MU_KINETIC, FIELD_STEP, FIELD_PEAK, SHAKING_X, SHAKING_Y,
    SIDE,
) = range(9)  # fmt: skip
# Layout of each pad's state. TOTAL to CENTRE_Y: inputs at the end of the last step, vibration
# included. SLID: accumulated sliding. TOUCHED: number of springs after which none has touched.
# LOADED, HELD: numbers of springs in the two rows of ``contacts``. A pad that loses contact clears
# all from CARRIED on.
(
    POSE_X, POSE_Y, POSE_TURN, APPROACH, SLIP_X, SLIP_Y, SPIN, SHARE, SLID_X, SLID_Y, SLID_TURN,
    TOTAL, MOTION_X, MOTION_Y, TURN, CENTRE_X, CENTRE_Y, STIFFNESS, CARRIED, PULL_X, PULL_Y,
    AWAY_X, AWAY_Y, AWAY_SPEED_X, AWAY_SPEED_Y, TOUCHED, LOADED, HELD,
) = range(28)  # fmt: skip
STATE = 28
# Layout of each spring's state. RELAXED: relaxed parts of the depth, then of the bristle. DEPTH is
# that under the last load.
DEPTH, BRISTLE_X, BRISTLE_Y, LOAD, SLIDES, TRACTION_X, TRACTION_Y, RELAXED = range(8)
RELAXED_X, RELAXED_Y = RELAXED + TERMS, RELAXED + 2 * TERMS
SPRING = RELAXED + 3 * TERMS
# Layout of the vibration of one pad, or of the hand that holds an object: fast and slow wander,
# each with the process that drives it; the arm's mode; pairs of JITTERS; and for each direction of
# the hand's motion (normal, x, y, tilt along x, tilt along y) the positions of hand and held object
# and the object's speed.
JITTERS, DIRECTIONS = 4, 5  # jitters: shift along x and y, tilt along x and y
FAST, FAST_DRIVE, SLOW, SLOW_DRIVE, MODE_COS, MODE_SIN, JITTER = range(7)
FOLLOWING = JITTER + 2 * JITTERS
HAND, OBJECT, SPEED = range(3)
VIBRATION = FOLLOWING + 3 * DIRECTIONS
# Inputs of a step with vibration: load, motion and tilt of the pad; scratch rows of ``find_near``.
LOAD_N, MOVE_X, MOVE_Y, ROCK_X, ROCK_Y = range(5)
BELOW, FIELD_U, FIELD_V, REACH = range(4)
NEAR, CELL_U, CELL_V = range(3)

NEWTON_STEPS = 60
SAME_MM = 1e-9
NEGLIGIBLE = -12.0  # exponent of a kernel: below 0.01 counts/N
EXP_MINUS_6 = math.exp(-6.0)
NARROW_MM2 = 0.25  # a load within half a millimetre of its centre has no measurable rotation
CLEAR_MM = 0.1  # springs farther than this from the surface are skipped
FAR = -1e6  # depth of such a spring
MODE_STEP_S = 0.002  # longest inner step of a swaying mount: a fiftieth of its period
STABLE = 1.5  # phase per step, rad; symplectic Euler is stable below 2
OUT_OF_REACH_MM = 5.0  # a pad this far from the surface has no contact


# For functions that only compiled code calls: wrappers for Python and C would take long to compile.
inner = njit(  # type: ignore[call-overload]
    error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
)


@compiled()
def advance(
    p: Floats, dt_s: float, arm_moves: bool, row: int, normals: Floats, jitter_normals: Floats,
    normal_n: Floats, motion: Floats, turn: Floats, centre: Floats, mounts: Floats,
    pads: Floats, fields: Singles, at: Floats, gaps: Floats, taxels: Floats, rest: Rests,
    warm: float, vibration: Floats, states: Floats, springs: Floats, contacts: Indices,
    codes: Codes,
) -> None:  # fmt: skip
    """Advance all pads by dt_s > 0 and write their codes (F, taxels).

    All inputs change linearly from those of the last step: load normal_n (F,), motion (F, 2) and
    turn (F,) of the surface, and its centre (F, 2). Where mounts (F,) is above 0 it is the
    stiffness of the pad's spring, N/mm, and normal_n is its load at approach 0.

    normals, jitter_normals: standard normal numbers, of which ``row`` is used for ``vibrate`` and,
    in normals, for the noise of the codes. gaps (F, 2, S): gap by pad shape and tilt at each spring
    at (2, S), and its minimum over all later springs. warm: counts added by temperature. contacts
    (F, 2, S): springs that carry load, and springs whose bristle holds the surface.
    """
    n = states.shape[0]
    scene = np.empty((n, 5))
    vibrate(p, dt_s, arm_moves, normals[row], jitter_normals[row], vibration)
    if p[HELD_RADPS] > 0.0:
        shake_held(p, dt_s, normal_n, motion, pads, states, vibration[0], scene)
    else:
        shake(p, normal_n, motion, mounts, pads, states, vibration, scene)
    work, cells = np.empty((6, at.shape[1])), np.empty((3, at.shape[1]), np.int64)
    noise = normals[row, 4 * vibration.shape[0] + 2 :]
    for f in range(n):
        advance_pad(
            p, dt_s, scene[f], turn[f], centre[f], mounts[f], pads[f], fields[f], at, gaps[f],
            states[f], springs[f], contacts[f], work, cells,
        )  # fmt: skip
        read(
            p, states[f], springs[f], contacts[f], at, taxels, rest[f], warm,
            noise[f * codes.shape[1] :], work, codes[f],
        )  # fmt: skip


# The bed of springs


@inner
def advance_pad(
    p: Floats, dt_s: float, scene: Floats, turn: float, centre: Floats, mount: float, pad: Floats,
    field: Singles, at: Floats, gap: Floats, s: Floats, springs: Floats, contacts: Indices,
    work: Floats, cells: Indices,
) -> None:  # fmt: skip
    """Advance one pad by dt_s > 0 to the inputs of ``scene``, turn and centre (2,)."""
    total0, total1 = s[TOTAL], scene[LOAD_N]
    motion_x, motion_y = scene[MOVE_X] - s[MOTION_X], scene[MOVE_Y] - s[MOTION_Y]
    turned = turn - s[TURN]
    centre0_x, centre0_y = s[CENTRE_X], s[CENTRE_Y]
    s[TOTAL], s[MOTION_X], s[MOTION_Y] = total1, scene[MOVE_X], scene[MOVE_Y]
    s[TURN], s[CENTRE_X], s[CENTRE_Y] = turn, centre[0], centre[1]
    away = -OUT_OF_REACH_MM * mount
    if total0 <= away and total1 <= away:
        shift_origin(s, motion_x, motion_y, turned)
        s[SLIP_X] = s[SLIP_Y] = s[SPIN] = s[SHARE] = 0.0
        clear_contact(s, springs)
        return
    path = math.hypot(motion_x, motion_y) + abs(turned) * p[WIDEST]
    steps = inner_steps(p, path, dt_s, s[STIFFNESS])
    h = 1.0 / steps
    turned *= h
    keep, sums = np.empty(TERMS), np.zeros(5)
    for i in range(TERMS):
        keep[i] = math.exp(-dt_s * h / p[RELAXATION_TIME + i])
    for i in range(steps):
        end = (i + 1.0) * h
        away_x, away_y = sway_mount(p, s, dt_s * h)
        dx, dy = motion_x * h - away_x, motion_y * h - away_y
        centre_x = centre0_x + (centre[0] - centre0_x) * end - s[AWAY_X]
        centre_y = centre0_y + (centre[1] - centre0_y) * end - s[AWAY_Y]
        shift_origin(s, dx, dy, turned)
        sums[0] = 0.0
        drag(p, pad, at, dx, dy, turned, keep, springs, contacts, s, sums)
        total = total0 + (total1 - total0) * end
        if mount > 0.0:
            total -= p[LEVER_X] * s[PULL_X] + p[LEVER_Y] * s[PULL_Y]
        elif total <= 0.0:
            clear_contact(s, springs)
            continue
        level = -math.inf
        while s[APPROACH] > level:  # springs skipped at a smaller approach may touch as well
            level = s[APPROACH] + CLEAR_MM
            n = find_near(
                p, s, pad, centre_x, centre_y, scene, field, at, gap, level, springs, work, cells
            )
            press(p, s, cells[NEAR, :n], work[REACH, :n], total, mount, springs, contacts)
        sums[4] = min(1.0, sums[0] / s[CARRIED]) if s[CARRIED] > 0.0 else 0.0
    fit_sliding(at, springs, contacts, sums, dt_s, s)


@inner
def find_near(
    p: Floats, s: Floats, pad: Floats, centre_x: float, centre_y: float, scene: Floats,
    field: Singles, at: Floats, gap: Floats, level: float, springs: Floats, work: Floats,
    cells: Indices,
) -> int:  # fmt: skip
    """Number of springs that touch at the approach ``level``: their indices into cells[NEAR], their
    depths at approach zero minus relaxation into work[REACH]. Heights of the surface are bilinear
    between the points of the periodic field."""
    cos, sin = math.cos(s[POSE_TURN]), math.sin(s[POSE_TURN])
    kx, ky = 0.5 * pad[CURVATURE_X], 0.5 * pad[CURVATURE_Y]
    tilt_x, tilt_y, pose_x, pose_y = scene[ROCK_X], scene[ROCK_Y], s[POSE_X], s[POSE_Y]
    per_step, highest = 1.0 / pad[FIELD_STEP], level + pad[FIELD_PEAK]
    n = within_reach(gap[1], highest + abs(tilt_x) * p[HALF_X] + abs(tilt_y) * p[HALF_Y])
    at_x, at_y, bristle_x, bristle_y = at[0], at[1], springs[BRISTLE_X], springs[BRISTLE_Y]
    rest, fast, slow, slowest = gap[0], springs[RELAXED], springs[RELAXED + 1], springs[RELAXED + 2]
    part, slow_part, slowest_part = p[RELAXATION], p[RELAXATION + 1], p[RELAXATION + 2]
    below, us, vs = work[BELOW], work[FIELD_U], work[FIELD_V]
    for j in range(n):
        wx, wy = at_x[j] + bristle_x[j] - centre_x, at_y[j] + bristle_y[j] - centre_y
        u, v = cos * wx + sin * wy, cos * wy - sin * wx
        under = rest[j] + tilt_x * at_x[j] + tilt_y * at_y[j] + (kx * u * u + ky * v * v)
        below[j] = under + part * fast[j] + slow_part * slow[j] + slowest_part * slowest[j]
    while n > 0 and highest < below[n - 1]:
        n -= 1
    for j in range(n):
        dx, dy = at_x[j] + bristle_x[j] - pose_x, at_y[j] + bristle_y[j] - pose_y
        us[j] = (cos * dx + sin * dy) * per_step
    for j in range(n):
        dx, dy = at_x[j] + bristle_x[j] - pose_x, at_y[j] + bristle_y[j] - pose_y
        vs[j] = (cos * dy - sin * dx) * per_step
    split_cells(us, n, cells[CELL_U])
    split_cells(vs, n, cells[CELL_V])
    near, reach, cell_u, cell_v = cells[NEAR], work[REACH], cells[CELL_U], cells[CELL_V]
    mask = field.shape[0] - 1  # a power of two
    for j in range(n):
        i0, j0, a, b = cell_u[j] & mask, cell_v[j] & mask, us[j], vs[j]
        i1, j1 = (i0 + 1) & mask, (j0 + 1) & mask
        low = field[i0, j0] + a * (field[i1, j0] - field[i0, j0])
        high = field[i0, j1] + a * (field[i1, j1] - field[i0, j1])
        below[j] = low + b * (high - low) - below[j]
    count = 0
    for j in range(n):
        near[count], reach[count] = j, below[j]
        count += below[j] + level > 0.0
    return count


@inner
def within_reach(least_gap: Floats, reach_mm: float) -> int:
    """Number of springs before the first whose least gap exceeds reach_mm, by bisection."""
    low, high = 0, least_gap.shape[0]
    while low < high:
        middle = (low + high) // 2
        if least_gap[middle] > reach_mm:
            high = middle
        else:
            low = middle + 1
    return low


@inner
def split_cells(at: Floats, n: int, cells: Indices) -> None:
    """Split the first n grid coordinates into the cell and the fraction within it."""
    for j in range(n):
        whole = math.floor(at[j])
        cells[j] = int(whole)
        at[j] -= whole


@inner
def solve_approach(reach: Floats, total_mm: float, mount: float, start: float, n: int) -> float:
    """Approach a at which the positive depths reach + a, plus mount * a, sum to total_mm.

    mount is the mount's stiffness over that of a spring; 0: the load is an input, above 0. n is the
    number of all springs; those not in reach do not touch. The sum is piecewise linear and convex,
    so Newton steps from the right are exact.
    """
    approach = start
    for k in range(NEWTON_STEPS):
        total = mount * approach
        slope = mount
        for j in range(reach.shape[0]):
            d = approach + reach[j]
            if d > 0.0:
                total += d
                slope += 1.0
        if slope == 0.0 or (k == NEWTON_STEPS // 2 and mount == 0.0):
            lowest = FAR if reach.shape[0] < n else 0.0
            for j in range(reach.shape[0]):
                lowest = min(lowest, reach[j])
            approach = total_mm / n - lowest  # all springs touch: never too shallow
            continue
        change = (total - total_mm) / slope
        approach -= change
        if abs(change) < SAME_MM:
            break
    return approach


@inner
def press(
    p: Floats, s: Floats, near: Indices, reach: Floats, total_n: float, mount: float,
    springs: Floats, contacts: Indices,
) -> None:  # fmt: skip
    """Distribute the load over the springs near the surface; total_n is the load with a mount at
    approach zero."""
    k = p[K_NORMAL]
    approach = solve_approach(reach, total_n / k, mount / k, s[APPROACH], springs.shape[1])
    stiffness, carried, count = 0.0, 0.0, 0
    for j in range(int(s[TOUCHED])):
        springs[LOAD, j] = 0.0
    for i in range(reach.shape[0]):
        j, d = near[i], approach + reach[i]
        if d <= 0.0:
            continue
        load = k * d
        springs[LOAD, j] = load
        for term in range(TERMS):
            d += p[RELAXATION + term] * springs[RELAXED + term, j]
        springs[DEPTH, j] = d
        stiffness += k
        carried += load
        contacts[0, count] = j
        count += 1
    s[APPROACH], s[STIFFNESS], s[CARRIED], s[LOADED] = approach, stiffness, carried, count
    if count > 0:
        s[TOUCHED] = max(s[TOUCHED], contacts[0, count - 1] + 1)


@inner
def drag(
    p: Floats, pad: Floats, at: Floats, dx: float, dy: float, turn: float, keep: Floats,
    springs: Floats, contacts: Indices, s: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Move the bristles with the surface, which moves by (dx, dy) and turns; those beyond their
    friction limit slide. Adds to sums (5,): sliding load, slip x and y, and moment of slip about
    the pad's centre, each weighted by load. Stores the total pull on the pad in the state. Relaxes
    all springs; keep (TERMS,): share of each relaxed part that a step keeps."""
    k, carried, pull_x, pull_y = p[K_SHEAR], s[CARRIED], 0.0, 0.0
    loaded, held, load, depth = contacts[0], contacts[1], springs[LOAD], springs[DEPTH]
    for i in range(int(s[HELD])):
        if load[held[i]] <= 0.0:
            release_spring(springs, held[i])
    for i in range(TERMS):
        relaxed = springs[RELAXED + i]
        for j in range(int(s[TOUCHED])):
            towards = relaxed[j] + (depth[j] - relaxed[j]) * (1.0 - keep[i])
            relaxed[j] = towards if load[j] > 0.0 else relaxed[j] * keep[i]
    for c in range(int(s[LOADED])):
        j = held[c] = loaded[c]
        x, y = at[0, j], at[1, j]
        bx = springs[BRISTLE_X, j] + dx - turn * y
        by = springs[BRISTLE_Y, j] + dy + turn * x
        ex, ey = bx, by
        for i in range(TERMS):
            ex -= p[RELAXATION + i] * springs[RELAXED_X + i, j]
            ey -= p[RELAXATION + i] * springs[RELAXED_Y + i, j]
        pull = math.sqrt(ex * ex + ey * ey)
        mu = pad[MU_KINETIC] if springs[SLIDES, j] != 0.0 else pad[MU_STATIC]
        springs[SLIDES, j] = 0.0
        if k * pull > mu * load[j]:
            part = 1.0 - pad[MU_KINETIC] * load[j] / (k * pull)
            sx, sy = part * ex, part * ey
            bx, by, ex, ey = bx - sx, by - sy, ex - sx, ey - sy
            springs[SLIDES, j] = 1.0
            sums[0] += load[j]
            sums[1] += load[j] / carried * sx
            sums[2] += load[j] / carried * sy
            sums[3] += load[j] / carried * (x * sy - y * sx)
        springs[BRISTLE_X, j], springs[BRISTLE_Y, j] = bx, by
        springs[TRACTION_X, j], springs[TRACTION_Y, j] = k * ex, k * ey
        pull_x += k * ex
        pull_y += k * ey
        for i in range(TERMS):
            share = 1.0 - keep[i]
            springs[RELAXED_X + i, j] += (bx - springs[RELAXED_X + i, j]) * share
            springs[RELAXED_Y + i, j] += (by - springs[RELAXED_Y + i, j]) * share
    s[PULL_X], s[PULL_Y], s[HELD] = pull_x, pull_y, s[LOADED]


@inner
def release_spring(springs: Floats, j: int) -> None:
    """Clear the bristle of a spring that has lost contact."""
    for c in (BRISTLE_X, BRISTLE_Y, TRACTION_X, TRACTION_Y, SLIDES):
        springs[c, j] = 0.0
    for i in range(TERMS):
        springs[RELAXED_X + i, j] = springs[RELAXED_Y + i, j] = 0.0


@inner
def sway_mount(p: Floats, s: Floats, h_s: float) -> tuple[float, float]:
    """Displacement (x, y) of the mount in h_s, mm: a mass on a damped spring under the friction of
    the last step (symplectic Euler)."""
    k, w = p[LATERAL_NPMM], p[LATERAL_RADPS]
    if k == 0.0:
        return 0.0, 0.0
    keep = math.exp(-2.0 * p[LATERAL_DAMPING] * w * h_s)
    s[AWAY_SPEED_X] = keep * (s[AWAY_SPEED_X] + h_s * w * w * (s[PULL_X] / k - s[AWAY_X]))
    s[AWAY_SPEED_Y] = keep * (s[AWAY_SPEED_Y] + h_s * w * w * (s[PULL_Y] / k - s[AWAY_Y]))
    dx, dy = h_s * s[AWAY_SPEED_X], h_s * s[AWAY_SPEED_Y]
    s[AWAY_X] += dx
    s[AWAY_Y] += dy
    return dx, dy


@inner
def fit_sliding(
    at: Floats, springs: Floats, contacts: Indices, sums: Floats, dt_s: float, s: Floats
) -> None:
    """Fit a rigid motion to the slip of all loaded springs, weighted by load: velocity at the
    load's centre (mm/s) and turning rate (rad/s), 0 for a narrow contact."""
    weight, wx, wy, wr = 0.0, 0.0, 0.0, 0.0
    for c in range(int(s[LOADED])):
        j = contacts[0, c]
        load, x, y = springs[LOAD, j], at[0, j], at[1, j]
        weight += load
        wx += load * x
        wy += load * y
        wr += load * (x * x + y * y)
    s[SLIP_X] = s[SLIP_Y] = s[SPIN] = s[SHARE] = 0.0
    if weight <= 0.0:
        return
    mx, my = wx / weight, wy / weight
    spread = wr / weight - mx * mx - my * my
    turned = (sums[3] - mx * sums[2] + my * sums[1]) / spread if spread > NARROW_MM2 else 0.0
    s[SLIP_X], s[SLIP_Y], s[SPIN] = sums[1] / dt_s, sums[2] / dt_s, turned / dt_s
    s[SHARE] = sums[4]
    s[SLID_X] += dt_s * s[SLIP_X]
    s[SLID_Y] += dt_s * s[SLIP_Y]
    s[SLID_TURN] += dt_s * s[SPIN]


@inner
def inner_steps(p: Floats, path_mm: float, dt_s: float, stiffness: float) -> int:
    """Number of inner steps: none moves farther than STEP_MM unless shorter than STEP_S, and a
    mount that sways on pads of that stiffness (normal, N/mm) is integrated stably."""
    steps = math.ceil(min(path_mm / p[STEP_MM], dt_s / p[STEP_S]) - 1e-9)
    if p[LATERAL_NPMM] > 0.0:
        added = stiffness * p[K_SHEAR] / p[K_NORMAL] / p[LATERAL_NPMM]
        stuck_radps = p[LATERAL_RADPS] * math.sqrt(1.0 + added)
        longest_s = min(MODE_STEP_S, STABLE / stuck_radps)
        steps = max(steps, math.ceil(dt_s / longest_s - 1e-9))
    out: int = max(1, steps)
    return out


@inner
def clear_contact(s: Floats, springs: Floats) -> None:
    """Reset a pad without contact."""
    for c in range(SPRING):
        for j in range(int(s[TOUCHED])):
            springs[c, j] = 0.0
    for c in range(CARRIED, STATE):
        s[c] = 0.0


@inner
def shift_origin(s: Floats, dx: float, dy: float, turn: float) -> None:
    """Move the surface's origin by (dx, dy) at the pad's centre and turn it about that."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = s[POSE_X], s[POSE_Y]
    s[POSE_X], s[POSE_Y] = cos * x - sin * y + dx, sin * x + cos * y + dy
    s[POSE_TURN] += turn


# Codes


@inner
def read(
    p: Floats, s: Floats, springs: Floats, contacts: Indices, at: Floats, taxels: Floats,
    rest: Rests, warm: float, noise: Floats, work: Floats, out: Codes,
) -> None:  # fmt: skip
    """Codes (taxels,) of one pad into ``out``, from 0 to CODE_MAX; codes above FOLD are mirrored at
    it. warm: counts added by temperature; noise: standard normal.

    A normal load f at distance r lowers a taxel's code by f * NORMAL_PEAK exp(-r^2 / 2
    NORMAL_WIDTH^2) counts; a shear load q towards it by q * SHEAR_PEAK r exp(-r^2 / 2
    SHEAR_WIDTH^2).
    """
    tip_x, tip_y, normal, shear_x, shear_y = work[0], work[1], work[2], work[3], work[4]
    falls, n = work[5], int(s[LOADED])
    for c in range(n):
        j = contacts[0, c]
        tip_x[c], tip_y[c] = at[0, j] + springs[BRISTLE_X, j], at[1, j] + springs[BRISTLE_Y, j]
        normal[c] = p[NORMAL_PEAK] * springs[LOAD, j]
        shear_x[c] = p[SHEAR_PEAK] * springs[TRACTION_X, j]
        shear_y[c] = p[SHEAR_PEAK] * springs[TRACTION_Y, j]
    a, b = -0.5 / p[NORMAL_WIDTH] ** 2, -0.5 / p[SHEAR_WIDTH] ** 2
    for i in range(out.shape[0]):
        taxel_x, taxel_y = taxels[i, 0], taxels[i, 1]
        for c in range(n):
            x, y = taxel_x - tip_x[c], taxel_y - tip_y[c]
            rr = x * x + y * y
            shear = shear_x[c] * x + shear_y[c] * y
            fall = normal[c] * fast_exp(a * rr) + shear * fast_exp(b * rr)
            falls[c] = fall if a * rr > NEGLIGIBLE else 0.0
        exact = rest[i] - total(falls, n) + warm + p[NOISE_COUNTS] * noise[i]
        code = min(max(np.rint(exact), 0.0), p[CODE_MAX])
        out[i] = int(2.0 * p[FOLD] - code if code > p[FOLD] else code)


@inner
def fast_exp(x: float) -> float:
    """exp(x) for x from -12 to 0, relative error below 1e-10: the power series of exp((x + 6) / 32)
    to the 32nd power. LLVM vectorises it, in contrast to math.exp."""
    u = (x + 6.0) / 32.0
    e = 1 / 120 + u * (1 / 720 + u * (1 / 5040 + u * (1 / 40320)))
    e = 1.0 + u * (1.0 + u * (1 / 2 + u * (1 / 6 + u * (1 / 24 + u * e))))
    e2 = e * e
    e4 = e2 * e2
    e8 = e4 * e4
    e16 = e8 * e8
    return EXP_MINUS_6 * (e16 * e16)


@inner
def total(values: Floats, n: int) -> float:
    """Sum of the first n values, as four sums, since each addition waits for the one before."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    whole = n - n % 4
    for k in range(0, whole, 4):
        a += values[k]
        b += values[k + 1]
        c += values[k + 2]
        d += values[k + 3]
    for k in range(whole, n):
        a += values[k]
    return (a + b) + (c + d)


# Vibration, stepped exactly over any time


@inner
def shake(
    p: Floats, normal_n: Floats, motion: Floats, mounts: Floats, pads: Floats, states: Floats,
    vibration: Floats, scene: Floats,
) -> None:  # fmt: skip
    """Add vibration to pads that press on a fixed surface, each its own: loads normal_n (F,) and
    motion (F, 2) become the inputs ``scene`` (F, 5)."""
    for f in range(scene.shape[0]):
        s, own, mount = states[f], vibration[f], mounts[f]
        # springs in series: the base moves further by the mount's deflection
        total = normal_n[f] + depth_mm(p, own) * (s[STIFFNESS] + mount)
        if mount == 0.0:
            total = max(total, 0.0) if normal_n[f] > 0.0 else 0.0
        scene[f, LOAD_N] = total
        for c in range(2):
            shift_mm = p[SHIFT_MM] * (math.sqrt(2.0) * own[JITTER + 2 * c])
            sway_mm = p[SWAY_MM] * own[MODE_SIN] * pads[f, SHAKING_X + c]
            scene[f, MOVE_X + c] = motion[f, c] + sway_mm + shift_mm
            scene[f, ROCK_X + c] = p[ROCK_RAD] * (math.sqrt(2.0) * own[JITTER + 4 + 2 * c])


@inner
def shake_held(
    p: Floats, dt_s: float, normal_n: Floats, motion: Floats, pads: Floats, states: Floats,
    own: Floats, scene: Floats,
) -> None:  # fmt: skip
    """As ``shake``, of pads that hold one free object, each on its side.

    The hand vibrates as a whole (``own``), and the object follows with its inertia.
    Friction on the pads' faces loads them through their levers, equally on both sides.
    """
    hand = np.empty(DIRECTIONS)
    hand[0] = depth_mm(p, own)
    for c in range(2):
        jitter_mm = p[SHIFT_MM] * math.sqrt(2.0) * own[JITTER + 2 * c]
        hand[1 + c] = p[SWAY_MM] * own[MODE_SIN] * pads[0, SHAKING_X + c] + jitter_mm
        hand[3 + c] = p[ROCK_RAD] * math.sqrt(2.0) * own[JITTER + 4 + 2 * c]
    follow(p[HELD_RADPS], p[HELD_DAMPING], dt_s, hand, own[FOLLOWING:])
    push, total_stiffness = 0.0, 0.0
    for f in range(scene.shape[0]):
        s = states[f]
        if s[STIFFNESS] > 0.0:
            push += pads[f, SIDE] * levered(p, s)
            total_stiffness += s[STIFFNESS]
    for f in range(scene.shape[0]):
        s, side = states[f], pads[f, SIDE]
        total = normal_n[f] + side * hand[0] * s[STIFFNESS]
        if s[STIFFNESS] > 0.0:  # the object moves until both sides change equally
            total += levered(p, s) - side * s[STIFFNESS] * push / total_stiffness
        scene[f, LOAD_N] = max(total, 0.0) if normal_n[f] > 0.0 else 0.0
        for c in range(2):
            facing = 1.0 if c == 0 else side  # the pads face each other
            scene[f, MOVE_X + c] = motion[f, c] + facing * hand[1 + c]
            scene[f, ROCK_X + c] = facing * hand[3 + c]


@inner
def levered(p: Floats, s: Floats) -> float:
    """Load that friction on a pad's face adds through the finger's lever, N, on a fixed surface."""
    out: float = -p[LEVER_X] * s[PULL_X] - p[LEVER_Y] * s[PULL_Y]
    return out


@inner
def follow(radps: float, damping: float, dt_s: float, hand: Floats, following: Floats) -> None:
    """Motion of a damped mass on springs while the hand moves linearly to ``hand`` (DIRECTIONS,) in
    dt_s, stepped exactly; ``hand`` becomes the hand's motion relative to the mass. radps: natural
    frequency; damping: of critical, below 1."""
    decay, w = damping * radps, radps * math.sqrt(1.0 - damping * damping)
    keep = math.exp(-decay * dt_s)
    cos, sin = keep * math.cos(w * dt_s), keep * math.sin(w * dt_s) / w
    for k in range(hand.shape[0]):
        state = following[3 * k : 3 * k + 3]
        speed = (hand[k] - state[HAND]) / dt_s
        z, v = state[OBJECT] - state[HAND], state[SPEED] - speed  # relative to the hand
        state[HAND] = hand[k]
        state[OBJECT] = hand[k] + cos * z + sin * (v + decay * z)
        state[SPEED] = speed + cos * v - sin * (decay * v + radps * radps * z)
        hand[k] -= state[OBJECT]


@inner
def vibrate(
    p: Floats, dt_s: float, arm_moves: bool, normals: Floats, jitter_normals: Floats,
    vibration: Floats,
) -> None:  # fmt: skip
    """Step the vibration of every pad, or of the hand, exactly over dt_s.

    Wander is an Ornstein-Uhlenbeck process filtered by another, which makes it as smooth as a
    force-controlled press. The arm's mode is a damped oscillation, driven while the arm moves and
    common to all pads. Jitter, sideways and in tilt, is wander of variance 1/2.
    """
    n = vibration.shape[0]
    keep = math.exp(-p[MODE_DAMPING] * p[MODE_RADPS] * dt_s)
    cos, sin = keep * math.cos(p[MODE_RADPS] * dt_s), keep * math.sin(p[MODE_RADPS] * dt_s)
    drive = math.sqrt(1.0 - keep * keep) if arm_moves else 0.0
    for f in range(n):
        own = vibration[f]
        a, b = own[MODE_COS], own[MODE_SIN]
        own[MODE_COS] = cos * a - sin * b + drive * normals[4 * n]
        own[MODE_SIN] = sin * a + cos * b + drive * normals[4 * n + 1]
        wander(dt_s / p[FAST_S], normals[f], normals[n + f], own[FAST:])
        wander(dt_s / p[SLOW_S], normals[2 * n + f], normals[3 * n + f], own[SLOW:])
        if p[SHIFT_MM] > 0.0 or p[ROCK_RAD] > 0.0:
            for k in range(0, 2 * JITTERS, 2):
                first, second = jitter_normals[f, k], jitter_normals[f, k + 1]
                wander(dt_s / p[JITTER_S], first, second, own[JITTER + k :])


@inner
def depth_mm(p: Floats, own: Floats) -> float:
    """Depth beyond the commanded one by wander and the arm's mode, mm."""
    depth: float = p[WANDER_MM] * (own[FAST] + own[SLOW]) + p[MODE_MM] * own[MODE_COS]
    return depth


@inner
def wander(a: float, first: float, second: float, pair: Floats) -> None:
    """Step (y, x), the first two of ``pair``, over ``a`` time constants: x' = -x + white noise of
    variance 2, y' = x - y. The stationary variance of x is 1, of y 1/2. The noise of a step has the
    covariance of the exact solution; ``first`` and ``second`` are standard normal."""
    keep, keep2 = math.exp(-a), math.exp(-2.0 * a)
    xx, xy = 1.0 - keep2, 0.5 - keep2 * (a + 0.5)
    yy = 0.5 - keep2 * (a * (a + 1.0) + 0.5)
    y, x = pair[0], pair[1]
    own = keep * (y + a * x) + xy / math.sqrt(xx) * first
    pair[0] = own + math.sqrt(max(yy - xy * xy / xx, 0.0)) * second
    pair[1] = keep * x + math.sqrt(xx) * first
