"""Level L1 of the contact ladder: three compliant fingers on one object that slides in their plane.

Normal forces: finger, pad and object wall in series, a linear spring each; one relaxation term a
finger (rubber, Prony form); the object is free along the closing axis, so that the thumb carries
the sum of the other two (quasi-static balance). Tangential forces: a Kelvin-Voigt spring and a
Coulomb slider a finger (Jenkins element), integrated by backward Euler with an exact solve of the
piecewise linear step equation, so it neither drifts inside the friction cone nor cycles at large
steps. Below the object is a table that can push but not pull.

A blow from the side adds the second tangential direction, across the closing axis: friction is then
a circle a finger, so what is spent sideways does not carry the weight, and the object sinks while
it slides. The step is the minimum of a strictly convex function, found by Newton's method. Without
such a blow nothing moves across and the step is the scalar one, bit for bit. Left out: rotation in
the hand, and any change of width with motion across.

Sign conventions: heights and velocities up; ``slip`` is finger height minus object height since
the start, positive when the object lags behind rising fingers; ``across`` is the object's own
motion relative to the fingers, positive the way a blow from the side drives it.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenarios.world.contact_settings import ContactSettings
from scenarios.world.objects import GraspObject

GRAVITY_MPS2 = 9.81
FINGERS = 3
Floats = NDArray[np.float64]


# Layout of the state vector: one flat array, so that the compiled step takes a single object.
HEIGHT, SPEED, SLIP, LATERAL, ONSET_S, SLIP_SPEED = 0, 1, 2, 3, 4, 5
STRETCH, RELAXED, NORMAL, SHEAR, SLIDING, PEAK = 6, 9, 12, 15, 18, 21
SLOPE, ONSET_FORCE, RISE_S, PRESENT = 24, 25, 26, 27
TAP_START_S, TAP_S, TAP_N_S = 28, 29, 30  # a half-sine pulse on the object
TAP_DIRECTION, FOLLOW_S, FOLLOW_N_S = 31, 32, 33  # and a longer one: the hand follows through
MOVED_FROM_S, MOVED_UNTIL_S = 34, 35  # gross slip since the last blow: first and last instant
ACROSS, ACROSS_SPEED, STRETCH_ACROSS = 36, 37, 38
PULL_START_S = STRETCH_ACROSS + FINGERS  # a steady pull downwards: a ramp, its full force, a ramp
PULL_N, PULL_RAMP_S, PULL_S = PULL_START_S + 1, PULL_START_S + 2, PULL_START_S + 3
STATE_SIZE = PULL_S + 1
TOP, SIDE, CLOSING = 0, 1, 2  # a blow downwards; across; along the closing axis, onto the thumb
BLOW_STEP_S, BLOW_LASTS_S = 1e-4, 0.3  # a blow and what it sets off is stepped more finely
# and of the parameter vector.
(
    P_MASS, P_MU_S, P_MU_K, P_K_SHEAR, P_C_SHEAR, P_RELAX, P_TAU, P_APERTURE, P_PAD_HALF,
    P_SHAPE, P_HALF_WIDTH, P_HALF_HEIGHT, P_GRIP_HEIGHT, P_BODY_TOP, P_STIFFNESS,
) = range(15)  # fmt: skip
P_GROSS_SLIP, P_FORCE_RISE = P_STIFFNESS + FINGERS, P_STIFFNESS + FINGERS + 1
PARAMETER_SIZE = P_FORCE_RISE + 1
NOT_YET = -1.0


def finger_stiffness(contact: ContactSettings, body: GraspObject) -> float:
    """Normal stiffness of one finger on one wall, N/m: mount, pad and wall in series."""
    compliance = (
        1 / contact.mount_stiffness_npm
        + 1 / contact.pad_stiffness_npm
        + 1 / body.wall_stiffness_npm
    )
    return 1 / compliance


def parameters(contact: ContactSettings, body: GraspObject) -> Floats:
    """Parameter vector (20,) of the compiled step."""
    out = np.empty(PARAMETER_SIZE)
    out[:P_STIFFNESS] = (
        body.mass_kg + body.added_mass_kg, body.friction_static, body.friction_kinetic,
        contact.shear_stiffness_npm, contact.shear_damping_nspm,
        contact.relaxation_fraction, contact.relaxation_time_s,
        contact.half_aperture_m, contact.pad_half_length_m,
        0.0 if body.shape == "straight" else 1.0,
        body.half_width_m, body.half_height_m, body.grip_height_m, body.body_above_grip_m,
    )  # fmt: skip
    out[P_STIFFNESS:P_GROSS_SLIP] = finger_stiffness(contact, body)
    out[P_GROSS_SLIP:] = contact.gross_slip_mps, contact.force_rise_n
    return out


def initial_state(present: bool = True) -> Floats:
    """State vector (45,): object at rest on the table, nothing touched; or no object yet."""
    state = np.zeros(STATE_SIZE)
    state[PRESENT] = 1.0 if present else 0.0
    state[ONSET_S] = NOT_YET
    state[RISE_S] = NOT_YET
    state[MOVED_FROM_S] = NOT_YET
    state[MOVED_UNTIL_S] = NOT_YET
    return state


def strike(
    state: Floats, direction: int, start_s: float, pulse: tuple[float, float],
    follow: tuple[float, float],
) -> None:  # fmt: skip
    """A blow from start_s on: a pulse and what follows through, (s, N s) each. What an earlier blow
    moved is forgotten."""
    state[TAP_DIRECTION], state[TAP_START_S] = direction, start_s
    state[TAP_S], state[TAP_N_S] = pulse
    state[FOLLOW_S], state[FOLLOW_N_S] = follow
    state[MOVED_FROM_S] = state[MOVED_UNTIL_S] = NOT_YET


def pull(state: Floats, force_n: float, start_s: float, ramp_s: float, lasts_s: float) -> None:
    """A force downwards on the object from start_s on, with a ramp at either end."""
    state[PULL_START_S], state[PULL_N] = start_s, force_n
    state[PULL_RAMP_S], state[PULL_S] = ramp_s, lasts_s


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
def normal_forces(p: Floats, width: float, travel: Floats, state: Floats, out: Floats) -> None:
    """Normal force of each finger (3,), N, into ``out``; the lateral position into the state.

    Compression of finger i: wall minus pad surface, minus what has relaxed. The balance
    N_A = N_B + N_C is piecewise linear in the lateral position; with B and C either both or one of
    them touching there are three cases, and the consistent one is taken.
    """
    reach = np.empty(FINGERS)  # compression at lateral position zero
    for i in range(FINGERS):
        relaxed = p[P_RELAX] * state[RELAXED + i]
        reach[i] = width - (p[P_APERTURE] - travel[i]) - relaxed
        out[i] = 0.0
    k = p[P_STIFFNESS:]
    if width < 0.0:
        return
    for case in range(3):
        use_b = case != 2
        use_c = case != 1
        k_b = k[1] if use_b else 0.0
        k_c = k[2] if use_c else 0.0
        lateral = (k_b * reach[1] + k_c * reach[2] - k[0] * reach[0]) / (k[0] + k_b + k_c)
        n_a = k[0] * (reach[0] + lateral)
        n_b = k[1] * (reach[1] - lateral)
        n_c = k[2] * (reach[2] - lateral)
        if n_a <= 0.0:
            continue
        if (n_b > 0.0) == use_b and (n_c > 0.0) == use_c:
            state[LATERAL] = lateral
            out[0] = n_a
            out[1] = n_b if use_b else 0.0
            out[2] = n_c if use_c else 0.0
            return


@njit(cache=True)
def struck_normal_forces(
    p: Floats, width: float, travel: Floats, push: float, state: Floats, out: Floats
) -> None:
    """``normal_forces`` while ``push`` N press the object onto the thumb: N_A = N_B + N_C + push.

    Any finger may lose touch; the balance has one solution among the seven sets of fingers.
    """
    reach = np.empty(FINGERS)
    side = np.array([1.0, -1.0, -1.0])  # thumb and opposing fingers gain and lose by motion aside
    for i in range(FINGERS):
        reach[i] = width - (p[P_APERTURE] - travel[i]) - p[P_RELAX] * state[RELAXED + i]
        out[i] = 0.0
    if width < 0.0:
        return
    for touching in range(1, 8):
        total, stiffness = push, 0.0
        for i in range(FINGERS):
            if touching >> i & 1:
                total -= side[i] * p[P_STIFFNESS + i] * reach[i]
                stiffness += p[P_STIFFNESS + i]
        lateral = total / stiffness
        consistent = True
        for i in range(FINGERS):
            pressed = reach[i] + side[i] * lateral > 0.0
            consistent = consistent and pressed == (touching >> i & 1 == 1)
        if consistent:
            state[LATERAL] = lateral
            for i in range(FINGERS):
                out[i] = max(0.0, p[P_STIFFNESS + i] * (reach[i] + side[i] * lateral))
            return


@njit(cache=True)
def clearance(p: Floats, s: Floats, travel: Floats) -> float:
    """How far thumb and nearest opposing finger may close in all before both sides touch, m."""
    width, _ = width_and_slope(p, s[SLIP])
    if s[PRESENT] == 0.0 or width < 0.0:
        return np.inf
    gap: float = 2 * (p[P_APERTURE] - width) - travel[0] - max(travel[1], travel[2])
    return gap


@njit(cache=True)
def normal_stiffness(p: Floats, forces: Floats, out: Floats) -> None:
    """dN_i/dtravel_i (3,), N/m, with the other fingers still and the object free to the side."""
    total = 0.0
    for i in range(FINGERS):
        if forces[i] > 0.0:
            total += p[P_STIFFNESS + i]
    for i in range(FINGERS):
        k = p[P_STIFFNESS + i]
        out[i] = k * (1.0 - k / total) if forces[i] > 0.0 else 0.0


@njit(cache=True)
def _residual(v: float, inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    """inertia * v + push - sum of finger forces at object velocity v; rises strictly with v."""
    r = inertia * v + push
    for i in range(FINGERS):
        r -= min(max(a[i] - b * v, -cap[i]), cap[i])
    return r


@njit(cache=True)
def solve_velocity(inertia: float, push: float, a: Floats, b: float, cap: Floats) -> float:
    """Root of the residual: bracketed between its six break points, where it is linear."""
    low, high = -np.inf, np.inf
    for i in range(FINGERS):
        for side in (-1.0, 1.0):
            v = (a[i] + side * cap[i]) / b
            r = _residual(v, inertia, push, a, b, cap)
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
def solve_planar(
    inertia: float, push_z: float, push_y: float, cos: float,
    a_z: Floats, a_y: Floats, b: float, cap: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Object velocity, up and across, that balances inertia, push and three circular sliders.

    The finger's force is a - b v, cut to length cap; its part up the flank counts ``cos``. The
    balance is the gradient of a strictly convex function, so Newton's method with halved steps
    cannot miss.
    """
    z, y = 0.0, 0.0
    value, g_z, g_y, h_zz, h_zy, h_yy = _potential(
        inertia, push_z, push_y, cos, a_z, a_y, b, cap, z, y
    )
    polished = 0
    for _ in range(60):
        determinant = h_zz * h_yy - h_zy * h_zy
        d_z = (h_zy * g_y - h_yy * g_z) / determinant
        d_y = (h_zy * g_z - h_zz * g_y) / determinant
        gain = -(g_z * d_z + g_y * d_y)
        if gain <= 1e-12 * abs(value):  # less than the value can tell: two whole steps suffice
            z, y = z + d_z, y + d_y
            polished += 1
            if polished == 2:
                break
            value, g_z, g_y, h_zz, h_zy, h_yy = _potential(
                inertia, push_z, push_y, cos, a_z, a_y, b, cap, z, y
            )
            continue
        part = 1.0
        for _halving in range(40):
            new, n_z, n_y, h_zz, h_zy, h_yy = _potential(
                inertia, push_z, push_y, cos, a_z, a_y, b, cap, z + part * d_z, y + part * d_y
            )
            if new < value - 1e-4 * part * gain:
                break
            part *= 0.5
        z, y, value, g_z, g_y = z + part * d_z, y + part * d_y, new, n_z, n_y
    return z, y


