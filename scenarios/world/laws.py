"""The contact laws of levels L1 to L4, compiled: one object between three fingers, one state.

Numba's cache sees no change in an imported kernel, so all of them are in this file.

Normal forces: finger, pad and object wall in series, a linear spring each; one relaxation term a
finger (rubber, Prony form); the object is free along the closing axis x, so that the thumb carries
the sum of the other two (quasi-static balance). A body struck along that axis has its own inertia
there too, m x'' = push - N_A + N_B + N_C, and a damper beside each finger's spring. Below
the object is a table that can push but not pull; while it does, it keeps the object from turning
and sliding.

Friction: a pad is one or more elements, each a Kelvin-Voigt spring behind a friction limit (Jenkins
element). L1 has a point a finger and moves along z, or, once it is struck from the
side, without turning; L2 a point a finger that may turn; L3 a point whose third spring is the
patch's spin (the ellipsoid limit surface |(f_y, f_z, tau / a)| <= mu N); L4 a grid of points.

The backward Euler step is the minimum of a strictly convex function: inertia is quadratic, and an
element's radial return is the slope of a Huber function. So Newton's method with a line search that
keeps its bracket cannot cycle, whatever step and stiffness; along z alone the balance is linear
between six break points and solved exactly. Limits and lever arms are those at a step's start.

Signs: y across the closing axis, along an impact from the side; z up; rotation from y to z.
``slip`` is how far the fingers have risen over the object, ``across`` how far it has moved beside
them, both at the middle of the grip.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenarios.world.settings import GRAVITY_MPS2

FINGERS = 3
Floats = NDArray[np.float64]

# Layout of the state: one flat array, so that a compiled call takes a single object.
(
    HEIGHT, SPEED, SLIP, LATERAL, ONSET_S, SLIP_SPEED, SLOPE, ONSET_FORCE, RISE_S, PRESENT,
    TAP_START_S, TAP_S, TAP_N_S, TAP_DIRECTION, TAP_OFFSET, FOLLOW_S, FOLLOW_N_S,
    MOVED_FROM_S, MOVED_UNTIL_S,  # gross slip since the last impact: first and last instant
    ACROSS, ACROSS_SPEED, TURN, TURN_RATE,
    SPIN,  # the turning rate while at most one pad holds on, else 0
    COM_ACROSS, COM_RISE,  # how the centre of mass has moved against the hand
    PULL_START_S, PULL_N, PULL_RAMP_S, PULL_S,  # a steady pull down: ramp, full force, ramp
    INERT, LATERAL_SPEED,  # 1 while x is not the forces' balance alone; and dx/dt then
) = range(32)  # fmt: skip
# of each finger; compression of its spring while INERT; the last: how its force rises with its
# travel, the others still
RELAXED, NORMAL, SHEAR, PEAK, SQUEEZE, STIFFNESS = 32, 35, 38, 41, 44, 47
STATE_SIZE = STIFFNESS + FINGERS
# of the elements (E, 9): place on the pads, spin radius, share of its finger's force, the finger,
# 1 while it slides, stretch along y, z and turn,
E_Y, E_Z, E_SPIN, E_SHARE, E_FINGER, E_SLIDES, E_STRETCH_Y, E_STRETCH_Z, E_STRETCH_TURN = range(9)
ELEMENT_SIZE = 9
# and of the parameters.
(
    P_MASS, P_MU_S, P_MU_K, P_K_SHEAR, P_C_SHEAR, P_RELAX, P_TAU, P_APERTURE, P_PAD_HALF,
    P_SHAPE, P_HALF_WIDTH, P_HALF_HEIGHT, P_GRIP_HEIGHT, P_BODY_TOP, P_STIFFNESS,
) = range(15)  # fmt: skip
P_GROSS_SLIP, P_FORCE_RISE, P_GROSS_TURN = 18, 19, 20
P_INERTIA, P_COM_Y, P_COM_Z, P_LEVEL, P_IMPACT_STEP, P_LOSS = 21, 22, 23, 24, 25, 26
PARAMETER_SIZE = 27
NOT_YET = -1.0
TOP, SIDE, CLOSING = 0, 1, 2  # an impact downwards; across; along the closing axis, onto the thumb
IMPACT_LASTS_S = 0.3  # an impact and what it sets off is stepped more finely
IN_THE_AIR_M = 100.0  # height of what has no table below it
NEWTON_LIMIT = 60
# Columns of the scratch of a planar step (E, 8): the element's force were the object at rest, its
# loss per m/s, its limit, its place about the centre of mass and its spin radius.
W_Y, W_Z, W_TURN, W_LOSS, W_CAP, W_ARM_Y, W_ARM_Z, W_SPIN = range(8)
SLIDER = 1.0  # of P_LEVEL: what may turn is above


@njit(cache=True)
def width_and_slope(p: Floats, slip: float) -> tuple[float, float]:
    """Half width (m) that a flat pad meets after sliding by ``slip``, and its slope dw/du.

    A flat pad keeps touching the widest point of a ball until its own edge has passed it; then it
    touches with that edge, on the falling flank. A width of -1 means that the body is gone.
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


