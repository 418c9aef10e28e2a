"""The compiled part of the fingertip: a bed of springs with friction bristles under rough contact.

Numba's cache does not detect changes in an imported kernel, so this file imports none. Lengths in
millimetres, forces in newtons, in the pad's frame (x along the columns, y across the rows).

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

# Layout of the parameter vector, common to all pads.
(
    K_NORMAL, K_SHEAR, STEP_MM, STEP_S, NORMAL_PEAK, NORMAL_WIDTH, SHEAR_PEAK, SHEAR_WIDTH,
    LEVER_X, LEVER_Y, LATERAL_NPMM, LATERAL_RADPS, LATERAL_DAMPING, HALF_X, HALF_Y, RELAXATION,
) = range(16)  # fmt: skip
TERMS = 3  # of the relaxation: shares from RELAXATION on, then time constants
RELAXATION_TIME = RELAXATION + TERMS
PARAMETERS = RELAXATION_TIME + TERMS
# Layout of each pad's surface.
CURVATURE_X, CURVATURE_Y, MU_STATIC, MU_KINETIC, FIELD_STEP, FIELD_PEAK = range(6)
# Layout of each pad's state.
(
    POSE_X, POSE_Y, POSE_TURN, APPROACH, SLIP_X, SLIP_Y, SPIN, SHARE, STIFFNESS, CARRIED,
    PULL_X, PULL_Y, AWAY_X, AWAY_Y, AWAY_SPEED_X, AWAY_SPEED_Y, TOUCHED,
) = range(17)  # fmt: skip
STATE = 17
# Layout of each spring's state. RELAXED: relaxed parts of the depth, then of the bristle. DEPTH is
# that under the last load, 0 once its bristle is released.
DEPTH, BRISTLE_X, BRISTLE_Y, LOAD, SLIDES, TRACTION_X, TRACTION_Y, RELAXED = range(8)
RELAXED_X, RELAXED_Y = RELAXED + TERMS, RELAXED + 2 * TERMS
SPRING = RELAXED + 3 * TERMS
NEWTON_STEPS = 60
SAME_MM = 1e-9
NEGLIGIBLE = -12.0  # exponent of a kernel: below 0.01 counts/N
NARROW_MM2 = 0.25  # a load within half a millimetre of its centre has no measurable rotation
CLEAR_MM = 0.1  # springs farther than this from the surface are skipped
FAR = -1e6  # reach of such a spring
MODE_STEP_S = 0.002  # longest inner step of a swaying mount: a fiftieth of its period
STABLE = 1.5  # phase per step, rad; symplectic Euler is stable below 2
OUT_OF_REACH_MM = 5.0  # a pad this far from the surface has no contact


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
def touching_candidates(
    p: Floats, state: Floats, surface: Floats, centre: Floats, tilt: Floats, field: Singles,
    at: Floats, gap: Floats, level: float, springs: Floats, near: Indices, out: Floats,
) -> int:  # fmt: skip
    """Springs that could touch at the approach ``level``: indices into near (S,), depths at
    approach zero minus relaxation into out (S,); returns their count. gap (2, S): gap by pad shape
    and tilt at each spring, and its minimum over all later springs."""
    cos, sin = math.cos(state[POSE_TURN]), math.sin(state[POSE_TURN])
    kx, ky = 0.5 * surface[CURVATURE_X], 0.5 * surface[CURVATURE_Y]
    step, highest = surface[FIELD_STEP], level + surface[FIELD_PEAK]
    pose_x, pose_y = state[POSE_X], state[POSE_Y]
    beyond_reach = highest + abs(tilt[0]) * p[HALF_X] + abs(tilt[1]) * p[HALF_Y]
    count = 0
    for j in range(at.shape[0]):
        if gap[1, j] > beyond_reach:
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
    """Distribute the load over the springs near the surface; total_n is the load with a mount at
    approach zero."""
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
    """Move the bristles with the surface, which moves by (dx, dy) and turns; those beyond their
    friction limit slide. Adds to sums (5,): sliding load, slip x and y, and moment of slip about
    the pad's centre, each weighted by load. Stores the total pull on the pad in the state."""
    k, carried = p[K_SHEAR], state[CARRIED]
    state[PULL_X] = state[PULL_Y] = 0.0
    for j in range(int(state[TOUCHED])):
        load = springs[LOAD, j]
        if load <= 0.0:
            if springs[DEPTH, j] != 0.0:
                release_spring(springs, j)
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
            share = 1.0 - keep[i]
            springs[RELAXED + i, j] += (springs[DEPTH, j] - springs[RELAXED + i, j]) * share
            springs[RELAXED_X + i, j] += (bx - springs[RELAXED_X + i, j]) * share
            springs[RELAXED_Y + i, j] += (by - springs[RELAXED_Y + i, j]) * share


@njit(cache=True)
def release_spring(springs: Floats, j: int) -> None:
    """Clear the bristle of a spring that has lost contact."""
    for c in (DEPTH, BRISTLE_X, BRISTLE_Y, TRACTION_X, TRACTION_Y, SLIDES):
        springs[c, j] = 0.0
    for i in range(TERMS):
        springs[RELAXED_X + i, j] = springs[RELAXED_Y + i, j] = 0.0


