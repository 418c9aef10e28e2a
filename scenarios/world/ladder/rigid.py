"""Level L0: rigid Coulomb friction along z, event driven, every piece in closed form.

The object stands on the table, sticks to the hand or slides on it. Between two events its motion is
a polynomial plus the sines of tap and vibration; events (slip begins, slip stops, lift-off,
landing) are bracketed on a fine grid of a piece and bisected to rounding. No step size.
"""

import math

import msgspec
import numpy as np
from numba import njit

from scenarios.world import laws
from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats, initial_state, parameters
from scenarios.world.ladder.scene import Scene

TABLE, STICK, SLIDE = 0, 1, 2
TIE_S = 1e-12
# What moves hand and object besides friction: arm acceleration and speed, vibration acceleration
# and angular frequency, tap start, duration and impulse (down), mass, both friction coefficients.
(M_A, M_V, M_VIB, M_W, M_TAP, M_TAP_S, M_TAP_N_S, M_MASS, M_MU_S, M_MU_K) = range(10)


class GripForces(msgspec.Struct, frozen=True):
    """Normal forces, linear between the knots t_s (K,): force_n (K, 3)."""

    t_s: Floats
    force_n: Floats


def grip_forces(scene: Scene) -> GripForces:
    """Exact normal forces of a straight body without relaxation. One knot an event: a finger
    starts, touches, lets go or reaches its force stop."""
    p = parameters(scene.contact, scene.body)
    speed, stop_n = scene.closing_vector()[2:5].copy(), scene.closing_vector()[1]
    travel = np.array(scene.grip.travel_m)
    times, forces = [0.0], [press(p, travel)]
    if scene.grip.closing is None:
        return GripForces(np.array([0.0, scene.duration_s]), np.array(forces * 2))
    if scene.grip.closing.start_s > 0.0:
        times.append(scene.grip.closing.start_s)
        forces.append(forces[0])
    speed[forces[-1] >= stop_n] = 0.0
    while times[-1] < scene.duration_s and np.any(speed):
        span = _until_event(p, travel, speed, stop_n)
        travel += speed * span
        times.append(times[-1] + span)
        forces.append(press(p, travel))
        speed[forces[-1] >= stop_n * (1 - 1e-9)] = 0.0
        speed[travel >= p[laws.P_APERTURE] - 1e-12] = 0.0
    times.append(max(times[-1], scene.duration_s) + 1.0)
    forces.append(forces[-1])
    return GripForces(np.array(times), np.array(forces))


def press(p: Floats, travel: Floats) -> Floats:
    """Normal forces (3,), N, of fingers at ``travel`` (3,), m, before anything has slipped."""
    out = np.zeros(FINGERS)
    laws.normal_forces(p, p[laws.P_HALF_WIDTH], travel, initial_state(), out)
    return out


def _until_event(p: Floats, travel: Floats, speed: Floats, stop_n: float) -> float:
    """Seconds until a finger's force stops being linear in time: found where a straight line
    through the first instants no longer meets the force."""
    tiny = 1e-7
    start, soon = press(p, travel), press(p, travel + speed * tiny)
    slope = (soon - start) / tiny
    spans = [(p[laws.P_APERTURE] - t) / v for t, v in zip(travel, speed, strict=True) if v > 0]
    for i in range(FINGERS):
        if speed[i] > 0.0 and slope[i] > 0.0:
            spans.append((stop_n - start[i]) / slope[i])
    low, high = 0.0, float(max(tiny, min(spans)))
    if _near(press(p, travel + speed * high), start + slope * high, 1e-6):
        return high
    while high - low > 1e-12:  # a finger touches or lets go on the way
        middle = 0.5 * (low + high)
        straight = start + slope * middle
        here = press(p, travel + speed * middle)
        linear = _near(here, straight, 1e-8)
        low, high = (middle, high) if linear else (low, middle)
    return max(high, tiny)


def _near(a: Floats, b: Floats, tolerance_n: float) -> bool:
    return bool(np.abs(a - b).max() <= tolerance_n * (1.0 + np.abs(b).max()))


