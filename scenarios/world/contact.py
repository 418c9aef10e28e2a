"""Level L1 of the contact ladder: three compliant fingers on one object that slides up and down.

Normal forces: finger, pad and object wall in series, a linear spring each; one relaxation term a
finger (rubber, Prony form); the object is free along the closing axis, so that the thumb carries
the sum of the other two (quasi-static balance). Tangential forces: a Kelvin-Voigt spring and a
Coulomb slider a finger (Jenkins element), integrated by backward Euler with an exact solve of the
piecewise linear step equation, so it neither drifts inside the friction cone nor cycles at large
steps. Below the object is a table that can push but not pull.

Sign conventions: heights and velocities up; ``slip`` is finger height minus object height since
the start, positive when the object lags behind rising fingers.
"""

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numba import njit
from numpy.typing import NDArray

from scenarios.world.objects import GraspObject

GRAVITY_MPS2 = 9.81
FINGERS = 3
GROSS_SLIP_MPS = 0.003  # paper, section III-B: the bound of the label `slip`
Floats = NDArray[np.float64]


class ContactSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Compliances of hand and pads."""

    half_aperture_m: Annotated[
        float,
        Meta(gt=0.02, le=0.1, description="pad to centre plane, open; manual: 155 mm opening"),
    ] = 0.0775
    mount_stiffness_npm: Annotated[
        float,
        Meta(
            ge=500.0,
            le=1e6,
            description="linkage of one finger; assumed, 3-10 N/mm: without it "
            "one motor count would be 7-15 N and no insufficient grasp would exist",
        ),
    ] = 5000.0
    pad_stiffness_npm: Annotated[
        float, Meta(ge=500.0, le=1e6, description="10 mm urethane pad, normal; derived, 12-20 N/mm")
    ] = 15000.0
    pad_half_length_m: Annotated[
        float, Meta(ge=0.0, le=0.02, description="flat pad, along the slip; assumed, 8-12 mm")
    ] = 0.010
    shear_stiffness_npm: Annotated[
        float, Meta(ge=500.0, le=1e6, description="pad, tangential; derived, 6-12 N/mm")
    ] = 8000.0
    shear_damping_nspm: Annotated[
        float, Meta(ge=0.0, le=200.0, description="pad, tangential; assumed, 5-16 N s/m")
    ] = 12.0
    relaxation_fraction: Annotated[
        float, Meta(ge=0.0, le=0.5, description="of the normal force; real clip 0.05-0.15")
    ] = 0.1
    relaxation_time_s: Annotated[
        float, Meta(ge=0.01, le=5.0, description="of that fraction; real clip 0.1-0.3 s")
    ] = 0.2
    step_s: Annotated[float, Meta(ge=1e-5, le=0.05, description="largest integration step")] = 5e-4


# Layout of the state vector: one flat array, so that the compiled step takes a single object.
HEIGHT, SPEED, SLIP, LATERAL, ONSET_S, SLIP_SPEED = 0, 1, 2, 3, 4, 5
STRETCH, RELAXED, NORMAL, SHEAR, SLIDING, PEAK = 6, 9, 12, 15, 18, 21
SLOPE, ONSET_FORCE, RISE_S, PRESENT = 24, 25, 26, 27
TAP_START_S, TAP_S, TAP_NS = 28, 29, 30  # a half-sine pulse on top of the object
STATE_SIZE = 31
RISE_N = 0.2  # a grip force counts as increased by this much (a few wander deviations)
# and of the parameter vector.
(
    P_MASS, P_MU_S, P_MU_K, P_K_SHEAR, P_C_SHEAR, P_RELAX, P_TAU, P_APERTURE, P_PAD_HALF,
    P_SHAPE, P_HALF_WIDTH, P_HALF_HEIGHT, P_GRIP_HEIGHT, P_BODY_TOP, P_STIFFNESS,
) = range(15)  # fmt: skip
PARAMETER_SIZE = P_STIFFNESS + FINGERS
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
    """Parameter vector (18,) of the compiled step."""
    out = np.empty(PARAMETER_SIZE)
    out[:P_STIFFNESS] = (
        body.mass_kg + body.added_mass_kg, body.friction_static, body.friction_kinetic,
        contact.shear_stiffness_npm, contact.shear_damping_nspm,
        contact.relaxation_fraction, contact.relaxation_time_s,
        contact.half_aperture_m, contact.pad_half_length_m,
        0.0 if body.shape == "straight" else 1.0,
        body.half_width_m, body.half_height_m, body.grip_height_m, body.body_above_grip_m,
    )  # fmt: skip
    out[P_STIFFNESS:] = finger_stiffness(contact, body)
    return out


def initial_state(present: bool = True) -> Floats:
    """State vector (31,): object at rest on the table, nothing touched; or no object yet."""
    state = np.zeros(STATE_SIZE)
    state[PRESENT] = 1.0 if present else 0.0
    state[ONSET_S] = NOT_YET
    state[RISE_S] = NOT_YET
    return state


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
def tap_force(s: Floats, t_s: float) -> float:
    """Downward force, N, of the mallet at time t_s: a half sine that carries TAP_NS in all."""
    phase = (t_s - s[TAP_START_S]) / s[TAP_S] if s[TAP_S] > 0.0 else -1.0
    if phase <= 0.0 or phase >= 1.0:
        return 0.0
    force: float = 0.5 * math.pi * s[TAP_NS] / s[TAP_S] * math.sin(math.pi * phase)
    return force


@njit(cache=True)
def _step(
    p: Floats, s: Floats, t_s: float, h: float, v_finger: float, travel: Floats, n: Floats
) -> None:
    """One backward Euler step of h seconds that ends at t_s."""
    width, slope = width_and_slope(p, s[SLIP]) if s[PRESENT] != 0.0 else (-1.0, 0.0)
    normal_forces(p, width, travel, s, n)
    cos = 1.0 / math.sqrt(1.0 + slope * slope)
    b = (p[P_K_SHEAR] * h + p[P_C_SHEAR]) * cos
    a = np.empty(FINGERS)
    cap = np.empty(FINGERS)
    push = p[P_MASS] * (GRAVITY_MPS2 - s[SPEED] / h) + tap_force(s, t_s - 0.5 * h)
    for i in range(FINGERS):
        mu = p[P_MU_K] if s[SLIDING + i] != 0.0 else p[P_MU_S]
        cap[i] = mu * n[i] * cos
        touching = 1.0 if n[i] > 0.0 else 0.0
        a[i] = touching * p[P_K_SHEAR] * s[STRETCH + i] * cos + b * v_finger
        push -= n[i] * slope  # above the widest point (slope < 0) closing pushes the object down
    v = solve_velocity(p[P_MASS] / h, push, a, b, cap)
    if s[HEIGHT] + h * v < 0.0:
        v = -s[HEIGHT] / h  # the table
    relative = v_finger - v
    all_slide, touching_any = True, False
    for i in range(FINGERS):
        force = min(max(a[i] - b * v, -cap[i]), cap[i])
        slides = n[i] > 0.0 and abs(a[i] - b * v) > cap[i]
        old = s[STRETCH + i]
        if n[i] <= 0.0:
            s[STRETCH + i] = 0.0
        elif slides:
            damper = p[P_C_SHEAR] / h
            s[STRETCH + i] = (force / cos + damper * old) / (p[P_K_SHEAR] + damper)
        else:
            s[STRETCH + i] = old + h * relative
        s[SLIDING + i] = 1.0 if slides else 0.0
        s[NORMAL + i] = n[i]
        s[SHEAR + i] = force
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
    s[SLIP_SPEED] = relative if all_slide and touching_any else 0.0
    if touching_any:
        s[SLOPE] = slope


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
        if s[ONSET_S] == NOT_YET and abs(s[SLIP_SPEED]) > GROSS_SLIP_MPS:
            s[ONSET_S] = t_s + (j + 1) * h
            s[ONSET_FORCE] = s[NORMAL]
        elif s[ONSET_S] != NOT_YET and s[RISE_S] == NOT_YET:
            s[ONSET_FORCE] = min(s[ONSET_FORCE], s[NORMAL])
            if s[NORMAL] > s[ONSET_FORCE] + RISE_N:
                s[RISE_S] = t_s + (j + 1) * h