@njit(cache=True)
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


@njit(cache=True)
def fit_sliding(at: Floats, springs: Floats, sums: Floats, dt_s: float, state: Floats) -> None:
    """Fit a rigid motion to the slip of all loaded springs, weighted by load: velocity at the
    load's centre (mm/s) and turning rate (rad/s), 0 for a narrow contact."""
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


@njit(cache=True)
def clear_contact(state: Floats, springs: Floats) -> None:
    """Reset a pad without contact."""
    springs[:, : int(state[TOUCHED])] = 0.0
    state[CARRIED:] = 0.0


@njit(cache=True)
def advance(
    p: Floats, dt_s: float, total0: Floats, total1: Floats, mounts: Floats, motion: Floats,
    turn: Floats, rocked: Floats, centre0: Floats, centre1: Floats, surfaces: Floats,
    fields: Singles, at: Floats, gaps: Floats, states: Floats, springs: Floats,
) -> None:  # fmt: skip
    """Advance all pads by dt_s > 0. Loads change from total0 to total1, centres from centre0 to
    centre1; the surface moves by motion (F, 2) and turns by turn (F,), all linearly.

    Where mounts (F,) is above 0 it is the stiffness of the pad's spring, N/mm, and the totals (F,)
    are its load at approach 0; elsewhere they are the load itself. rocked (F, 2): external tilt.
    """
    reach, near = np.empty(at.shape[0]), np.empty(at.shape[0], np.int64)
    keep, centre, widest = np.empty(TERMS), np.empty(2), at[:, 0].max()
    for f in range(states.shape[0]):
        s, pad, mount = states[f], springs[f], mounts[f]
        away = -OUT_OF_REACH_MM * mount
        if total0[f] <= away and total1[f] <= away:
            s[POSE_X], s[POSE_Y] = shift_origin(s, motion[f, 0], motion[f, 1], turn[f])
            s[POSE_TURN] += turn[f]
            s[SLIP_X : SHARE + 1] = 0.0
            clear_contact(s, pad)
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
            away_x, away_y = sway_mount(p, s, dt_s * h)
            dx, dy = motion[f, 0] * h - away_x, motion[f, 1] * h - away_y
            for c in range(2):
                centre[c] = centre0[f, c] + (centre1[f, c] - centre0[f, c]) * end - s[AWAY_X + c]
            s[POSE_X], s[POSE_Y] = shift_origin(s, dx, dy, dturn)
            s[POSE_TURN] += dturn
            sums[0] = 0.0
            drag(p, surfaces[f], at, dx, dy, dturn, keep, pad, s, sums)
            total = total0[f] + (total1[f] - total0[f]) * end
            if mount > 0.0:
                total -= p[LEVER_X] * s[PULL_X] + p[LEVER_Y] * s[PULL_Y]
            elif total <= 0.0:
                clear_contact(s, pad)
                continue
            level = -math.inf
            while s[APPROACH] > level:  # springs skipped at a smaller approach may touch as well
                level = s[APPROACH] + CLEAR_MM
                n = touching_candidates(
                    p, s, surfaces[f], centre, rocked[f], fields[f], at, gaps[f], level, pad,
                    near, reach,
                )  # fmt: skip
                press(p, s, near[:n], reach[:n], total, mount, pad)
            sums[4] = min(1.0, sums[0] / s[CARRIED]) if s[CARRIED] > 0.0 else 0.0
        fit_sliding(at, pad, sums, dt_s, s)


@njit(cache=True)
def shift_origin(state: Floats, dx: float, dy: float, turn: float) -> tuple[float, float]:
    """Position of the surface's origin after the surface has moved by (dx, dy) at the pad's centre
    and turned about it."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = state[POSE_X], state[POSE_Y]
    return cos * x - sin * y + dx, sin * x + cos * y + dy


@njit(cache=True)
def read(
    p: Floats, states: Floats, springs: Floats, at: Floats, taxels: Floats, rest: Rests,
    warm: float, noise_counts: float, noise: Floats, most: int, fold: int, out: Codes,
) -> None:  # fmt: skip
    """Codes (F, taxels) from 0 to most under all springs' loads into ``out``; codes above ``fold``
    are mirrored at it."""
    fall = np.empty(out.shape[1])
    for f in range(out.shape[0]):
        kernel_sums(p, springs[f, :, : int(states[f, TOUCHED])], at, taxels, fall)
        for i in range(out.shape[1]):
            exact = rest[f, i] - fall[i] + warm + noise_counts * noise[f, i]
            code = min(max(int(np.rint(exact)), 0), most)
            out[f, i] = 2 * fold - code if code > fold else code


@njit(cache=True)
def kernel_sums(p: Floats, springs: Floats, at: Floats, taxels: Floats, out: Floats) -> None:
    """Fall of each taxel's code, counts (taxels,), under the loads at one pad's spring tips.

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
