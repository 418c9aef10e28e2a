"""The compiled part of the fingertip: a bed of springs with friction bristles under rough contact.

Every function here is a leaf: numba's cache does not see changes in an imported kernel, so nothing
of this file comes from another. Lengths in millimetres, forces in newtons, the pad's frame
throughout (x along the columns, y across the rows).

One spring j sits at r_j, those near the middle first. Where it touches, its tip holds on to the
surface by a bristle (deflection b_j), so it meets the surface point q = R(-turn) (r_j + b_j -
pose), whose height decides how deep it is pressed. The common approach of the pad is the one at
which all springs carry the given load.
A bristle follows the surface until its traction exceeds the friction of its own load, and then
drags behind (return mapping; statically 1-D: Jenkins element). Prony terms let both loads relax:
f = k (d - sum phi_i rho_i), rho_i' = (d - rho_i) / tau_i.

The pad hangs on a mount. Along the normal it is a spring (stiffness 0: the load is given); the
friction Q on the pad's face acts on the mount's joint by a lever, which loads or unloads it
(a drum brake's shoe, leading or trailing). Sideways the mount is a damped spring with a mass.
docs/simulation.md has the equations.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Codes = NDArray[np.int16]
Indices = NDArray[np.int64]
Rests = NDArray[np.int64]

# Layout of the parameter vector, one for all pads,
(
    K_NORMAL, K_SHEAR, STEP_MM, STEP_S, NORMAL_PEAK, NORMAL_WIDTH, SHEAR_PEAK, SHEAR_WIDTH,
    LEVER_X, LEVER_Y, LATERAL_NPMM, LATERAL_RADPS, LATERAL_DAMPING, HALF_X, HALF_Y, RELAXATION,
) = range(16)  # fmt: skip
TERMS = 3  # of the relaxation: shares from RELAXATION on, then time constants
RELAXATION_TIME = RELAXATION + TERMS
PARAMETERS = RELAXATION_TIME + TERMS
# of the surface of each pad,
CURVATURE_X, CURVATURE_Y, MU_STATIC, MU_KINETIC, FIELD_STEP, FIELD_PEAK = range(6)
# and of the state of each pad.
(
    POSE_X, POSE_Y, POSE_TURN, APPROACH, SLIP_X, SLIP_Y, SPIN, SHARE, STIFFNESS, CARRIED,
    PULL_X, PULL_Y, AWAY_X, AWAY_Y, AWAY_SPEED_X, AWAY_SPEED_Y, TOUCHED,
) = range(17)  # fmt: skip
STATE = 17
# State of each spring; deflection and what of it has relaxed, first of the load, then of shear.
# Depth is that under the last load, 0 once its bristle has let go.
DEPTH, BRISTLE_X, BRISTLE_Y, LOAD, SLIDES, TRACTION_X, TRACTION_Y, RELAXED = range(8)
RELAXED_X, RELAXED_Y = RELAXED + TERMS, RELAXED + 2 * TERMS
SPRING = RELAXED + 3 * TERMS
NEWTON_STEPS = 60
SAME_MM = 1e-9
NEGLIGIBLE = -12.0  # exponent of a kernel: below 0.01 counts a newton
NARROW_MM2 = 0.25  # load within half a millimetre of its middle shows no turn
CLEAR_MM = 0.1  # springs that stay further than this from the surface are not looked at closely
FAR = -1e6  # reach of such a spring
MODE_STEP_S = 0.002  # longest inner step of a mount that swings: a fiftieth of its period
STABLE = 1.5  # radians of a swing in a step; symplectic Euler is stable below 2
OUT_OF_REACH_MM = 5.0  # a mount that would have to be pressed so much further touches nothing


@njit(cache=True)
def height(field: Singles, step_mm: float, x: float, y: float) -> float:
    """Height of the surface at object point (x, y), bilinear between grid points, periodic."""
    mask = field.shape[0] - 1  # a power of two
    u, v = x / step_mm, y / step_mm
    iu, iv = math.floor(u), math.floor(v)
    a, b = u - iu, v - iv
    i0, j0 = int(iu) & mask, int(iv) & mask
    i1, j1 = (i0 + 1) & mask, (j0 + 1) & mask
    low = field[i0, j0] + a * (field[i1, j0] - field[i0, j0])
    high = field[i0, j1] + a * (field[i1, j1] - field[i0, j1])
    out: float = low + b * (high - low)
    return out


@njit(cache=True)
def reaches(
    p: Floats, state: Floats, surface: Floats, centre: Floats, tilt: Floats, field: Singles,
    at: Floats, gap: Floats, level: float, springs: Floats, near: Indices, out: Floats,
) -> int:  # fmt: skip
    """Which springs could touch at the approach ``level``, and the depth of each at approach zero,
    less what has relaxed of it: near (S,) and out (S,), as far as the count that is returned. gap
    (2, S): of pad and tilt at each spring, and the least of it from there on."""
    cos, sin = math.cos(state[POSE_TURN]), math.sin(state[POSE_TURN])
    kx, ky = 0.5 * surface[CURVATURE_X], 0.5 * surface[CURVATURE_Y]
    step, highest = surface[FIELD_STEP], level + surface[FIELD_PEAK]
    pose_x, pose_y = state[POSE_X], state[POSE_Y]
    out_of_sight = highest + abs(tilt[0]) * p[HALF_X] + abs(tilt[1]) * p[HALF_Y]
    count = 0
    for j in range(at.shape[0]):
        if gap[1, j] > out_of_sight:
            break
        x = at[j, 0] + springs[BRISTLE_X, j]
        y = at[j, 1] + springs[BRISTLE_Y, j]
        wx, wy = x - centre[0], y - centre[1]
        u, v = cos * wx + sin * wy, cos * wy - sin * wx
        below = gap[0, j] + tilt[0] * at[j, 0] + tilt[1] * at[j, 1]
        below += kx * u * u + ky * v * v
        for i in range(TERMS):
            below += p[RELAXATION + i] * springs[RELAXED + i, j]
        if highest < below:
            continue
        dx, dy = x - pose_x, y - pose_y
        near[count] = j
        out[count] = height(field, step, cos * dx + sin * dy, cos * dy - sin * dx) - below
        count += 1
    if count > 0:
        state[TOUCHED] = max(state[TOUCHED], near[count - 1] + 1)
    return count


@njit(cache=True)
def solve_approach(reach: Floats, total_mm: float, mount: float, start: float, n: int) -> float:
    """Approach a at which positive depths reach + a, and mount * a, sum to total_mm: mount is the
    mount's stiffness over that of a spring; 0: the load is given, and above 0. Of n springs in all
    those that reach does not name stay clear.

    The sum rises piecewise linearly and convexly, so Newton steps from the right are exact.
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
            lowest = reach.min() if reach.shape[0] == n else FAR
            approach = total_mm / n - lowest  # all springs touch: never too shallow
            continue
        change = (total - total_mm) / slope
        approach -= change
        if abs(change) < SAME_MM:
            break
    return approach