def motion(scene: Scene) -> Floats:
    """Parameter vector (10,) of the compiled solution."""
    m = np.zeros(10)
    if scene.arm is not None:
        m[[M_A, M_V]] = scene.arm.acceleration_mps2, scene.arm.speed_mps
    if scene.vibration is not None:
        m[[M_VIB, M_W]] = scene.vibration.acceleration_mps2, scene.vibration.rate
    if scene.tap is not None and scene.tap.direction == "top":
        tap = scene.tap
        m[[M_TAP, M_TAP_S, M_TAP_N_S]] = tap.delay_s, tap.duration_s, tap.impulse_n_s
    m[M_MASS] = scene.mass_kg
    m[M_MU_S], m[M_MU_K] = scene.body.friction_static, scene.body.friction_kinetic
    return m


@njit(cache=True)
def _hand(m: Floats, t: float) -> tuple[float, float, float]:
    """Height, speed and acceleration of the hand."""
    z, v, a = 0.0, 0.0, 0.0
    if m[M_V] > 0.0:
        ramp = m[M_V] / m[M_A]
        within = min(t, ramp)
        z = 0.5 * m[M_A] * within * within + m[M_V] * (t - within)
        v = m[M_A] * within
        a = m[M_A] if t < ramp - TIE_S else 0.0
    if m[M_VIB] > 0.0:
        sine = math.sin(m[M_W] * t)
        z -= m[M_VIB] / m[M_W] ** 2 * sine
        v -= m[M_VIB] / m[M_W] * math.cos(m[M_W] * t)
        a += m[M_VIB] * sine
    return z, v, a


@njit(cache=True)
def _tap(m: Floats, t: float) -> tuple[float, float, float]:
    """Twice integrated, integrated and instantaneous tap force since the scene began."""
    since = t - m[M_TAP]
    if m[M_TAP_N_S] == 0.0 or since <= 0.0:
        return 0.0, 0.0, 0.0
    w = math.pi / m[M_TAP_S]
    if since >= m[M_TAP_S]:
        return m[M_TAP_N_S] * (since - 0.5 * m[M_TAP_S]), m[M_TAP_N_S], 0.0
    impulse = 0.5 * m[M_TAP_N_S] * (1.0 - math.cos(w * since))
    twice = 0.5 * m[M_TAP_N_S] * (since - math.sin(w * since) / w)
    return twice, impulse, 0.5 * m[M_TAP_N_S] * w * math.sin(w * since)


@njit(cache=True)
def _slide(
    m: Floats, t0: float, u0: float, sign: float, n0: float, n1: float, t: float
) -> tuple[float, float]:
    """Slip distance and slip speed at t, of a slide that began at t0 with speed u0; normal force
    n0 + n1 (t - t0)."""
    x = t - t0
    z0, v0, _ = _hand(m, t0)
    z, v, _ = _hand(m, t)
    p0, i0, _ = _tap(m, t0)
    p, i, _ = _tap(m, t)
    k = sign * m[M_MU_K] / m[M_MASS]
    u = u0 + v - v0 + GRAVITY_MPS2 * x + (i - i0) / m[M_MASS] - k * (n0 * x + 0.5 * n1 * x * x)
    slip = u0 * x + (z - z0 - v0 * x) + 0.5 * GRAVITY_MPS2 * x * x
    slip += (p - p0 - i0 * x) / m[M_MASS] - k * (0.5 * n0 * x * x + n1 * x * x * x / 6.0)
    return slip, u


@njit(cache=True)
def _event(
    m: Floats, mode: int, t0: float, u0: float, sign: float, n0: float, n1: float, gap: float,
    t: float,
) -> float:  # fmt: skip
    """Positive while the mode goes on. gap: height of the object over the table at t0."""
    n = n0 + n1 * (t - t0)
    _, speed, a = _hand(m, t)
    _, _, push = _tap(m, t)
    left: float
    if mode == TABLE:
        left = m[M_MASS] * GRAVITY_MPS2 + push - (m[M_MU_K] * n if speed > 0.0 else 0.0)
    elif mode == STICK:
        left = m[M_MU_S] * n - abs(m[M_MASS] * (GRAVITY_MPS2 + a) + push)
    else:
        slip, u = _slide(m, t0, u0, sign, n0, n1, t)
        left = min(sign * u, _hand(m, t)[0] - _hand(m, t0)[0] - slip + gap)
    return left


