"""Levels L1 to L4: an object on compliant pads, along the lift or in the plane. One state layout.

A pad is one or more elements, each a Kelvin-Voigt spring behind a friction limit: L2 has one point
a finger, L3 one point whose third spring is the patch's spin (the ellipsoid limit surface
|(f_y, f_z, tau / a)| <= mu N), L4 a grid of points that share the pad's force (the reference).

The backward Euler step is the minimum of a strictly convex function: inertia is quadratic, and an
element's radial return is the slope of a Huber function. So Newton with a line search that never
leaves the bracket cannot cycle, whatever step and stiffness. L1 moves along z only, so its balance
is piecewise linear and solved exactly between the break points. Limits (static or kinetic friction)
and lever arms are those at the start of a step.
"""

import math

import numpy as np
from numba import njit

from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats

# State: pose of the object (its centre of mass) and of the hand since the start, speeds, forces.
POSE, SPEED, HAND, LATERAL, NORMAL, RELAXED, TRAVEL, PEAK = 0, 3, 6, 7, 8, 11, 14, 17
STATE_SIZE = 18
# Parameters: those of contact.parameters, then these.
(P_INERTIA, P_COM_Y, P_COM_Z) = range(19, 22)
PARAMETER_SIZE = 22
# Elements, one row each: place on the pads, y and z, spin radius, share of its finger's force.
E_Y, E_Z, E_SPIN, E_SHARE = range(4)
NEWTON_LIMIT = 60
_MASS, _MU_S, _MU_K, _K, _C, _RELAX, _TAU, _APERTURE, _PAD_HALF = range(9)
_SHAPE, _HALF_WIDTH, _HALF_HEIGHT, _GRIP_HEIGHT, _BODY_TOP, _STIFFNESS = range(9, 15)


@njit(cache=True)
def width_and_slope(p: Floats, slip: float) -> tuple[float, float]:
    """As contact.width_and_slope, which a test holds it to; numba caches by file."""
    if p[_SHAPE] == 0.0:
        return (p[_HALF_WIDTH], 0.0) if slip < p[_BODY_TOP] else (-1.0, 0.0)
    u = p[_GRIP_HEIGHT] + slip
    beyond = abs(u) - p[_PAD_HALF]
    if beyond <= 0.0:
        return p[_HALF_WIDTH], 0.0
    ratio = beyond / p[_HALF_HEIGHT]
    if ratio >= 1.0:
        return -1.0, 0.0
    width = p[_HALF_WIDTH] * math.sqrt(1.0 - ratio * ratio)
    slope = -(p[_HALF_WIDTH] ** 2) * ratio / (p[_HALF_HEIGHT] * width)
    return width, slope if u > 0.0 else -slope


@njit(cache=True)
def normal_forces(p: Floats, s: Floats, width: float) -> None:
    """Normal forces of the fingers into the state, balanced sideways: as contact.normal_forces."""
    reach = np.empty(FINGERS)
    for i in range(FINGERS):
        reach[i] = width - (p[_APERTURE] - s[TRAVEL + i]) - p[_RELAX] * s[RELAXED + i]
        s[NORMAL + i] = 0.0
    if width < 0.0:
        return
    for case in range(3):
        use_b, use_c = case != 2, case != 1
        k_a = p[_STIFFNESS]
        k_b = p[_STIFFNESS + 1] if use_b else 0.0
        k_c = p[_STIFFNESS + 2] if use_c else 0.0
        lateral = (k_b * reach[1] + k_c * reach[2] - k_a * reach[0]) / (k_a + k_b + k_c)
        n_a = k_a * (reach[0] + lateral)
        n_b = p[_STIFFNESS + 1] * (reach[1] - lateral)
        n_c = p[_STIFFNESS + 2] * (reach[2] - lateral)
        if n_a > 0.0 and (n_b > 0.0) == use_b and (n_c > 0.0) == use_c:
            s[LATERAL] = lateral
            s[NORMAL] = n_a
            s[NORMAL + 1] = n_b if use_b else 0.0
            s[NORMAL + 2] = n_c if use_c else 0.0
            return


