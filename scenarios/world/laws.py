"""Compiled contact laws, levels L1, L3 and L4: one object between three fingers, one state vector.

Numba's cache does not detect changes in an imported kernel, so all kernels are in this file.

Normal forces: finger, pad and object wall are linear springs in series, with one relaxation term
per finger (rubber, Prony form). The object is free along the closing axis x, so the thumb carries
the sum of the other two (quasi-static balance). After an impact along x the object has inertia
there, m x'' = push - N_A + N_B + N_C, and each finger's spring has a parallel damper. The table
below the object pushes but does not pull; while it pushes, the object neither turns nor slides.

Friction: a pad is one or more elements, each a Kelvin-Voigt spring behind a friction limit (Jenkins
element). L1: one point per finger, motion along z, and without rotation along y after an impact
from the side. L3: one point per finger, with rotation and a third spring for the patch's spin
(ellipsoid limit surface |(f_y, f_z, tau / a)| <= mu N). L4: a grid of points.

The backward Euler step minimizes a strictly convex function: inertia is quadratic, and an
element's radial return is the slope of a Huber function. So Newton's method with a bracketing line
search cannot cycle at any step or stiffness. Along z alone the balance is linear between six break
points and is solved exactly. Friction limits and lever arms are those at the start of a step.

Signs: y across the closing axis, along an impact from the side; z up; rotation from y to z.
``slip`` is the rise of the fingers relative to the object, ``across`` the object's displacement
along y relative to them, both at the centre of the grip.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.numba_cache import compiled
from scenarios.world.settings import GRAVITY_MPS2

FINGERS = 3
Floats = NDArray[np.float64]

# Layout of the state: one flat array, because a compiled call then takes a single object.
(
    HEIGHT, SPEED, SLIP, LATERAL, ONSET_S, SLIP_SPEED, SLOPE, ONSET_FORCE, RISE_S, PRESENT,
    TAP_START_S, TAP_S, TAP_N_S, TAP_DIRECTION, TAP_OFFSET, FOLLOW_S, FOLLOW_N_S,
    MOVED_FROM_S, MOVED_UNTIL_S,  # gross slip since the last impact: first and last instant
    ACROSS, ACROSS_SPEED, TURN, TURN_RATE,
    SPIN,  # the turning rate while at most one pad sticks, else 0
    COM_ACROSS, COM_RISE,  # displacement of the centre of mass relative to the hand
    PULL_START_S, PULL_N, PULL_RAMP_S, PULL_S,  # a steady pull down: ramp, full force, ramp
    HAS_INERTIA, LATERAL_SPEED,  # 1 while the object has inertia along x; dx/dt then
) = range(32)  # fmt: skip
# Per finger. COMPRESSION of its spring is used while HAS_INERTIA; STIFFNESS is dN/dtravel with the
# other fingers at rest.
RELAXED, NORMAL, SHEAR, PEAK, COMPRESSION, STIFFNESS = 32, 35, 38, 41, 44, 47
STATE_SIZE = STIFFNESS + FINGERS
# Columns of the elements (E, 9): position on the pads, spin radius, share of the finger's force,
# finger, 1 while it slides, stretch along y, z and rotation.
E_Y, E_Z, E_SPIN, E_SHARE, E_FINGER, E_SLIDES, E_STRETCH_Y, E_STRETCH_Z, E_STRETCH_TURN = range(9)
ELEMENT_SIZE = 9
# Layout of the parameters.
(
    P_MASS, P_MU_S, P_MU_K, P_K_SHEAR, P_C_SHEAR, P_RELAX, P_TAU, P_APERTURE, P_PAD_HALF,
    P_SHAPE, P_HALF_WIDTH, P_HALF_HEIGHT, P_GRIP_HEIGHT, P_BODY_TOP, P_STIFFNESS,
) = range(15)  # fmt: skip
P_GROSS_SLIP, P_FORCE_RISE, P_GROSS_TURN = 18, 19, 20
P_INERTIA, P_COM_Y, P_COM_Z, P_LEVEL, P_IMPACT_STEP, P_LOSS, P_TABLE = 21, 22, 23, 24, 25, 26, 27
PARAMETER_SIZE = 28
NOT_YET = -1.0
TOP, SIDE, CLOSING = 0, 1, 2  # impact downwards; across; along the closing axis, onto the thumb
IMPACT_LASTS_S = 0.3  # time from an impact's start with finer steps
IN_THE_AIR_M = 100.0  # height of an object without a table below it
NEWTON_LIMIT = 60
# Columns of the work array of a planar step (E, 8): the element's force with the object at rest,
# loss per m/s, friction limit, position from the centre of mass, spin radius.
W_Y, W_Z, W_TURN, W_LOSS, W_CAP, W_ARM_Y, W_ARM_Z, W_SPIN = range(8)
SLIDER = 1.0  # value of P_LEVEL; higher levels model rotation


# For functions that only compiled code calls. A wrapper for Python, or for a short function a
# compilation of its own, would take longer to compile than the function.
inner = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)  # type: ignore[call-overload]
inlined = njit(inline="always")


@compiled()
def width_and_slope(p: Floats, slip: float) -> tuple[float, float]:
    """Half width (m) of the object at a flat pad after sliding by ``slip``, and its slope dw/du.

    A flat pad touches the widest point of a ball until the pad's edge has passed it; then the edge
    touches the falling flank. A width of -1 means that the object has left the grip.
    """
    if p[P_SHAPE] == 0.0:
        return (p[P_HALF_WIDTH], 0.0) if slip < p[P_BODY_TOP] else (-1.0, 0.0)
    u = p[P_GRIP_HEIGHT] + slip
    beyond = abs(u) - p[P_PAD_HALF]
    if beyond <= 0.0:
        return p[P_HALF_WIDTH], 0.0
    ratio = beyond / p[P_HALF_HEIGHT]
    if ratio >= 1.0:
        return -1.0, 0.0
    width = p[P_HALF_WIDTH] * math.sqrt(1.0 - ratio * ratio)
    slope = -(p[P_HALF_WIDTH] ** 2) * ratio / (p[P_HALF_HEIGHT] * width)
    return width, slope if u > 0.0 else -slope


@inlined
def centre_on_pad(p: Floats, slip: float) -> float:
    """Position of the object's widest point on the pads, m above their centre; 0 if straight."""
    if p[P_SHAPE] == 0.0:
        return 0.0
    above = -(p[P_GRIP_HEIGHT] + slip)
    centre: float = min(max(above, -p[P_PAD_HALF]), p[P_PAD_HALF])
    return centre