@njit(cache=True)
def _potential(
    inertia: float, push_z: float, push_y: float, cos: float,
    a_z: Floats, a_y: Floats, b: float, cap: Floats, z: float, y: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """The convex function of the step at velocity (z, y): value, gradient, second derivatives."""
    m_z = inertia / cos
    value = 0.5 * (m_z * z * z + inertia * y * y) + push_z / cos * z + push_y * y
    g_z, g_y = m_z * z + push_z / cos, inertia * y + push_y
    h_zz, h_zy, h_yy = m_z, 0.0, inertia
    for i in range(FINGERS):
        t_z, t_y = a_z[i] - b * z, a_y[i] - b * y
        size = math.sqrt(t_z * t_z + t_y * t_y)
        if size <= cap[i]:
            value += 0.5 * size * size / b
            g_z, g_y = g_z - t_z, g_y - t_y
            h_zz, h_yy = h_zz + b, h_yy + b
        else:
            value += cap[i] * (size - 0.5 * cap[i]) / b
            cut = cap[i] / size
            g_z, g_y = g_z - cut * t_z, g_y - cut * t_y
            h_zz += b * cut * t_y * t_y / (size * size)
            h_zy -= b * cut * t_z * t_y / (size * size)
            h_yy += b * cut * t_z * t_z / (size * size)
    return value, g_z, g_y, h_zz, h_zy, h_yy


@njit(cache=True)
def _half_sine(since_s: float, duration_s: float, impulse_n_s: float) -> float:
    phase = since_s / duration_s if duration_s > 0.0 else -1.0
    if phase <= 0.0 or phase >= 1.0:
        return 0.0
    force: float = 0.5 * math.pi * impulse_n_s / duration_s * math.sin(math.pi * phase)
    return force


@njit(cache=True)
def tap_force(s: Floats, t_s: float) -> float:
    """Force, N, of the mallet at time t_s: a half sine that carries TAP_N_S in all, then a longer
    one of FOLLOW_N_S while the hand follows through."""
    since = t_s - s[TAP_START_S]
    return _half_sine(since, s[TAP_S], s[TAP_N_S]) + _half_sine(
        since - s[TAP_S], s[FOLLOW_S], s[FOLLOW_N_S]
    )


@njit(cache=True)
def pull_force(s: Floats, t_s: float) -> float:
    """Force, N, of the steady pull at time t_s."""
    since, ramp_s = t_s - s[PULL_START_S], s[PULL_RAMP_S]
    if s[PULL_N] == 0.0 or since <= 0.0:
        return 0.0
    left = 2 * ramp_s + s[PULL_S] - since
    return float(s[PULL_N] * min(1.0, since / ramp_s, max(0.0, left / ramp_s)))


@njit(cache=True)
def _step(
    p: Floats, s: Floats, t_s: float, h: float, v_finger: float, travel: Floats, n: Floats
) -> None:
    """One backward Euler step of h seconds that ends at t_s."""
    gone = s[PRESENT] == 0.0 or abs(s[ACROSS]) > p[P_HALF_WIDTH]
    width, slope = (-1.0, 0.0) if gone else width_and_slope(p, s[SLIP])
    blow = tap_force(s, t_s - 0.5 * h)
    if blow > 0.0 and s[TAP_DIRECTION] == CLOSING:
        struck_normal_forces(p, width, travel, blow, s, n)
    else:
        normal_forces(p, width, travel, s, n)
    cos = 1.0 / math.sqrt(1.0 + slope * slope)
    b = (p[P_K_SHEAR] * h + p[P_C_SHEAR]) * cos
    a = np.empty(FINGERS)
    a_y = np.empty(FINGERS)
    cap = np.empty(FINGERS)
    push = p[P_MASS] * (GRAVITY_MPS2 - s[SPEED] / h)
    push += (blow if s[TAP_DIRECTION] == TOP else 0.0) + pull_force(s, t_s - 0.5 * h)
    push_y = -p[P_MASS] * s[ACROSS_SPEED] / h - (blow if s[TAP_DIRECTION] == SIDE else 0.0)
    for i in range(FINGERS):
        mu = p[P_MU_K] if s[SLIDING + i] != 0.0 else p[P_MU_S]
        cap[i] = mu * n[i] * cos
        touching = 1.0 if n[i] > 0.0 else 0.0
        a[i] = touching * p[P_K_SHEAR] * s[STRETCH + i] * cos + b * v_finger
        a_y[i] = touching * p[P_K_SHEAR] * s[STRETCH_ACROSS + i] * cos
        push -= n[i] * slope  # above the widest point (slope < 0) closing pushes the object down
    if push_y == 0.0:  # nothing has ever struck the side: the exact scalar step
        v, w = solve_velocity(p[P_MASS] / h, push, a, b, cap), 0.0
    else:
        v, w = solve_planar(
            p[P_MASS] / h, push, push_y, cos, a / cos, a_y / cos, b / cos, cap / cos
        )
    if s[HEIGHT] + h * v < 0.0:
        v = -s[HEIGHT] / h  # the table
    _settle(p, s, h, cos, v_finger, v, w, a, a_y, b, cap, n)
    if n.max() > 0.0:
        s[SLOPE] = slope


@njit(cache=True)
def _settle(
    p: Floats, s: Floats, h: float, cos: float, v_finger: float, v: float, w: float,
    a: Floats, a_y: Floats, b: float, cap: Floats, n: Floats,
) -> None:  # fmt: skip
    """Bring the state to the end of a step with object velocity v up and w across."""
    relative = v_finger - v
    all_slide, touching_any = True, False
    damper = p[P_C_SHEAR] / h
    for i in range(FINGERS):
        trial_z, trial_y = a[i] - b * v, a_y[i] - b * w
        size = abs(trial_z) if trial_y == 0.0 else math.sqrt(trial_z * trial_z + trial_y * trial_y)
        force = min(max(trial_z, -cap[i]), cap[i]) if trial_y == 0.0 else trial_z
        force_y = trial_y
        slides = n[i] > 0.0 and size > cap[i]
        if slides and trial_y != 0.0:
            force, force_y = trial_z * cap[i] / size, trial_y * cap[i] / size
        if n[i] <= 0.0:
            s[STRETCH + i] = 0.0
            s[STRETCH_ACROSS + i] = 0.0
        elif slides:
            old, old_y = s[STRETCH + i], s[STRETCH_ACROSS + i]
            s[STRETCH + i] = (force / cos + damper * old) / (p[P_K_SHEAR] + damper)
            s[STRETCH_ACROSS + i] = (force_y / cos + damper * old_y) / (p[P_K_SHEAR] + damper)
        else:
            s[STRETCH + i] += h * relative
            s[STRETCH_ACROSS + i] -= h * w
        s[SLIDING + i] = 1.0 if slides else 0.0
        s[NORMAL + i] = n[i]
        s[SHEAR + i] = force if n[i] > 0.0 or trial_y == 0.0 else 0.0
        s[PEAK + i] = max(s[PEAK + i], n[i])
        if n[i] > 0.0:
            touching_any = True
            all_slide = all_slide and slides
            compression = n[i] / p[P_STIFFNESS + i] + p[P_RELAX] * s[RELAXED + i]
            s[RELAXED + i] += (compression - s[RELAXED + i]) * h / (h + p[P_TAU])
        else:
            s[RELAXED + i] *= p[P_TAU] / (h + p[P_TAU])
    s[HEIGHT] = max(0.0, s[HEIGHT] + h * v)
    s[SPEED] = v
    s[SLIP] += h * relative
    s[ACROSS] += h * w
    s[ACROSS_SPEED] = w
    slip_speed = relative if w == 0.0 else math.sqrt(relative * relative + w * w)
    s[SLIP_SPEED] = slip_speed if all_slide and touching_any else 0.0


@njit(cache=True)
def _note(p: Floats, s: Floats, t_s: float) -> None:
    """Write down when gross slip set in, when the force rose after it, and what a blow moved."""
    gross = abs(s[SLIP_SPEED]) > p[P_GROSS_SLIP]
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
def advance(
    p: Floats, s: Floats, t_s: float, dt_s: float, step_s: float,
    finger_rise_m: float, v0: float, v1: float, travel0: Floats, travel1: Floats,
) -> None:  # fmt: skip
    """Advance the state by dt_s. The fingers rise by finger_rise_m with speeds v0 -> v1 at the ends
    and close from travel0 to travel1 (3,), m. Records the onset of gross slip: the first instant at
    which every touching pad slides faster than 3 mm/s, the object lagging or running ahead; and,
    after it, the first rise of the thumb's force.
    """
    since_blow = t_s + dt_s - s[TAP_START_S] if s[TAP_S] > 0.0 else -1.0
    if 0.0 < since_blow < BLOW_LASTS_S + dt_s:
        step_s = min(step_s, BLOW_STEP_S)
    steps = max(1, math.ceil(dt_s / step_s - 1e-9))
    h = dt_s / steps
    mean = finger_rise_m / dt_s
    travel = np.empty(FINGERS)
    n = np.empty(FINGERS)
    for j in range(steps):
        middle = (j + 0.5) / steps
        end = (j + 1.0) / steps
        for i in range(FINGERS):
            travel[i] = travel0[i] + (travel1[i] - travel0[i]) * end
        _step(p, s, t_s + (j + 1) * h, h, mean + (v1 - v0) * (middle - 0.5), travel, n)
        _note(p, s, t_s + (j + 1) * h)
