"""The compiled part of the fingertip: a bed of springs with friction bristles under rough contact.

Every function here is a leaf: numba's cache does not see changes in an imported kernel, so nothing
of this file comes from another. Lengths in millimetres, forces in newtons, the pad's frame
throughout (x along the columns, y across the rows).

One spring j sits at r_j. Where it touches, its tip holds on to the surface by a bristle (deflection
b_j), so it meets the surface point q = R(-turn) (r_j + b_j - pose), whose height decides how deep
it is pressed. The common approach of the pad is the one at which all springs carry the given load.
A bristle follows the surface until its traction exceeds the friction of its own load, and then
drags behind (return mapping; statically 1-D: Jenkins element). One Prony term a spring lets both
loads relax: f = k (d - phi rho), rho' = (d - rho) / tau.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

# Layout of the parameter vector, one for all pads,
(
    K_NORMAL, K_SHEAR, RELAXATION, RELAXATION_TIME, STEP_MM, STEP_S,
    NORMAL_PEAK, NORMAL_WIDTH, SHEAR_PEAK, SHEAR_WIDTH,
    WANDER_MM, FAST_S, SLOW_S, MODE_MM, SWAY_MM, MODE_RADPS, MODE_DAMPING,
) = range(17)  # fmt: skip
PARAMETERS = 17
# of the surface of each pad,
CURVATURE_X, CURVATURE_Y, MU_STATIC, MU_KINETIC, FIELD_STEP = range(5)
# and of the state of each pad.
POSE_X, POSE_Y, POSE_TURN, APPROACH, SLIP_X, SLIP_Y, SPIN, SHARE, STIFFNESS = range(9)
STATE = 9
# What shakes the pads: wander of either memory a pad, with what drives it, and the arm's mode.
FAST, FAST_DRIVE, SLOW, SLOW_DRIVE, MODE_COS, MODE_SIN = range(6)
DISTURBANCE = 6
# State of each spring; deflection and what of it has relaxed, first of the load, then of shear.
DEPTH, BRISTLE_X, BRISTLE_Y, RELAXED, RELAXED_X, RELAXED_Y, LOAD, SLIDES = range(8)
SPRING = 8
NEWTON_STEPS = 60
SAME_MM = 1e-9
NEGLIGIBLE = -12.0  # exponent of a kernel: below 0.01 counts a newton


@njit(cache=True)
def disturb(
    p: Floats, dt_s: float, arm_moves: bool, normal: Floats, motion: Floats, shaking: Floats,
    draws: Floats, states: Floats, disturbance: Floats, load: Floats, moved_to: Floats,
) -> None:  # fmt: skip
    """Load (F,) with wander and vibration, and motion (F, 2) with the vibration's sway.

    Wander and vibration press the pad a little more or less, which the springs in contact turn
    into load. Wander is an Ornstein-Uhlenbeck process that drags another behind it, so it is as
    smooth as what a force loop holds; the arm's mode is damped, turns as it decays, is driven while
    the arm moves, and is common to all pads, which it shakes along their own directions shaking
    (F, 2). All are stepped exactly over dt_s with standard normal draws (4 F + 2,).
    """
    n = normal.shape[0]
    keep = math.exp(-p[MODE_DAMPING] * p[MODE_RADPS] * dt_s)
    cos, sin = keep * math.cos(p[MODE_RADPS] * dt_s), keep * math.sin(p[MODE_RADPS] * dt_s)
    drive = math.sqrt(1.0 - keep * keep) if arm_moves else 0.0
    a, b = disturbance[MODE_COS, 0], disturbance[MODE_SIN, 0]
    disturbance[MODE_COS, :] = cos * a - sin * b + drive * draws[4 * n]
    disturbance[MODE_SIN, :] = sin * a + cos * b + drive * draws[4 * n + 1]
    for f in range(n):
        own = disturbance[:, f]
        wander(dt_s / p[FAST_S], draws[f], draws[n + f], own[FAST : FAST_DRIVE + 1])
        wander(dt_s / p[SLOW_S], draws[2 * n + f], draws[3 * n + f], own[SLOW : SLOW_DRIVE + 1])
        pressed = p[WANDER_MM] * (own[FAST] + own[SLOW])
        pressed += p[MODE_MM] * own[MODE_COS]
        added = states[f, STIFFNESS] * pressed
        load[f] = max(0.0, normal[f] + added) if normal[f] > 0.0 else 0.0
        for c in range(2):
            moved_to[f, c] = motion[f, c] + p[SWAY_MM] * own[MODE_SIN] * shaking[f, c]


@njit(cache=True)
def wander(a: float, draw: float, other: float, pair: Floats) -> None:
    """Step (y, x) over ``a`` time constants: x' = -x + white noise of variance 2, y' = x - y.
    Variance of x is 1 in the long run, of y 1/2; the noise of a step has the covariance of the
    exact solution."""
    keep, gone = math.exp(-a), math.exp(-2.0 * a)
    xx, xy = 1.0 - gone, 0.5 - gone * (a + 0.5)
    yy = 0.5 - gone * (a * (a + 1.0) + 0.5)
    y, x = pair[0], pair[1]
    pair[0] = keep * (y + a * x) + xy / math.sqrt(xx) * draw
    pair[0] += math.sqrt(max(yy - xy * xy / xx, 0.0)) * other
    pair[1] = keep * x + math.sqrt(xx) * draw


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
    pose: Floats, surface: Floats, centre: Floats, field: Singles, at: Floats, gap: Floats,
    relaxation: float, springs: Floats, out: Floats,
) -> None:  # fmt: skip
    """(S,) depth of each spring at approach zero, less what has relaxed of it."""
    cos, sin = math.cos(pose[POSE_TURN]), math.sin(pose[POSE_TURN])
    kx, ky = 0.5 * surface[CURVATURE_X], 0.5 * surface[CURVATURE_Y]
    step = surface[FIELD_STEP]
    for j in range(at.shape[0]):
        x = at[j, 0] + springs[BRISTLE_X, j]
        y = at[j, 1] + springs[BRISTLE_Y, j]
        dx, dy = x - pose[POSE_X], y - pose[POSE_Y]
        up = height(field, step, cos * dx + sin * dy, cos * dy - sin * dx)
        wx, wy = x - centre[0], y - centre[1]
        u, v = cos * wx + sin * wy, cos * wy - sin * wx
        out[j] = up - kx * u * u - ky * v * v - gap[j] - relaxation * springs[RELAXED, j]


@njit(cache=True)
def solve_approach(reach: Floats, total_mm: float, start: float) -> float:
    """Approach at which the positive depths reach + approach sum to total_mm > 0.

    The sum rises piecewise linearly and convexly, so Newton steps from the right are exact.
    """
    n = reach.shape[0]
    approach = start
    for k in range(NEWTON_STEPS):
        total = 0.0
        touching = 0
        for j in range(n):
            d = approach + reach[j]
            if d > 0.0:
                total += d
                touching += 1
        if touching == 0 or k == NEWTON_STEPS // 2:
            approach = total_mm / n - reach.min()  # all springs touch: never too shallow
            continue
        change = (total - total_mm) / touching
        approach -= change
        if abs(change) < SAME_MM:
            break
    return approach


@njit(cache=True)
def press(p: Floats, state: Floats, reach: Floats, springs: Floats, normal_n: float) -> None:
    """Share the load normal_n > 0 out over the springs."""
    k = p[K_NORMAL]
    state[APPROACH] = solve_approach(reach, normal_n / k, state[APPROACH])
    phi = p[RELAXATION]
    state[STIFFNESS] = 0.0
    for j in range(reach.shape[0]):
        d = state[APPROACH] + reach[j]
        state[STIFFNESS] += k if d > 0.0 else 0.0
        springs[LOAD, j] = k * d if d > 0.0 else 0.0
        springs[DEPTH, j] = d + phi * springs[RELAXED, j] if d > 0.0 else 0.0


@njit(cache=True)
def drag(
    p: Floats, surface: Floats, at: Floats, dx: float, dy: float, turn: float, keep: float,
    springs: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Carry the bristles along with the surface, which moves by (dx, dy) and turns; those beyond
    their friction slide. Adds to sums (6,): sliding load, and sums of load times slip.
    """
    k, phi = p[K_SHEAR], p[RELAXATION]
    for j in range(at.shape[0]):
        load = springs[LOAD, j]
        if load <= 0.0:
            for c in (BRISTLE_X, BRISTLE_Y, RELAXED_X, RELAXED_Y):
                springs[c, j] = 0.0
            springs[RELAXED, j] *= keep
            springs[SLIDES, j] = 0.0
            continue
        x, y = at[j, 0], at[j, 1]
        bx = springs[BRISTLE_X, j] + dx - turn * y
        by = springs[BRISTLE_Y, j] + dy + turn * x
        ex, ey = bx - phi * springs[RELAXED_X, j], by - phi * springs[RELAXED_Y, j]
        pull = math.sqrt(ex * ex + ey * ey)
        mu = surface[MU_KINETIC] if springs[SLIDES, j] != 0.0 else surface[MU_STATIC]
        springs[SLIDES, j] = 0.0
        if k * pull > mu * load:
            part = 1.0 - surface[MU_KINETIC] * load / (k * pull)
            sx, sy = part * ex, part * ey
            bx -= sx
            by -= sy
            springs[SLIDES, j] = 1.0
            sums[0] += load
            sums[1] += load * sx
            sums[2] += load * sy
            sums[3] += load * (x * sy - y * sx)
        springs[BRISTLE_X, j], springs[BRISTLE_Y, j] = bx, by
        springs[RELAXED, j] += (springs[DEPTH, j] - springs[RELAXED, j]) * (1.0 - keep)
        springs[RELAXED_X, j] += (bx - springs[RELAXED_X, j]) * (1.0 - keep)
        springs[RELAXED_Y, j] += (by - springs[RELAXED_Y, j]) * (1.0 - keep)