@njit(cache=True)
def _begin(m: Floats, t: float, n: float, u: float, on_table: bool) -> tuple[int, float]:
    """Mode and direction of slip just after t, the object at the hand's speed or sliding."""
    _, _, a = _hand(m, t + 2 * TIE_S)
    _, _, push = _tap(m, t)
    need = m[M_MASS] * (GRAVITY_MPS2 + a) + push
    if abs(u) <= 1e-12:
        if abs(need) <= m[M_MU_S] * n:
            return STICK, 1.0
        return (TABLE if on_table and need > 0.0 else SLIDE), math.copysign(1.0, need)
    if on_table and u > 0.0 and m[M_MU_K] * n < m[M_MASS] * GRAVITY_MPS2 + push:
        return TABLE, 1.0
    return SLIDE, math.copysign(1.0, u)


@njit(cache=True)
def _leave(
    m: Floats, mode: int, t0: float, t1: float, u: float, sign: float, n0: float, n1: float,
    gap: float, grid_s: float,
) -> float:  # fmt: skip
    """First instant in (t0, t1] at which the mode ends, or t1."""
    count = max(32, math.ceil((t1 - t0) / grid_s))
    low = t0
    for j in range(1, count + 1):
        high = t0 + (t1 - t0) * j / count
        if _event(m, mode, t0, u, sign, n0, n1, gap, high) < 0.0:
            while high - low > TIE_S * max(1.0, high):
                middle = 0.5 * (low + high)
                if _event(m, mode, t0, u, sign, n0, n1, gap, middle) < 0.0:
                    high = middle
                else:
                    low = middle
            return high
        low = high
    return t1


@njit(cache=True)
def solve(
    m: Floats, knots: Floats, total_n: Floats, on_table: bool, grid_s: float
) -> tuple[float, float]:
    """Slip distance and slip speed at the end.

    knots (K,): every instant at which something sets in or ends, rising, the scene's end last;
    total_n (K,): sum of the normal forces there, linear in between.
    """
    slip, u = 0.0, 0.0
    resting = on_table
    z_object = 0.0
    for k in range(knots.shape[0] - 1):
        t, end = knots[k], knots[k + 1]
        n1 = (total_n[k + 1] - total_n[k]) / (end - t)
        while end - t > 2 * TIE_S:
            n = total_n[k] + n1 * (t - knots[k])
            mode, sign = _begin(m, t, n, u, resting)
            gap = z_object if on_table else np.inf
            until = _leave(m, mode, t, end, u, sign, n, n1, gap, grid_s)
            hand0, _, _ = _hand(m, t)
            hand1, speed1, _ = _hand(m, until)
            if mode == TABLE:
                slip += hand1 - hand0
                u = speed1
            elif mode == STICK:
                u = 0.0
            else:
                moved, u = _slide(m, t, u, sign, n, n1, until)
                slip += moved
                if sign * u <= 1e-12:
                    u = 0.0
            z_object = hand1 - slip
            resting = on_table and z_object <= 1e-12
            if resting and mode == SLIDE and z_object < 0.0:
                z_object, u = 0.0, speed1
            t = until
    return slip, u


def knots(scene: Scene, forces: GripForces) -> list[float]:
    """Every instant at which a term sets in, ends or changes its form; the first and last too."""
    times = {0.0, scene.duration_s, *forces.t_s.tolist()}
    if scene.arm is not None:
        times.add(scene.arm.speed_mps / scene.arm.acceleration_mps2)
    if scene.tap is not None:
        times |= {scene.tap.delay_s, scene.tap.delay_s + scene.tap.duration_s}
    return sorted(t for t in times if t <= scene.duration_s)


def run(scene: Scene) -> tuple[float, float, GripForces]:
    """Slip distance and slip speed at the end, and the normal forces."""
    m, forces = motion(scene), grip_forces(scene)
    times = np.array(knots(scene, forces))
    total = np.interp(times, forces.t_s, forces.force_n.sum(axis=1))
    grid_s = scene.duration_s
    if scene.vibration is not None:
        grid_s = 1.0 / (32 * scene.vibration.frequency_hz)
    if m[M_TAP_N_S] > 0.0:
        grid_s = min(grid_s, m[M_TAP_S] / 16)
    slip, u = solve(m, times, total, scene.on_table, grid_s)
    return slip, u, forces