@njit(cache=True)
def press(
    p: Floats, state: Floats, near: Indices, reach: Floats, total_n: float, mount: float,
    springs: Floats,
) -> None:  # fmt: skip
    """Share the load out over the springs near the surface; total_n is that of a mount at approach
    zero."""
    k = p[K_NORMAL]
    state[APPROACH] = solve_approach(
        reach, total_n / k, mount / k, state[APPROACH], springs.shape[1]
    )
    state[STIFFNESS] = state[CARRIED] = 0.0
    touched = int(state[TOUCHED])
    springs[LOAD, :touched] = 0.0
    for i in range(reach.shape[0]):
        j = near[i]
        d = state[APPROACH] + reach[i]
        if d <= 0.0:
            continue
        load = k * d
        springs[LOAD, j] = load
        for term in range(TERMS):
            d += p[RELAXATION + term] * springs[RELAXED + term, j]
        springs[DEPTH, j] = d
        state[STIFFNESS] += k
        state[CARRIED] += load


@njit(cache=True)
def drag(
    p: Floats, surface: Floats, at: Floats, dx: float, dy: float, turn: float, keep: Floats,
    springs: Floats, state: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Carry the bristles along with the surface, which moves by (dx, dy) and turns; those beyond
    their friction slide. Adds to sums (5,): sliding load; slip, and its moment about the pad's
    middle, mean over the load as it is now; notes the pull of all on the pad.
    """
    k, carried = p[K_SHEAR], state[CARRIED]
    state[PULL_X] = state[PULL_Y] = 0.0
    for j in range(int(state[TOUCHED])):
        load = springs[LOAD, j]
        if load <= 0.0:
            if springs[DEPTH, j] != 0.0:
                let_go(springs, j)
            for i in range(TERMS):
                springs[RELAXED + i, j] *= keep[i]
            continue
        x, y = at[j, 0], at[j, 1]
        bx = springs[BRISTLE_X, j] + dx - turn * y
        by = springs[BRISTLE_Y, j] + dy + turn * x
        ex, ey = bx, by
        for i in range(TERMS):
            ex -= p[RELAXATION + i] * springs[RELAXED_X + i, j]
            ey -= p[RELAXATION + i] * springs[RELAXED_Y + i, j]
        pull = math.sqrt(ex * ex + ey * ey)
        mu = surface[MU_KINETIC] if springs[SLIDES, j] != 0.0 else surface[MU_STATIC]
        springs[SLIDES, j] = 0.0
        if k * pull > mu * load:
            part = 1.0 - surface[MU_KINETIC] * load / (k * pull)
            sx, sy = part * ex, part * ey
            bx, by, ex, ey = bx - sx, by - sy, ex - sx, ey - sy
            springs[SLIDES, j] = 1.0
            sums[0] += load
            sums[1] += load / carried * sx
            sums[2] += load / carried * sy
            sums[3] += load / carried * (x * sy - y * sx)
        springs[BRISTLE_X, j], springs[BRISTLE_Y, j] = bx, by
        springs[TRACTION_X, j], springs[TRACTION_Y, j] = k * ex, k * ey
        state[PULL_X] += k * ex
        state[PULL_Y] += k * ey
        for i in range(TERMS):
            gone = 1.0 - keep[i]
            springs[RELAXED + i, j] += (springs[DEPTH, j] - springs[RELAXED + i, j]) * gone
            springs[RELAXED_X + i, j] += (bx - springs[RELAXED_X + i, j]) * gone
            springs[RELAXED_Y + i, j] += (by - springs[RELAXED_Y + i, j]) * gone


@njit(cache=True)
def let_go(springs: Floats, j: int) -> None:
    """A spring that carried load and does not any more has nothing to hold on to."""
    for c in (DEPTH, BRISTLE_X, BRISTLE_Y, TRACTION_X, TRACTION_Y, SLIDES):
        springs[c, j] = 0.0
    for i in range(TERMS):
        springs[RELAXED_X + i, j] = springs[RELAXED_Y + i, j] = 0.0


@njit(cache=True)
def swing(p: Floats, s: Floats, h_s: float) -> tuple[float, float]:
    """Let the mount give way sideways for h_s: a mass on a damped spring under the friction of the
    last step (symplectic Euler). The way that it goes, mm."""
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


@njit(cache=True)
def sliding(at: Floats, springs: Floats, sums: Floats, dt_s: float, state: Floats) -> None:
    """The rigid motion that fits the slip of all loaded springs best, weighted by load: velocity
    at the load's middle (mm/s) and turning rate (rad/s), of a contact wide enough to tell."""
    weight, wx, wy, wr = 0.0, 0.0, 0.0, 0.0
    for j in range(int(state[TOUCHED])):
        load, x, y = springs[LOAD, j], at[j, 0], at[j, 1]
        if load <= 0.0:
            continue
        weight += load
        wx += load * x
        wy += load * y
        wr += load * (x * x + y * y)
    state[SLIP_X] = state[SLIP_Y] = state[SPIN] = state[SHARE] = 0.0
    if weight <= 0.0:
        return
    mx, my = wx / weight, wy / weight
    spread = wr / weight - mx * mx - my * my
    turned = (sums[3] - mx * sums[2] + my * sums[1]) / spread if spread > NARROW_MM2 else 0.0
    state[SLIP_X], state[SLIP_Y] = sums[1] / dt_s, sums[2] / dt_s
    state[SPIN] = turned / dt_s
    state[SHARE] = sums[4]


@njit(cache=True)
def inner_steps(p: Floats, path_mm: float, dt_s: float, stiffness: float) -> int:
    """So many that none goes further than STEP_MM unless it would be shorter than STEP_S, and that
    a mount that swings on pads of that stiffness (normal, N/mm) is stepped stably."""
    steps = math.ceil(min(path_mm / p[STEP_MM], dt_s / p[STEP_S]) - 1e-9)
    if p[LATERAL_NPMM] > 0.0:
        held = stiffness * p[K_SHEAR] / p[K_NORMAL] / p[LATERAL_NPMM]
        stuck_radps = p[LATERAL_RADPS] * math.sqrt(1.0 + held)
        longest_s = min(MODE_STEP_S, STABLE / stuck_radps)
        steps = max(steps, math.ceil(dt_s / longest_s - 1e-9))
    out: int = max(1, steps)
    return out


@njit(cache=True)
def forget(state: Floats, springs: Floats) -> None:
    """Nothing is touched, and nothing of it is left."""
    springs[:, : int(state[TOUCHED])] = 0.0
    state[CARRIED:] = 0.0


@njit(cache=True)
def advance(
    p: Floats, dt_s: float, total0: Floats, total1: Floats, mounts: Floats, motion: Floats,
    turn: Floats, rocked: Floats, centre0: Floats, centre1: Floats, surfaces: Floats,
    fields: Singles, at: Floats, gaps: Floats, states: Floats, springs: Floats,
) -> None:  # fmt: skip
    """Advance all pads by dt_s > 0. Load and centre go from their first values to their second,
    the surface moves by motion (F, 2) and turns by turn (F,), all linearly.

    Where mounts (F,) is above 0 the pad hangs on a spring so stiff, N/mm, and the totals (F,) are
    its load at approach 0; elsewhere they are the load itself. rocked (F, 2): tilt from outside.
    """
    reach, near = np.empty(at.shape[0]), np.empty(at.shape[0], np.int64)
    keep, centre, widest = np.empty(TERMS), np.empty(2), at[:, 0].max()
    for f in range(states.shape[0]):
        s, own, mount = states[f], springs[f], mounts[f]
        away = -OUT_OF_REACH_MM * mount
        if total0[f] <= away and total1[f] <= away:
            s[POSE_X], s[POSE_Y] = moved(s, motion[f, 0], motion[f, 1], turn[f])
            s[POSE_TURN] += turn[f]
            s[SLIP_X : SHARE + 1] = 0.0
            forget(s, own)
            continue
        path = math.hypot(motion[f, 0], motion[f, 1]) + abs(turn[f]) * widest
        steps = inner_steps(p, path, dt_s, s[STIFFNESS])
        h = 1.0 / steps
        for i in range(TERMS):
            keep[i] = math.exp(-dt_s * h / p[RELAXATION_TIME + i])
        dturn = turn[f] * h
        sums = np.zeros(5)
        for i in range(steps):
            end = (i + 1.0) * h
            away_x, away_y = swing(p, s, dt_s * h)
            dx, dy = motion[f, 0] * h - away_x, motion[f, 1] * h - away_y
            for c in range(2):
                centre[c] = centre0[f, c] + (centre1[f, c] - centre0[f, c]) * end - s[AWAY_X + c]
            s[POSE_X], s[POSE_Y] = moved(s, dx, dy, dturn)
            s[POSE_TURN] += dturn
            sums[0] = 0.0
            drag(p, surfaces[f], at, dx, dy, dturn, keep, own, s, sums)
            total = total0[f] + (total1[f] - total0[f]) * end
            if mount > 0.0:
                total -= p[LEVER_X] * s[PULL_X] + p[LEVER_Y] * s[PULL_Y]
            elif total <= 0.0:
                forget(s, own)
                continue
            level = -math.inf
            while s[APPROACH] > level:  # what was out of sight may touch as well
                level = s[APPROACH] + CLEAR_MM
                n = reaches(
                    p, s, surfaces[f], centre, rocked[f], fields[f], at, gaps[f], level, own,
                    near, reach,
                )  # fmt: skip
                press(p, s, near[:n], reach[:n], total, mount, own)
            sums[4] = min(1.0, sums[0] / s[CARRIED]) if s[CARRIED] > 0.0 else 0.0
        sliding(at, own, sums, dt_s, s)


@njit(cache=True)
def moved(state: Floats, dx: float, dy: float, turn: float) -> tuple[float, float]:
    """Where the surface's own origin lies after the surface moved by (dx, dy) at the pad's middle
    while turning about it."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = state[POSE_X], state[POSE_Y]
    return cos * x - sin * y + dx, sin * x + cos * y + dy


@njit(cache=True)
def read(
    p: Floats, states: Floats, springs: Floats, at: Floats, taxels: Floats, rest: Rests,
    warm: float, noise_counts: float, noise: Floats, most: int, fold: int, out: Codes,
) -> None:  # fmt: skip
    """Whole codes (F, taxels) from 0 to most under all springs' loads; those above fold come back
    down from it."""
    fall = np.empty(out.shape[1])
    for f in range(out.shape[0]):
        kernel_sums(p, springs[f, :, : int(states[f, TOUCHED])], at, taxels, fall)
        for i in range(out.shape[1]):
            exact = rest[f, i] - fall[i] + warm + noise_counts * noise[f, i]
            code = min(max(int(np.rint(exact)), 0), most)
            out[f, i] = 2 * fold - code if code > fold else code


@njit(cache=True)
def kernel_sums(p: Floats, springs: Floats, at: Floats, taxels: Floats, out: Floats) -> None:
    """Fall of each taxel's code, counts (taxels,), under the loads of one pad's springs at their
    tips.

    A normal load f at distance r gives f * NORMAL_PEAK exp(-r^2 / 2 NORMAL_WIDTH^2) counts; a
    shear load q towards the taxel q * SHEAR_PEAK r exp(-r^2 / 2 SHEAR_WIDTH^2).
    """
    a, b = -0.5 / p[NORMAL_WIDTH] ** 2, -0.5 / p[SHEAR_WIDTH] ** 2
    out[:] = 0.0
    for j in range(springs.shape[1]):
        load = springs[LOAD, j]
        if load <= 0.0:
            continue
        qx, qy = springs[TRACTION_X, j], springs[TRACTION_Y, j]
        for i in range(taxels.shape[0]):
            x = taxels[i, 0] - at[j, 0] - springs[BRISTLE_X, j]
            y = taxels[i, 1] - at[j, 1] - springs[BRISTLE_Y, j]
            rr = x * x + y * y
            if a * rr > NEGLIGIBLE:
                out[i] += load * p[NORMAL_PEAK] * math.exp(a * rr)
                out[i] += (qx * x + qy * y) * p[SHEAR_PEAK] * math.exp(b * rr)