@inlined
def _free_compressions(p: Floats, width: float, travel: Floats, state: Floats, out: Floats) -> None:
    """Compression of each finger's spring (3,), m, into ``out``, at lateral position zero: wall
    minus pad surface minus relaxation. An edge compresses closed fingers that come down on it only
    as far as they have come."""
    deep = p[P_BODY_TOP] - state[SLIP]
    if p[P_SHAPE] != 0.0:
        deep = p[P_HALF_HEIGHT] + p[P_PAD_HALF] - abs(p[P_GRIP_HEIGHT] + state[SLIP])
    on_edge = False
    for i in range(FINGERS):
        out[i] = width - (p[P_APERTURE] - travel[i])
        on_edge |= out[i] + (state[LATERAL] if i == 0 else -state[LATERAL]) > deep
    for i in range(FINGERS):
        out[i] = (min(out[i], deep) if on_edge else out[i]) - p[P_RELAX] * state[RELAXED + i]


@inlined
def table_hold(p: Floats, s: Floats) -> float:
    """Greatest force along the closing axis, N, that the friction of the table takes: its share of
    the weight that the pads do not carry yet."""
    if p[P_TABLE] == 0.0 or s[HEIGHT] > 0.0:
        return 0.0
    carried = abs(s[SHEAR] + s[SHEAR + 1] + s[SHEAR + 2])
    hold: float = p[P_TABLE] * max(0.0, p[P_MASS] * GRAVITY_MPS2 - carried)
    return hold


@inlined
def _imbalance(k: Floats, free: Floats, at: float) -> float:
    """N_A - N_B - N_C, N, of an object at this lateral position; ``free``: compressions at zero."""
    force: float = k[0] * max(0.0, free[0] + at)
    for i in range(1, FINGERS):
        force -= k[i] * max(0.0, free[i] - at)
    return force


@inlined
def _lateral_with(k: Floats, free: Floats, total: float) -> float:
    """The lateral position at which the imbalance is ``total``, N, not zero: between the positions
    at which the pads touch the imbalance is linear, and it only rises."""
    low, high = -np.inf, np.inf
    for i in range(FINGERS):
        at = -free[0] if i == 0 else free[i]
        if _imbalance(k, free, at) <= total:
            low = max(low, at)
        else:
            high = min(high, at)
    stiffness, force = 0.0, total
    for i in range(FINGERS):
        if (-free[0] <= low) if i == 0 else (free[i] >= high):
            stiffness += k[i]
            force += -k[0] * free[0] if i == 0 else k[i] * free[i]
    return force / stiffness