@njit(cache=True)
def sliding(at: Floats, springs: Floats, sums: Floats, dt_s: float, state: Floats) -> None:
    """The rigid motion that fits the slip of all loaded springs best, weighted by load: velocity
    at the pad's middle (mm/s) and turning rate (rad/s)."""
    weight, wx, wy, wr = 0.0, 0.0, 0.0, 0.0
    for j in range(at.shape[0]):
        load, x, y = springs[LOAD, j], at[j, 0], at[j, 1]
        weight += load
        wx += load * x
        wy += load * y
        wr += load * (x * x + y * y)
    state[SLIP_X] = state[SLIP_Y] = state[SPIN] = state[SHARE] = 0.0
    if weight <= 0.0:
        return
    mx, my = wx / weight, wy / weight
    spread = wr - weight * (mx * mx + my * my)
    ux, uy = sums[1] / weight, sums[2] / weight
    spin = (sums[3] - mx * sums[2] + my * sums[1]) / spread if spread > 0.0 else 0.0
    state[SLIP_X], state[SLIP_Y], state[SPIN] = ux / dt_s, uy / dt_s, spin / dt_s
    state[SHARE] = sums[4]


@njit(cache=True)
def advance(
    p: Floats, dt_s: float, normal0: Floats, normal1: Floats, motion: Floats, turn: Floats,
    centre0: Floats, centre1: Floats, surfaces: Floats, fields: Singles, at: Floats,
    gaps: Floats, states: Floats, springs: Floats,
) -> None:  # fmt: skip
    """Advance all pads by dt_s > 0. Load and centre go from their first values to their second,
    the surface moves by motion (F, 2) and turns by turn (F,), all linearly. As many inner steps as
    the path needs, so none is longer than STEP_MM unless it would be shorter than STEP_S.
    """
    reach = np.empty(at.shape[0])
    centre = np.empty(2)
    for f in range(states.shape[0]):
        s, own = states[f], springs[f]
        if normal0[f] <= 0.0 and normal1[f] <= 0.0:
            s[POSE_X], s[POSE_Y] = moved(s, motion[f, 0], motion[f, 1], turn[f])
            s[POSE_TURN] += turn[f]
            s[SLIP_X] = s[SLIP_Y] = s[SPIN] = s[SHARE] = 0.0
            own[:, :] = 0.0
            continue
        path = math.hypot(motion[f, 0], motion[f, 1]) + abs(turn[f]) * -at[0, 0]
        steps = math.ceil(min(path / p[STEP_MM], dt_s / p[STEP_S]) - 1e-9)
        steps = max(1, steps)
        h = 1.0 / steps
        keep = math.exp(-dt_s * h / p[RELAXATION_TIME])
        dx, dy, dturn = motion[f, 0] * h, motion[f, 1] * h, turn[f] * h
        sums = np.zeros(5)
        for i in range(steps):
            end = (i + 1.0) * h
            load = normal0[f] + (normal1[f] - normal0[f]) * end
            centre[0] = centre0[f, 0] + (centre1[f, 0] - centre0[f, 0]) * end
            centre[1] = centre0[f, 1] + (centre1[f, 1] - centre0[f, 1]) * end
            s[POSE_X], s[POSE_Y] = moved(s, dx, dy, dturn)
            s[POSE_TURN] += dturn
            sums[0] = 0.0
            if load > 0.0:
                drag(p, surfaces[f], at, dx, dy, dturn, keep, own, sums)
                reaches(s, surfaces[f], centre, fields[f], at, gaps[f], p[RELAXATION], own, reach)
                press(p, s, reach, own, load)
                sums[4] = min(1.0, sums[0] / load)
            else:
                own[:, :] = 0.0
        sliding(at, own, sums, dt_s, s)