@njit(cache=True)
def centre_on_pad(p: Floats, slip: float) -> float:
    """Where the object's widest point lies on the pads, m above their middle; 0 if straight."""
    if p[P_SHAPE] == 0.0:
        return 0.0
    above = -(p[P_GRIP_HEIGHT] + slip)
    centre: float = min(max(above, -p[P_PAD_HALF]), p[P_PAD_HALF])
    return centre


@njit(cache=True)
def _compressions(p: Floats, width: float, travel: Floats, state: Floats, out: Floats) -> None:
    """Of each finger (3,), m, at lateral position zero: wall minus pad surface, minus what has
    relaxed."""
    for i in range(FINGERS):
        relaxed = p[P_RELAX] * state[RELAXED + i]
        out[i] = width - (p[P_APERTURE] - travel[i]) - relaxed


@njit(cache=True)
def normal_forces(p: Floats, width: float, travel: Floats, state: Floats, out: Floats) -> None:
    """Normal force of each finger (3,), N, into ``out``; the lateral position into the state.

    The balance N_A = N_B + N_C is piecewise linear in the lateral position: of B and C the one that
    reaches less far lets go first.
    """
    _compressions(p, width, travel, state, out)
    if width < 0.0:
        out[:] = 0.0
        return
    k = p[P_STIFFNESS:]
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


@njit(cache=True)
def inert_forces(
    p: Floats, s: Floats, h: float, width: float, travel: Floats, push: float, out: Floats
) -> None:
    """The same after a step of h seconds of an object that has its inertia along the closing axis,
    pushed onto the thumb by ``push``, N; its speed and the fingers' springs into the state.

    A pad that lets go springs back as its damper lets it, compression x tau / (h + tau), and
    presses again where the wall meets it, so that it never pulls: its force (k + k tau / h)
    max(0, wall - pad) is the slope of a convex function of the object's place, and so is the
    inertia. The root is unique, and exact between the places at which the three pads touch.
    """
    tau = p[P_LOSS]
    _compressions(p, width, travel, s, out)
    if width < 0.0:
        out[:], s[LATERAL_SPEED] = 0.0, 0.0
        return
    inertia = p[P_MASS] / (h * h)
    slope, total = inertia, push + inertia * (s[LATERAL] + h * s[LATERAL_SPEED])
    low, high = -np.inf, np.inf  # of the place, between those at which a pad touches
    for i in range(FINGERS):
        out[i] -= s[SQUEEZE + i] * tau / (h + tau)  # of the wall beyond the free pad, at x = 0
    for i in range(FINGERS):
        at = -out[0] if i == 0 else out[i]
        rest = total - inertia * at
        for j in range(FINGERS):
            side = -1.0 if j == 0 else 1.0
            rest += side * p[P_STIFFNESS + j] * (1.0 + tau / h) * max(0.0, out[j] - side * at)
        if rest >= 0.0:  # the object comes to lie beyond it
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
        lateral = s[LATERAL]  # the table keeps what no finger holds
    s[LATERAL_SPEED] = (lateral - s[LATERAL]) / h
    s[LATERAL] = lateral
    for i in range(FINGERS):
        beyond = max(0.0, out[i] + lateral if i == 0 else out[i] - lateral)
        out[i] = p[P_STIFFNESS + i] * (1.0 + tau / h) * beyond
        s[SQUEEZE + i] = s[SQUEEZE + i] * tau / (h + tau) + beyond


@njit(cache=True)
def clearance(p: Floats, s: Floats, travel: Floats) -> float:
    """How far thumb and nearest opposing finger may close in all before both sides touch, m."""
    width, _ = width_and_slope(p, s[SLIP])
    if s[PRESENT] == 0.0 or width < 0.0:
        return np.inf
    gap: float = 2 * (p[P_APERTURE] - width) - travel[0] - max(travel[1], travel[2])
    return gap