@compiled()
def normal_forces(p: Floats, width: float, travel: Floats, state: Floats, out: Floats) -> None:
    """Normal force of each finger (3,), N, into ``out``; the lateral position into the state.

    The balance N_A = N_B + N_C is piecewise linear in the lateral position; of B and C the one
    with the smaller compression loses contact first. On the table, friction holds the object
    where it is until the fingers' imbalance exceeds it.
    """
    _free_compressions(p, width, travel, state, out)
    if width < 0.0:
        out[:] = 0.0
        return
    k = p[P_STIFFNESS:]
    hold = table_hold(p, state)
    if hold > 0.0:
        at = state[LATERAL]
        excess = _imbalance(k, out, at)
        if abs(excess) > hold:
            at = _lateral_with(k, out, math.copysign(hold, excess))
            state[LATERAL] = at
        out[0] = k[0] * max(0.0, out[0] + at)
        for i in range(1, FINGERS):
            out[i] = k[i] * max(0.0, out[i] - at)
        return
    far, near = (1, 2) if out[1] >= out[2] else (2, 1)
    thumb = k[0] * out[0]
    lateral = (k[far] * out[far] + k[near] * out[near] - thumb) / (k[0] + k[far] + k[near])
    if out[near] <= lateral:
        lateral = (k[far] * out[far] - thumb) / (k[0] + k[far])
        if out[far] <= lateral:
            lateral = -thumb / k[0]
    if out[0] + lateral <= 0.0:
        out[:] = 0.0
        return
    state[LATERAL] = lateral
    out[0] = k[0] * (out[0] + lateral)
    for i in range(1, FINGERS):
        out[i] = max(0.0, k[i] * (out[i] - lateral))


@compiled()
def inertial_normal_forces(
    p: Floats, s: Floats, h: float, width: float, travel: Floats, push: float, out: Floats
) -> None:
    """As ``normal_forces``, after a step of h seconds of an object with inertia along the closing
    axis, pushed onto the thumb by ``push``, N; its speed and spring compressions into the state.

    A pad out of contact recovers at its damper's rate, compression x tau / (h + tau), and presses
    again once the wall meets it, so it never pulls. Its force (k + k tau / h) max(0, wall - pad)
    is the slope of a convex function of the object's position, and so is the inertia. The root is
    unique, and exact between the positions at which the three pads touch.
    """
    tau = p[P_LOSS]
    _free_compressions(p, width, travel, s, out)
    if width < 0.0:
        out[:], s[LATERAL_SPEED] = 0.0, 0.0
        return
    inertia = p[P_MASS] / (h * h)
    slope, total = inertia, push + inertia * (s[LATERAL] + h * s[LATERAL_SPEED])
    low, high = -np.inf, np.inf  # bounds of x, from the positions at which a pad touches
    for i in range(FINGERS):
        out[i] -= s[COMPRESSION + i] * tau / (h + tau)  # of the wall beyond the free pad, at x = 0
    for i in range(FINGERS):
        at = -out[0] if i == 0 else out[i]
        rest = total - inertia * at
        for j in range(FINGERS):
            side = -1.0 if j == 0 else 1.0
            rest += side * p[P_STIFFNESS + j] * (1.0 + tau / h) * max(0.0, out[j] - side * at)
        if rest >= 0.0:  # the new position is beyond this one
            low = max(low, at)
        else:
            high = min(high, at)
    for i in range(FINGERS):
        side = -1.0 if i == 0 else 1.0
        if (-out[0] <= low) if i == 0 else (out[i] >= high):
            k = p[P_STIFFNESS + i] * (1.0 + tau / h)
            slope += k
            total += side * k * out[i]
    lateral = total / slope
    if s[HEIGHT] == 0.0 and lateral <= -out[0] and lateral >= max(out[1], out[2]):
        lateral = s[LATERAL]  # the table holds an object that no finger touches
    s[LATERAL_SPEED] = (lateral - s[LATERAL]) / h
    s[LATERAL] = lateral
    for i in range(FINGERS):
        beyond = max(0.0, out[i] + lateral if i == 0 else out[i] - lateral)
        out[i] = p[P_STIFFNESS + i] * (1.0 + tau / h) * beyond
        s[COMPRESSION + i] = s[COMPRESSION + i] * tau / (h + tau) + beyond


@compiled()
def clearance(p: Floats, s: Floats, travel: Floats) -> float:
    """Sum of the gaps of the thumb and of the nearest opposing finger to the object, m, or the
    smaller one where the table holds it; 0 while a finger touches it."""
    if max(s[NORMAL], s[NORMAL + 1], s[NORMAL + 2]) > 0.0:
        return 0.0
    width, _ = width_and_slope(p, s[SLIP])
    if s[PRESENT] == 0.0 or width < 0.0:
        return np.inf
    open_m, others = p[P_APERTURE] - width, max(travel[1], travel[2])
    if table_hold(p, s) > 0.0:  # it stays where it is
        nearest: float = min(open_m - travel[0] - s[LATERAL], open_m - others + s[LATERAL])
        return nearest
    gap: float = 2 * open_m - travel[0] - others
    return gap