@njit(cache=True)
def moved(state: Floats, dx: float, dy: float, turn: float) -> tuple[float, float]:
    """Where the surface's own origin lies after the surface moved by (dx, dy) at the pad's middle
    while turning about it."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = state[POSE_X], state[POSE_Y]
    return cos * x - sin * y + dx, sin * x + cos * y + dy


@njit(cache=True)
def kernel_sums(p: Floats, springs: Floats, at: Floats, taxels: Floats, out: Floats) -> None:
    """Fall of each taxel's code, counts (F, 6), under all springs' loads at their tips.

    A normal load f at distance r gives f * NORMAL_PEAK exp(-r^2 / 2 NORMAL_WIDTH^2) counts; a
    shear load q towards the taxel q * SHEAR_PEAK r exp(-r^2 / 2 SHEAR_WIDTH^2).
    """
    a, b = -0.5 / p[NORMAL_WIDTH] ** 2, -0.5 / p[SHEAR_WIDTH] ** 2
    for f in range(springs.shape[0]):
        own = springs[f]
        for i in range(taxels.shape[0]):
            out[f, i] = 0.0
        for j in range(at.shape[0]):
            load = own[LOAD, j]
            if load <= 0.0:
                continue
            qx = p[K_SHEAR] * (own[BRISTLE_X, j] - p[RELAXATION] * own[RELAXED_X, j])
            qy = p[K_SHEAR] * (own[BRISTLE_Y, j] - p[RELAXATION] * own[RELAXED_Y, j])
            for i in range(taxels.shape[0]):
                x = taxels[i, 0] - at[j, 0] - own[BRISTLE_X, j]
                y = taxels[i, 1] - at[j, 1] - own[BRISTLE_Y, j]
                rr = x * x + y * y
                if a * rr > NEGLIGIBLE:
                    out[f, i] += load * p[NORMAL_PEAK] * math.exp(a * rr)
                    out[f, i] += (qx * x + qy * y) * p[SHEAR_PEAK] * math.exp(b * rr)