@njit(cache=True)
def normal_stiffness(p: Floats, forces: Floats, inertia: float, out: Floats) -> None:
    """dN_i/dtravel_i (3,), N/m, with the other fingers still and the object free to the side but
    for its inertia, N/m."""
    total = inertia
    for i in range(FINGERS):
        if forces[i] > 0.0:
            total += p[P_STIFFNESS + i]
    for i in range(FINGERS):
        k = p[P_STIFFNESS + i]
        out[i] = k * (1.0 - k / total) if forces[i] > 0.0 else 0.0


@njit(cache=True)
def _residual_along(
    v: float, inertia: float, push: float, a: Floats, b: float, cap: Floats
) -> float:
    """inertia * v + push - sum of finger forces at object velocity v; rises strictly with v."""
    r = inertia * v + push
    for i in range(FINGERS):
        r -= min(max(a[i] - b * v, -cap[i]), cap[i])
    return r


@njit(cache=True)
def solve_along(inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    """Root of the residual: tried with all pads holding on, else bracketed between its six break
    points, where it is linear."""
    total, slope = -push, inertia
    for i in range(FINGERS):
        total += a[i]
        slope += b
    v = total / slope
    held = True
    for i in range(FINGERS):
        held = held and abs(a[i] - b * v) <= cap[i]
    if not held:
        v = _bracketed(inertia, push, a, b, cap)
    return v


@njit(cache=True)
def _bracketed(inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    low, high = -np.inf, np.inf
    for i in range(FINGERS):
        for side in (-1.0, 1.0):
            v = (a[i] + side * cap[i]) / b
            if not low < v < high:
                continue
            r = _residual_along(v, inertia, push, a, b, cap)
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


@njit(cache=True)
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
        if square > cap * cap:  # across * (1 - n n'), seen through the lever arms
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
def solve_planar(v: Floats, inertia: Floats, push: Floats, work: Floats, small: Floats) -> int:
    """Root of the residual into v (3,), from the guess in it; work (E, 8) as its columns say,
    small (6, 3) is scratch. Returns iterations."""
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


@njit(cache=True)
def _half_sine(since_s: float, duration_s: float, impulse_n_s: float) -> float:
    """What such a pulse has delivered, N s; one that has no length delivers nothing."""
    if duration_s <= 0.0:
        return 0.0
    phase = min(max(since_s / duration_s, 0.0), 1.0)
    return 0.5 * impulse_n_s * (1.0 - math.cos(math.pi * phase))


@njit(cache=True)
def tap_force(s: Floats, t_s: float, h: float) -> float:
    """Mean force, N, of the mallet from t_s on for h seconds, so that no step loses any of its
    impulse: a half sine that carries TAP_N_S in all, then a longer one of FOLLOW_N_S while the
    hand follows through."""
    carried = 0.0
    for end, sign in ((t_s + h, 1.0), (t_s, -1.0)):
        since = end - s[TAP_START_S]
        carried += sign * _half_sine(since, s[TAP_S], s[TAP_N_S])
        carried += sign * _half_sine(since - s[TAP_S], s[FOLLOW_S], s[FOLLOW_N_S])
    return carried / h


@njit(cache=True)
def pull_force(s: Floats, t_s: float) -> float:
    """Force, N, of the steady pull at time t_s."""
    since, ramp_s = t_s - s[PULL_START_S], s[PULL_RAMP_S]
    if s[PULL_N] == 0.0 or since <= 0.0:
        return 0.0
    left = 2 * ramp_s + s[PULL_S] - since
    return float(s[PULL_N] * min(1.0, since / ramp_s, max(0.0, left / ramp_s)))


@njit(cache=True)
def _along(
    p: Floats, s: Floats, e: Floats, h: float, v_hand: float, cos: float, push: float, n: Floats,
    a: Floats, cap: Floats,
) -> float:  # fmt: skip
    """L1 that nothing has struck from the side: the object's velocity up; pads brought along."""
    b = (p[P_K_SHEAR] * h + p[P_C_SHEAR]) * cos
    for i in range(FINGERS):
        mu = p[P_MU_K] if e[i, E_SLIDES] != 0.0 else p[P_MU_S]
        cap[i] = mu * n[i] * cos
        touching = 1.0 if n[i] > 0.0 else 0.0
        a[i] = touching * p[P_K_SHEAR] * e[i, E_STRETCH_Z] * cos + b * v_hand
    v = solve_along(p[P_MASS] / h, push, a, b, cap)
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


@njit(cache=True)
def _planar(
    p: Floats, s: Floats, e: Floats, h: float, v_hand: float, cos: float, push: float,
    force_y: float, torque: float, n: Floats, work: Floats, small: Floats,
) -> None:  # fmt: skip
    """L2 to L4, and L1 without its rotation: velocity (y, z, turn) into small[6]; pads brought
    along. ``torque`` of the impact is about the centre of mass."""
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


@njit(cache=True)
def _settle(
    p: Floats, s: Floats, e: Floats, h: float, v: Floats, n: Floats, work: Floats, held: Floats
) -> None:
    """Elements at the end of a planar step; the share of each finger's force that holds on into
    ``held`` (3,), and its pull upwards into the state."""
    damper = p[P_C_SHEAR] / h
    gain = p[P_K_SHEAR] * h + p[P_C_SHEAR]
    held[:] = 0.0
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
        held[finger] += 0.0 if slides else e[j, E_SHARE]
        s[SHEAR + finger] += shrink * f1
        back = shrink * gain / b  # from an element's force to that of a whole pad
        stiff = p[P_K_SHEAR] + damper
        e[j, E_STRETCH_Y] = (f0 * back + damper * e[j, E_STRETCH_Y]) / stiff
        e[j, E_STRETCH_Z] = (f1 * back + damper * e[j, E_STRETCH_Z]) / stiff
        e[j, E_STRETCH_TURN] = (f2 * back + damper * e[j, E_STRETCH_TURN]) / stiff


@njit(cache=True)
def _relax(p: Floats, s: Floats, h: float, n: Floats) -> None:
    for i in range(FINGERS):
        s[NORMAL + i] = n[i]
        s[PEAK + i] = max(s[PEAK + i], n[i])
        if n[i] > 0.0:
            compression = n[i] / p[P_STIFFNESS + i] + p[P_RELAX] * s[RELAXED + i]
            s[RELAXED + i] += (compression - s[RELAXED + i]) * h / (h + p[P_TAU])
        else:
            s[RELAXED + i] *= p[P_TAU] / (h + p[P_TAU])


@njit(cache=True)
def _moved_along(s: Floats, e: Floats, h: float, v_hand: float, v: float, n: Floats) -> None:
    """The object's place at the end of a step along z, and whether all pads slide."""
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


@njit(cache=True)
def _moved(
    p: Floats, s: Floats, h: float, v_hand: float, v: Floats, n: Floats, held: Floats
) -> None:
    """The same of a planar step. A pad holds on while most of its force does; one may be the pivot
    of a rotation, two hold the object."""
    up = v[1] - v[2] * (p[P_COM_Y] + s[COM_ACROSS])  # at the middle of the grip
    aside = v[0] + v[2] * (p[P_COM_Z] + s[COM_RISE])
    holding, touching = 0, 0
    for i in range(FINGERS):
        if n[i] > 0.0:
            touching += 1
            holding += 1 if held[i] > 0.5 else 0
    s[HEIGHT] = max(0.0, s[HEIGHT] + h * v[1])
    s[ACROSS_SPEED], s[SPEED], s[TURN_RATE] = v[0], v[1], v[2]
    s[SLIP] += h * (v_hand - up)
    s[ACROSS] += h * aside
    s[TURN] += h * v[2]
    s[COM_ACROSS] += h * v[0]
    s[COM_RISE] += h * (v[1] - v_hand)
    s[SLIP_SPEED] = math.hypot(v_hand - up, aside) if touching > 0 and holding == 0 else 0.0
    s[SPIN] = v[2] if touching > 0 and holding < 2 else 0.0


@njit(cache=True)
def step(
    p: Floats, s: Floats, e: Floats, h: float, v_hand: float, travel: Floats, impact: Floats,
    n: Floats, work: Floats, small: Floats,
) -> None:  # fmt: skip
    """One backward Euler step of h seconds. ``impact`` (4,): force along y, z and the closing axis,
    onto the thumb, N (the last only while INERT); torque about the middle of the grip, N m."""
    gone = s[PRESENT] == 0.0 or abs(s[ACROSS]) > p[P_HALF_WIDTH]
    width, slope = (-1.0, 0.0) if gone else width_and_slope(p, s[SLIP])
    if s[INERT] == 0.0:
        normal_forces(p, width, travel, s, n)
    else:
        inert_forces(p, s, h, width, travel, impact[2], n)
    cos = 1.0 / math.sqrt(1.0 + slope * slope)
    push = p[P_MASS] * (GRAVITY_MPS2 - s[SPEED] / h) - impact[1]
    for i in range(FINGERS):
        push -= n[i] * slope  # above the widest point (slope < 0) closing pushes the object down
    if p[P_LEVEL] == SLIDER and s[ACROSS_SPEED] == 0.0 and impact[0] == 0.0:
        v = _along(p, s, e, h, v_hand, cos, push, n, small[0], small[1])
        _moved_along(s, e, h, v_hand, v, n)
    else:
        torque = impact[3] - p[P_COM_Y] * impact[1] + p[P_COM_Z] * impact[0]
        _planar(p, s, e, h, v_hand, cos, push, impact[0], torque, n, work, small)
        _settle(p, s, e, h, small[6], n, work, small[0])
        _moved(p, s, h, v_hand, small[6], n, small[0])
    _relax(p, s, h, n)
    if n.max() > 0.0:
        s[SLOPE] = slope


@njit(cache=True)
def _note(p: Floats, s: Floats, t_s: float) -> None:
    """Write down when gross slip set in, when the force rose after it, and what an impact moved."""
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


@njit(cache=True)
def _impact(s: Floats, t_s: float, h: float, out: Floats) -> None:
    """What mallet and pull do in a step of h seconds from t_s on, as ``step`` takes it."""
    force = tap_force(s, t_s, h)
    out[:] = 0.0
    if s[TAP_DIRECTION] == CLOSING:
        out[2] = force
    elif s[TAP_DIRECTION] == SIDE:
        out[0], out[3] = force, -force * s[TAP_OFFSET]
    else:
        out[1], out[3] = -force, -force * s[TAP_OFFSET]
    out[1] -= pull_force(s, t_s + 0.5 * h)


@njit(cache=True)
def advance(
    p: Floats, s: Floats, e: Floats, t_s: float, dt_s: float, step_s: float,
    finger_rise_m: float, v0: float, v1: float, travel0: Floats, travel1: Floats,
) -> None:  # fmt: skip
    """Advance state and elements by dt_s. The fingers rise by finger_rise_m with speeds v0 -> v1 at
    the ends and close from travel0 to travel1 (3,), m. Records the onset of gross slip: the first
    instant at which every touching pad slides faster than 3 mm/s, or the object turns faster than
    0.2 rad/s about at most one pad that holds on; and, after it, the first rise of the thumb's
    force.
    """
    struck = s[TAP_S] > 0.0
    since_impact = t_s + dt_s - s[TAP_START_S] if struck else -1.0
    if 0.0 < since_impact < IMPACT_LASTS_S + dt_s:
        step_s = min(step_s, p[P_IMPACT_STEP])
    steps = max(1, math.ceil(dt_s / step_s - 1e-9))
    h = dt_s / steps
    mean = finger_rise_m / dt_s
    travel, n, impact = np.empty(FINGERS), np.empty(FINGERS), np.zeros(4)
    work, small = np.empty((e.shape[0], 8)), np.empty((9, 3))
    for j in range(steps):
        middle = (j + 0.5) / steps
        end = (j + 1.0) / steps
        for i in range(FINGERS):
            travel[i] = travel0[i] + (travel1[i] - travel0[i]) * end
        if struck or s[PULL_N] != 0.0:
            _impact(s, t_s + j * h, h, impact)
        v_hand = mean + (v1 - v0) * (middle - 0.5)
        step(p, s, e, h, v_hand, travel, impact, n, work, small)
        _note(p, s, t_s + (j + 1) * h)
    normal_stiffness(p, n, s[INERT] * p[P_MASS] / dt_s**2, s[STIFFNESS:])


@njit(cache=True)
def felt(
    p: Floats, s: Floats, up: Floats, across: Floats, places: Floats, turns: Floats,
    motion: Floats, turn: Floats, centre: Floats,
) -> None:  # fmt: skip
    """What moves over the pads, in their own frames: motion (F, 2), m, and turn (F,), rad, of the
    surface at each pad's middle, which lies at ``places`` (F,) across; centre (F, 2), m, of a
    curved one. ``up`` and ``across`` (F, 2), ``turns`` (F,): the pads' frames."""
    middle = centre_on_pad(p, s[SLIP])
    for i in range(FINGERS):
        rise = s[TURN] * places[i] - s[SLIP]  # the object lags behind rising fingers
        for d in range(2):
            motion[i, d] = s[ACROSS] * across[i, d] + rise * up[i, d]
            centre[i, d] = middle * up[i, d]
        turn[i] = turns[i] * s[TURN]