@njit(cache=True)
def _close(p: Floats, s: Floats, t_s: float, h: float, closing: Floats, width: float) -> None:
    """Move the closing fingers through a step that ends at t_s, each until its own force stop.

    ``closing`` (8,): start, s; stop, N; speed of each finger, m/s; 1 for each that has stopped. A
    finger that would pass its stop is put where it just reaches it, so that no step is too large.
    """
    moved_s = min(h, t_s - closing[0])
    if moved_s <= 0.0:
        return
    for i in range(FINGERS):
        if closing[2 + i] == 0.0 or closing[5 + i] != 0.0:
            continue
        before = s[TRAVEL + i]
        s[TRAVEL + i] = min(before + closing[2 + i] * moved_s, p[_APERTURE])
        normal_forces(p, s, width)
        if s[NORMAL + i] >= closing[1]:
            closing[5 + i] = 1.0
            total = 0.0
            for j in range(FINGERS):
                total += p[_STIFFNESS + j] if s[NORMAL + j] > 0.0 else 0.0
            k = p[_STIFFNESS + i]
            back = (s[NORMAL + i] - closing[1]) / (k * (1.0 - k / total))
            s[TRAVEL + i] = max(before, s[TRAVEL + i] - back)


@njit(cache=True)
def _relax(p: Floats, s: Floats, h: float) -> None:
    for i in range(FINGERS):
        relaxed, n = s[RELAXED + i], s[NORMAL + i]
        if n > 0.0:
            compression = n / p[_STIFFNESS + i] + p[_RELAX] * relaxed
            s[RELAXED + i] += (compression - relaxed) * h / (h + p[_TAU])
        else:
            s[RELAXED + i] *= p[_TAU] / (h + p[_TAU])
        s[PEAK] = max(s[PEAK], n)


@njit(cache=True)
def _residual(
    v: Floats, inertia: Floats, push: Floats, a: Floats, b: Floats, cap: Floats, arm: Floats,
    r: Floats, hessian: Floats,
) -> None:  # fmt: skip
    """Slope ``r`` (3,) and curvature ``hessian`` (3, 3) at object velocity v = (y, z, turn).

    a (E, 3) is the force of an element were the object at rest, b (E,) its loss per m/s, cap (E,)
    its limit, arm (E, 3) its place about the centre of mass and its spin radius.
    """
    hessian[:] = 0.0
    for d in range(3):
        r[d] = inertia[d] * v[d] + push[d]
        hessian[d, d] = inertia[d]
    for e in range(b.shape[0]):
        y, z, spin = arm[e, 0], arm[e, 1], arm[e, 2]
        f0 = a[e, 0] - b[e] * (v[0] - v[2] * z)
        f1 = a[e, 1] - b[e] * (v[1] + v[2] * y)
        f2 = a[e, 2] - b[e] * spin * v[2]
        size = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
        along, across = b[e], b[e]
        if size > cap[e]:
            shrink = cap[e] / size
            across = b[e] * shrink
            along = 0.0
            f0, f1, f2 = f0 * shrink, f1 * shrink, f2 * shrink
        r[0] -= f0
        r[1] -= f1
        r[2] -= y * f1 - z * f0 + spin * f2
        # across * (1 - n n') + along * n n', seen through the lever arms
        hessian[0, 0] += across
        hessian[1, 1] += across
        hessian[0, 2] -= across * z
        hessian[1, 2] += across * y
        hessian[2, 2] += across * (y * y + z * z + spin * spin)
        if along != across:
            n0, n1, n2 = f0 / cap[e] if cap[e] > 0.0 else 0.0, 0.0, 0.0
            if cap[e] > 0.0:
                n1, n2 = f1 / cap[e], f2 / cap[e]
            turn = y * n1 - z * n0 + spin * n2
            hessian[0, 0] -= across * n0 * n0
            hessian[1, 1] -= across * n1 * n1
            hessian[0, 1] -= across * n0 * n1
            hessian[0, 2] -= across * n0 * turn
            hessian[1, 2] -= across * n1 * turn
            hessian[2, 2] -= across * turn * turn


@njit(cache=True)
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