@compiled()
def normal_stiffness(p: Floats, forces: Floats, inertia: float, out: Floats) -> None:
    """dN_i/dtravel_i (3,), N/m, into ``out``, the other fingers at rest and the object free along
    x; ``inertia`` is m / h^2, N/m."""
    total = inertia
    for i in range(FINGERS):
        if forces[i] > 0.0:
            total += p[P_STIFFNESS + i]
    for i in range(FINGERS):
        k = p[P_STIFFNESS + i]
        out[i] = k * (1.0 - k / total) if forces[i] > 0.0 else 0.0


@inlined
def _residual_vertical(
    v: float, inertia: float, push: float, a: Floats, b: float, cap: Floats
) -> float:
    """inertia * v + push - sum of finger forces at object velocity v; strictly increasing in v."""
    r = inertia * v + push
    for i in range(FINGERS):
        r -= min(max(a[i] - b * v, -cap[i]), cap[i])
    return r


@compiled()
def solve_vertical(inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    """Root of the residual: with all pads sticking if that is consistent, else bracketed between
    its six break points, where it is linear."""
    total, slope = -push, inertia
    for i in range(FINGERS):
        total += a[i]
        slope += b
    v = total / slope
    sticking = True
    for i in range(FINGERS):
        sticking = sticking and abs(a[i] - b * v) <= cap[i]
    if not sticking:
        v = _solve_bracketed(inertia, push, a, b, cap)
    return v


@inner
def _solve_bracketed(inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    low, high = -np.inf, np.inf
    for i in range(FINGERS):
        for side in (-1.0, 1.0):
            v = (a[i] + side * cap[i]) / b
            if not low < v < high:
                continue
            r = _residual_vertical(v, inertia, push, a, b, cap)
            if r <= 0.0:
                low = max(low, v)
            if r >= 0.0:
                high = min(high, v)
    if low == high:
        return low
    inside = 0.5 * (low + high)
    if low == -np.inf:
        inside = high - 1.0
    elif high == np.inf:
        inside = low + 1.0
    total, slope = -push, inertia
    for i in range(FINGERS):
        trial = a[i] - b * inside
        if abs(trial) > cap[i]:
            total += math.copysign(cap[i], trial)
        else:
            total += a[i]
            slope += b
    return total / slope


@inner
def _residual(
    v: Floats, inertia: Floats, push: Floats, work: Floats, r: Floats, hessian: Floats
) -> None:
    """Slope ``r`` (3,) and curvature ``hessian`` (3, 3) at object velocity v = (y, z, turn)."""
    hessian[:] = 0.0
    for d in range(3):
        r[d] = inertia[d] * v[d] + push[d]
        hessian[d, d] = inertia[d]
    for e in range(work.shape[0]):
        b, cap = work[e, W_LOSS], work[e, W_CAP]
        y, z, spin = work[e, W_ARM_Y], work[e, W_ARM_Z], work[e, W_SPIN]
        f0 = work[e, W_Y] - b * (v[0] - v[2] * z)
        f1 = work[e, W_Z] - b * (v[1] + v[2] * y)
        f2 = work[e, W_TURN] - b * spin * v[2]
        square = f0 * f0 + f1 * f1 + f2 * f2
        across = b
        if square > cap * cap:  # across * (1 - n n'), transformed by the lever arms
            shrink = cap / math.sqrt(square)
            across = b * shrink
            f0, f1, f2 = f0 * shrink, f1 * shrink, f2 * shrink
            if cap > 0.0:
                n0, n1, n2 = f0 / cap, f1 / cap, f2 / cap
                turn = y * n1 - z * n0 + spin * n2
                hessian[0, 0] -= across * n0 * n0
                hessian[1, 1] -= across * n1 * n1
                hessian[0, 1] -= across * n0 * n1
                hessian[0, 2] -= across * n0 * turn
                hessian[1, 2] -= across * n1 * turn
                hessian[2, 2] -= across * turn * turn
        r[0] -= f0
        r[1] -= f1
        r[2] -= y * f1 - z * f0 + spin * f2
        hessian[0, 0] += across
        hessian[1, 1] += across
        hessian[0, 2] -= across * z
        hessian[1, 2] += across * y
        hessian[2, 2] += across * (y * y + z * z + spin * spin)


@inlined
def _newton_direction(r: Floats, h: Floats, d: Floats) -> None:
    """d = -h^-1 r for the symmetric positive definite h (3, 3), upper half given."""
    l00 = math.sqrt(h[0, 0])
    l10, l20 = h[0, 1] / l00, h[0, 2] / l00
    l11 = math.sqrt(h[1, 1] - l10 * l10)
    l21 = (h[1, 2] - l20 * l10) / l11
    l22 = math.sqrt(h[2, 2] - l20 * l20 - l21 * l21)
    x0 = -r[0] / l00
    x1 = (-r[1] - l10 * x0) / l11
    x2 = (-r[2] - l20 * x0 - l21 * x1) / l22
    d[2] = x2 / l22
    d[1] = (x1 - l21 * d[2]) / l11
    d[0] = (x0 - l10 * d[1] - l20 * d[2]) / l00


@inner
def solve_planar(v: Floats, inertia: Floats, push: Floats, work: Floats, small: Floats) -> int:
    """Root of the residual into v (3,), which holds the initial guess; work (E, 8) has the columns
    W_*, small (6, 3) is scratch. Returns the number of iterations."""
    r, d, trial, hessian = small[0], small[1], small[2], small[3:6]
    _residual(v, inertia, push, work, r, hessian)
    scale = 0.0
    for e in range(work.shape[0]):
        scale += work[e, W_CAP]
    scale += math.sqrt(push[0] ** 2 + push[1] ** 2) + inertia[1] * 1e-6
    length = math.sqrt(inertia[2] / inertia[1])
    for k in range(NEWTON_LIMIT):
        size = math.sqrt(r[0] ** 2 + r[1] ** 2 + (r[2] / length) ** 2)
        if size <= 1e-11 * scale:
            return k
        _newton_direction(r, hessian, d)
        before = r[0] * d[0] + r[1] * d[1] + r[2] * d[2]
        low, high, step = 0.0, np.inf, 1.0
        for _ in range(40):
            for i in range(3):
                trial[i] = v[i] + step * d[i]
            _residual(trial, inertia, push, work, r, hessian)
            slope = r[0] * d[0] + r[1] * d[1] + r[2] * d[2]
            if abs(slope) <= 0.9 * abs(before):
                break
            if slope > 0.0:
                high = step
            else:
                low = step
            step = 0.5 * (low + high) if high < np.inf else 2.0 * step
        for i in range(3):
            v[i] = trial[i]
    return NEWTON_LIMIT


@inlined
def _half_sine(since_s: float, duration_s: float, impulse_n_s: float) -> float:
    """Impulse delivered so far by a half-sine pulse, N s; 0 for one without duration."""
    if duration_s <= 0.0:
        return 0.0
    phase = min(max(since_s / duration_s, 0.0), 1.0)
    return 0.5 * impulse_n_s * (1.0 - math.cos(math.pi * phase))


@inlined
def tap_force(s: Floats, t_s: float, h: float) -> float:
    """Mean force, N, of the mallet from t_s over h seconds, so that steps preserve its impulse: a
    half sine of TAP_N_S, then a longer one of FOLLOW_N_S while the hand follows through."""
    carried = 0.0
    for end, sign in ((t_s + h, 1.0), (t_s, -1.0)):
        since = end - s[TAP_START_S]
        carried += sign * _half_sine(since, s[TAP_S], s[TAP_N_S])
        carried += sign * _half_sine(since - s[TAP_S], s[FOLLOW_S], s[FOLLOW_N_S])
    return carried / h


@inlined
def pull_force(s: Floats, t_s: float) -> float:
    """Force, N, of the steady pull at time t_s."""
    since, ramp_s = t_s - s[PULL_START_S], s[PULL_RAMP_S]
    if s[PULL_N] == 0.0 or since <= 0.0:
        return 0.0
    left = 2 * ramp_s + s[PULL_S] - since
    return float(s[PULL_N] * min(1.0, since / ramp_s, max(0.0, left / ramp_s)))


@inner
def _step_vertical(
    p: Floats, s: Floats, e: Floats, h: float, v_hand: float, cos: float, push: float, n: Floats,
    a: Floats, cap: Floats,
) -> float:  # fmt: skip
    """Vertical step of L1 without an impact from the side: updates the elements, returns the
    object's velocity upwards."""
    b = (p[P_K_SHEAR] * h + p[P_C_SHEAR]) * cos
    for i in range(FINGERS):
        mu = p[P_MU_K] if e[i, E_SLIDES] != 0.0 else p[P_MU_S]
        cap[i] = mu * n[i] * cos
        touching = 1.0 if n[i] > 0.0 else 0.0
        a[i] = touching * p[P_K_SHEAR] * e[i, E_STRETCH_Z] * cos + b * v_hand
    v: float = solve_vertical(p[P_MASS] / h, push, a, b, cap)
    if s[HEIGHT] + h * v < 0.0:
        v = -s[HEIGHT] / h  # the table
    damper = p[P_C_SHEAR] / h
    for i in range(FINGERS):
        trial = a[i] - b * v
        force = min(max(trial, -cap[i]), cap[i])
        slides = n[i] > 0.0 and abs(trial) > cap[i]
        old = e[i, E_STRETCH_Z]
        if n[i] <= 0.0:
            e[i, E_STRETCH_Z] = 0.0
        elif slides:
            e[i, E_STRETCH_Z] = (force / cos + damper * old) / (p[P_K_SHEAR] + damper)
        else:
            e[i, E_STRETCH_Z] += h * (v_hand - v)
        e[i, E_SLIDES] = 1.0 if slides else 0.0
        s[SHEAR + i] = force
    return v


@inner
def _step_planar(
    p: Floats, s: Floats, e: Floats, h: float, v_hand: float, cos: float, push: float,
    force_y: float, torque: float, n: Floats, work: Floats, small: Floats,
) -> None:  # fmt: skip
    """Planar step of L3 and L4, and of L1 without rotation: velocity (y, z, turn) into small[6].
    ``torque`` of the impact is about the centre of mass."""
    v, inertia, load = small[6], small[7], small[8]
    turns = 1.0 if p[P_LEVEL] > SLIDER else 0.0
    com_y, com_z = p[P_COM_Y] + s[COM_ACROSS], p[P_COM_Z] + s[COM_RISE]
    b = (p[P_K_SHEAR] * h + p[P_C_SHEAR]) * cos
    for j in range(e.shape[0]):
        force, share = n[int(e[j, E_FINGER])], e[j, E_SHARE]
        work[j, W_ARM_Y] = turns * (e[j, E_Y] - com_y)
        work[j, W_ARM_Z] = turns * (e[j, E_Z] - com_z)
        work[j, W_SPIN] = e[j, E_SPIN]
        mu = p[P_MU_K] if e[j, E_SLIDES] != 0.0 else p[P_MU_S]
        work[j, W_CAP] = mu * force * share * cos
        work[j, W_LOSS] = b * share
        stiff = p[P_K_SHEAR] * share * cos if force > 0.0 else 0.0
        for d in range(3):
            work[j, W_Y + d] = stiff * e[j, E_STRETCH_Y + d]
        work[j, W_Z] += b * share * v_hand
    inertia[0] = inertia[1] = p[P_MASS] / h
    inertia[2] = p[P_INERTIA] / h
    v[0], v[1], v[2] = s[ACROSS_SPEED], s[SPEED], s[TURN_RATE]
    load[0] = -inertia[0] * v[0] - force_y
    load[1] = push
    load[2] = -inertia[2] * v[2] - turns * torque
    solve_planar(v, inertia, load, work, small)
    if s[HEIGHT] + h * v[1] < 0.0:
        v[0], v[1], v[2] = 0.0, -s[HEIGHT] / h, 0.0  # the table


@inner
def _update_elements(
    p: Floats, s: Floats, e: Floats, h: float, v: Floats, n: Floats, work: Floats, sticking: Floats
) -> None:
    """Update the elements at the end of a planar step; the sticking share of each finger's force
    into ``sticking`` (3,), its shear force upwards into the state."""
    damper = p[P_C_SHEAR] / h
    gain = p[P_K_SHEAR] * h + p[P_C_SHEAR]
    sticking[:] = 0.0
    s[SHEAR : SHEAR + FINGERS] = 0.0
    for j in range(e.shape[0]):
        finger, b, cap = int(e[j, E_FINGER]), work[j, W_LOSS], work[j, W_CAP]
        y, z, spin = work[j, W_ARM_Y], work[j, W_ARM_Z], work[j, W_SPIN]
        f0 = work[j, W_Y] - b * (v[0] - v[2] * z)
        f1 = work[j, W_Z] - b * (v[1] + v[2] * y)
        f2 = work[j, W_TURN] - b * spin * v[2]
        size = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
        slides = size > cap and cap > 0.0
        e[j, E_SLIDES] = 1.0 if slides else 0.0
        if cap == 0.0:
            e[j, E_STRETCH_Y] = e[j, E_STRETCH_Z] = e[j, E_STRETCH_TURN] = 0.0
            continue
        shrink = cap / size if slides else 1.0
        sticking[finger] += 0.0 if slides else e[j, E_SHARE]
        s[SHEAR + finger] += shrink * f1
        back = shrink * gain / b  # converts an element's force to that of a whole pad
        stiff = p[P_K_SHEAR] + damper
        e[j, E_STRETCH_Y] = (f0 * back + damper * e[j, E_STRETCH_Y]) / stiff
        e[j, E_STRETCH_Z] = (f1 * back + damper * e[j, E_STRETCH_Z]) / stiff
        e[j, E_STRETCH_TURN] = (f2 * back + damper * e[j, E_STRETCH_TURN]) / stiff


@inlined
def _relax(p: Floats, s: Floats, h: float, n: Floats) -> None:
    for i in range(FINGERS):
        s[NORMAL + i] = n[i]
        s[PEAK + i] = max(s[PEAK + i], n[i])
        if n[i] > 0.0:
            compression = n[i] / p[P_STIFFNESS + i] + p[P_RELAX] * s[RELAXED + i]
            s[RELAXED + i] += (compression - s[RELAXED + i]) * h / (h + p[P_TAU])
        else:
            s[RELAXED + i] *= p[P_TAU] / (h + p[P_TAU])


@inlined
def _move_vertical(s: Floats, e: Floats, h: float, v_hand: float, v: float, n: Floats) -> None:
    """Update the object's position and slip speed at the end of a vertical step."""
    relative = v_hand - v
    all_slide, touching = True, False
    for i in range(FINGERS):
        if n[i] > 0.0:
            touching = True
            all_slide = all_slide and e[i, E_SLIDES] != 0.0
    s[HEIGHT] = max(0.0, s[HEIGHT] + h * v)
    s[SPEED] = v
    s[SLIP] += h * relative
    s[COM_RISE] -= h * relative
    s[SLIP_SPEED] = relative if all_slide and touching else 0.0


@inlined
def _move_planar(
    p: Floats, s: Floats, h: float, v_hand: float, v: Floats, n: Floats, sticking: Floats
) -> None:
    """Update the object's position and slip speed at the end of a planar step. A pad sticks if most
    of its force does; the object can turn about one sticking pad, not about two."""
    up = v[1] - v[2] * (p[P_COM_Y] + s[COM_ACROSS])  # at the centre of the grip
    aside = v[0] + v[2] * (p[P_COM_Z] + s[COM_RISE])
    holding, touching = 0, 0
    for i in range(FINGERS):
        if n[i] > 0.0:
            touching += 1
            holding += 1 if sticking[i] > 0.5 else 0
    s[HEIGHT] = max(0.0, s[HEIGHT] + h * v[1])
    s[ACROSS_SPEED], s[SPEED], s[TURN_RATE] = v[0], v[1], v[2]
    s[SLIP] += h * (v_hand - up)
    s[ACROSS] += h * aside
    s[TURN] += h * v[2]
    s[COM_ACROSS] += h * v[0]
    s[COM_RISE] += h * (v[1] - v_hand)
    s[SLIP_SPEED] = math.hypot(v_hand - up, aside) if touching > 0 and holding == 0 else 0.0
    s[SPIN] = v[2] if touching > 0 and holding < 2 else 0.0


@compiled()
def step(
    p: Floats, s: Floats, e: Floats, h: float, v_hand: float, travel: Floats, impact: Floats,
    n: Floats, work: Floats, small: Floats,
) -> None:  # fmt: skip
    """One backward Euler step of h seconds. ``impact`` (4,): force along y, z and the closing axis
    onto the thumb, N (the last only while HAS_INERTIA); torque about the grip's centre, N m."""
    out_of_grip = s[PRESENT] == 0.0 or abs(s[ACROSS]) > p[P_HALF_WIDTH]
    width, slope = (-1.0, 0.0) if out_of_grip else width_and_slope(p, s[SLIP])
    if s[HAS_INERTIA] == 0.0:
        normal_forces(p, width, travel, s, n)
    else:
        inertial_normal_forces(p, s, h, width, travel, impact[2], n)
    cos = 1.0 / math.sqrt(1.0 + slope * slope)
    push = p[P_MASS] * (GRAVITY_MPS2 - s[SPEED] / h) - impact[1]
    for i in range(FINGERS):
        push -= n[i] * slope  # above the widest point (slope < 0) the grip pushes the object down
    if p[P_LEVEL] == SLIDER and s[ACROSS_SPEED] == 0.0 and impact[0] == 0.0:
        v = _step_vertical(p, s, e, h, v_hand, cos, push, n, small[0], small[1])
        _move_vertical(s, e, h, v_hand, v, n)
    else:
        torque = impact[3] - p[P_COM_Y] * impact[1] + p[P_COM_Z] * impact[0]
        _step_planar(p, s, e, h, v_hand, cos, push, impact[0], torque, n, work, small)
        _update_elements(p, s, e, h, small[6], n, work, small[0])
        _move_planar(p, s, h, v_hand, small[6], n, small[0])
    _relax(p, s, h, n)
    if n[0] > 0.0 or n[1] > 0.0 or n[2] > 0.0:
        s[SLOPE] = slope


@inlined
def _record_events(p: Floats, s: Floats, t_s: float) -> None:
    """Record the onset of gross slip, the force rise after it, and motion after an impact."""
    gross = abs(s[SLIP_SPEED]) > p[P_GROSS_SLIP] or abs(s[SPIN]) > p[P_GROSS_TURN]
    if s[ONSET_S] == NOT_YET and gross:
        s[ONSET_S] = t_s
        s[ONSET_FORCE] = s[NORMAL]
    elif s[ONSET_S] != NOT_YET and s[RISE_S] == NOT_YET:
        s[ONSET_FORCE] = min(s[ONSET_FORCE], s[NORMAL])
        if s[NORMAL] > s[ONSET_FORCE] + p[P_FORCE_RISE]:
            s[RISE_S] = t_s
    if gross and s[TAP_S] > 0.0 and t_s >= s[TAP_START_S]:
        s[MOVED_FROM_S] = t_s if s[MOVED_FROM_S] == NOT_YET else s[MOVED_FROM_S]
        s[MOVED_UNTIL_S] = t_s


@inlined
def _external_forces(s: Floats, t_s: float, h: float, out: Floats) -> None:
    """Forces of mallet and pull in a step of h seconds from t_s, as ``step`` expects them."""
    force = tap_force(s, t_s, h)
    out[:] = 0.0
    if s[TAP_DIRECTION] == CLOSING:
        out[2] = force
    elif s[TAP_DIRECTION] == SIDE:
        out[0], out[3] = force, -force * s[TAP_OFFSET]
    else:
        out[1], out[3] = -force, -force * s[TAP_OFFSET]
    out[1] -= pull_force(s, t_s + 0.5 * h)


@compiled()
def advance(
    p: Floats, s: Floats, e: Floats, t_s: float, dt_s: float, step_s: float,
    finger_rise_m: float, v0: float, v1: float, travel0: Floats, travel1: Floats,
) -> None:  # fmt: skip
    """Advance state and elements by dt_s. The fingers rise by finger_rise_m with speeds v0 -> v1 at
    the ends and close from travel0 to travel1 (3,), m. Nothing changes without an object.

    Records the onset of gross slip: the first instant at which every touching pad slides faster
    than 3 mm/s, or the object turns faster than 0.2 rad/s with at most one sticking pad. After it,
    records the first rise of the thumb's force.
    """
    if s[PRESENT] == 0.0:
        return
    tapped = s[TAP_S] > 0.0
    since_impact = t_s + dt_s - s[TAP_START_S] if tapped else -1.0
    if 0.0 < since_impact < IMPACT_LASTS_S + dt_s:
        step_s = min(step_s, p[P_IMPACT_STEP])
    steps = max(1, math.ceil(dt_s / step_s - 1e-9))
    h = dt_s / steps
    mean = finger_rise_m / dt_s
    travel, n, impact = np.empty(FINGERS), np.empty(FINGERS), np.empty(4)
    impact[:] = 0.0  # np.zeros takes longer to compile
    work, small = np.empty((e.shape[0], 8)), np.empty((9, 3))
    for j in range(steps):
        middle = (j + 0.5) / steps
        end = (j + 1.0) / steps
        for i in range(FINGERS):
            travel[i] = travel0[i] + (travel1[i] - travel0[i]) * end
        if tapped or s[PULL_N] != 0.0:
            _external_forces(s, t_s + j * h, h, impact)
        v_hand = mean + (v1 - v0) * (middle - 0.5)
        step(p, s, e, h, v_hand, travel, impact, n, work, small)
        _record_events(p, s, t_s + (j + 1) * h)
    inertia = s[HAS_INERTIA] * p[P_MASS] / dt_s**2
    if abs(n[0] - n[1] - n[2]) < table_hold(p, s):
        inertia = np.inf  # the table holds the object
    normal_stiffness(p, n, inertia, s[STIFFNESS:])


@compiled()
def surface_motion(
    p: Floats, s: Floats, angle: float, up: Floats, across: Floats, places: Floats, turns: Floats,
    motion_mm: Floats, turn: Floats, centre_mm: Floats,
) -> None:  # fmt: skip
    """Surface motion in the pads' frames: motion (F, 2), mm, and angle (F,), rad, at each pad's
    centre, at ``places`` (F,), m, across; centre (F, 2), mm, of a curved surface. Upwards is at
    ``angle`` from a pad's x; ``up`` and ``across`` (F, 2) and ``turns`` (F,) are its frame."""
    middle = centre_on_pad(p, s[SLIP])
    for i in range(FINGERS):
        rise = s[TURN] * places[i] - s[SLIP]  # the object lags behind rising fingers
        for d in range(2):
            motion_mm[i, d] = (s[ACROSS] * across[i, d] + rise * up[i, d]) * 1e3
            centre_mm[i, d] = middle * up[i, d] * 1e3
        turn[i] = angle + turns[i] * s[TURN]