@njit(cache=True)
def solve_velocity(
    v: Floats, inertia: Floats, push: Floats, a: Floats, b: Floats, cap: Floats, arm: Floats,
    work: Floats,
) -> int:  # fmt: skip
    """Root of the residual into v (3,), from the guess in it; work (6, 3). Returns iterations."""
    r, d, trial, hessian = work[0], work[1], work[2], work[3:6]
    _residual(v, inertia, push, a, b, cap, arm, r, hessian)
    scale = 0.0
    for e in range(b.shape[0]):
        scale += cap[e]
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
            _residual(trial, inertia, push, a, b, cap, arm, r, hessian)
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


@njit(cache=True)
def _pull(inertia: float, push: float, a: Floats, b: float, cap: Floats, v: float) -> float:
    """inertia v + push less the forces of three sliders: rises with v, linear in pieces."""
    r = inertia * v + push
    for i in range(FINGERS):
        r -= min(max(a[i] - b * v, -cap[i]), cap[i])
    return r


@njit(cache=True)
def solve_line(inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    """Exact root of _pull: bracketed between two of its six break points, linear in between."""
    low, high, r_low, r_high = -np.inf, np.inf, 0.0, 0.0
    for i in range(FINGERS):
        for side in (-1.0, 1.0):
            v = (a[i] + side * cap[i]) / b
            if low < v < high:
                r = _pull(inertia, push, a, b, cap, v)
                if r <= 0.0:
                    low, r_low = v, r
                if r >= 0.0:
                    high, r_high = v, r
    if low == -np.inf:  # all slide one way
        return high - r_high / inertia
    if high == np.inf:
        return low - r_low / inertia
    span = r_high - r_low
    return low - r_low * (high - low) / span if span > 0.0 else low


@njit(cache=True)
def follow_line(
    p: Floats, s: Floats, steps: int, h: float, hand_mps: Floats, load: Floats, closing: Floats,
    on_table: bool, stretch: Floats, sliding: Floats,
) -> None:  # fmt: skip
    """Level L1 of a whole scene; arguments and state as in ``follow``, three elements."""
    a, cap = np.empty(FINGERS), np.empty(FINGERS)
    damper, inertia = p[_C] / h, p[_MASS] / h
    for j in range(steps):
        hand = hand_mps[min(j, hand_mps.shape[0] - 1)]
        width, slope = width_and_slope(p, s[HAND] - s[POSE + 1])
        _close(p, s, (j + 1) * h, h, closing, width)
        normal_forces(p, s, width)
        cos = 1.0 / math.sqrt(1.0 + slope * slope)
        b = (p[_K] * h + p[_C]) * cos
        push = p[_MASS] * GRAVITY_MPS2 - inertia * s[SPEED + 1]
        push -= load[min(j, load.shape[0] - 1), 1]
        for i in range(FINGERS):
            n = s[NORMAL + i]
            cap[i] = (p[_MU_K] if sliding[i] != 0.0 else p[_MU_S]) * n * cos
            a[i] = b * hand + (p[_K] * stretch[i, 1] * cos if n > 0.0 else 0.0)
            push -= n * slope
        v = solve_line(inertia, push, a, b, cap)
        if on_table and s[POSE + 1] + h * v < 0.0:
            v = -s[POSE + 1] / h
        for i in range(FINGERS):
            trial = a[i] - b * v
            sliding[i] = 1.0 if cap[i] > 0.0 and abs(trial) > cap[i] else 0.0
            pull = min(max(trial, -cap[i]), cap[i]) / cos
            old = stretch[i, 1]
            stretch[i, 1] = (pull + damper * old) / (p[_K] + damper) if cap[i] > 0.0 else 0.0
        _relax(p, s, h)
        s[POSE + 1] += h * v
        s[SPEED + 1] = v
        s[HAND] += h * hand


@njit(cache=True)
def _elements(
    p: Floats, s: Floats, h: float, hand_mps: float, slope: float, finger: Floats,
    elements: Floats, stretch: Floats, sliding: Floats,
    a: Floats, b: Floats, cap: Floats, arm: Floats,
) -> None:  # fmt: skip
    """What the elements contribute to a step of h seconds: see _residual."""
    cos = 1.0 / math.sqrt(1.0 + slope * slope)
    for e in range(b.shape[0]):
        n, share = s[NORMAL + int(finger[e])], elements[e, E_SHARE]
        arm[e, 0] = elements[e, E_Y] - p[P_COM_Y] - s[POSE]
        arm[e, 1] = elements[e, E_Z] + s[HAND] - p[P_COM_Z] - s[POSE + 1]
        arm[e, 2] = elements[e, E_SPIN]
        mu = p[_MU_K] if sliding[e] != 0.0 else p[_MU_S]
        cap[e] = mu * n * share * cos
        b[e] = (p[_K] * h + p[_C]) * share * cos
        for d in range(3):
            a[e, d] = p[_K] * share * cos * stretch[e, d] if n > 0.0 else 0.0
        a[e, 1] += b[e] * hand_mps


@njit(cache=True)
def _settle(
    p: Floats, h: float, v: Floats, a: Floats, b: Floats, cap: Floats, arm: Floats,
    stretch: Floats, sliding: Floats,
) -> None:  # fmt: skip
    """Stretch and state of the elements at the end of a step."""
    damper = p[_C] / h
    f = np.empty(3)
    for e in range(b.shape[0]):
        f[0] = a[e, 0] - b[e] * (v[0] - v[2] * arm[e, 1])
        f[1] = a[e, 1] - b[e] * (v[1] + v[2] * arm[e, 0])
        f[2] = a[e, 2] - b[e] * arm[e, 2] * v[2]
        size = math.sqrt(f[0] ** 2 + f[1] ** 2 + f[2] ** 2)
        shrink = cap[e] / size if size > cap[e] else 1.0
        gain = (p[_K] * h + p[_C]) / b[e]  # from an element's force to that of a whole pad
        for d in range(3):
            if cap[e] == 0.0:
                stretch[e, d] = 0.0
            else:
                pull = f[d] * shrink * gain
                stretch[e, d] = (pull + damper * stretch[e, d]) / (p[_K] + damper)
        sliding[e] = 1.0 if size > cap[e] and cap[e] > 0.0 else 0.0


@njit(cache=True)
def follow(
    p: Floats, s: Floats, steps: int, h: float, hand_mps: Floats, load: Floats, closing: Floats,
    on_table: bool, finger: Floats, elements: Floats, stretch: Floats, sliding: Floats,
) -> None:  # fmt: skip
    """A whole scene: ``steps`` steps of h seconds. Tables as in drive.Drive; finger (E,) which
    finger an element belongs to; elements (E, 4); stretch (E, 3) and sliding (E,) are state.

    The table pushes and never pulls; while it does, it keeps the object from turning and sliding.
    """
    count = finger.shape[0]
    a, arm = np.empty((count, 3)), np.empty((count, 3))
    b, cap = np.empty(count), np.empty(count)
    inertia = np.array([p[_MASS], p[_MASS], p[P_INERTIA]]) / h
    push, v, work = np.empty(3), np.empty(3), np.empty((6, 3))
    for j in range(steps):
        hand = hand_mps[min(j, hand_mps.shape[0] - 1)]
        force = load[min(j, load.shape[0] - 1)]
        width, slope = width_and_slope(p, s[HAND] - s[POSE + 1])
        _close(p, s, (j + 1) * h, h, closing, width)
        normal_forces(p, s, width)
        _elements(p, s, h, hand, slope, finger, elements, stretch, sliding, a, b, cap, arm)
        wedge = (s[NORMAL] + s[NORMAL + 1] + s[NORMAL + 2]) * slope
        push[0] = -inertia[0] * s[SPEED] - force[0]
        push[1] = -inertia[1] * s[SPEED + 1] - force[1] + p[_MASS] * GRAVITY_MPS2 - wedge
        push[2] = -inertia[2] * s[SPEED + 2] - force[2]
        push[2] += p[P_COM_Y] * force[1] - p[P_COM_Z] * force[0]
        for d in range(3):
            v[d] = s[SPEED + d]
        solve_velocity(v, inertia, push, a, b, cap, arm, work)
        if on_table and s[POSE + 1] + h * v[1] < 0.0:
            v[0], v[1], v[2] = 0.0, -s[POSE + 1] / h, 0.0
        _settle(p, h, v, a, b, cap, arm, stretch, sliding)
        _relax(p, s, h)
        for d in range(3):
            s[POSE + d] += h * v[d]
            s[SPEED + d] = v[d]
        s[HAND] += h * hand
