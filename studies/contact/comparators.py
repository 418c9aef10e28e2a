"""Other friction laws along z, for comparison; no run uses them.

LuGre (Canudas de Wit 1995) with explicit Euler, RK4 and EXP2 (exact bristle update at the middle,
linearly implicit speed), and Coulomb regularised over a speed, explicit and linearly implicit.
"""

import math
from enum import IntEnum

import numpy as np
from numba import njit

from scenarios.world.contact import GRAVITY_MPS2, Floats
from studies.contact.reference import grip_forces
from studies.contact.scene import Scene, hand_height, hand_speed

STRIBECK_MPS = 1e-3  # LuGre: speed of the transition from static to kinetic friction
REGULAR_MPS = 1e-3  # regularised Coulomb: full friction from this speed on
_M, _MU_S, _MU_K, _K, _C, _TABLE = range(6)


class Method(IntEnum):
    """Law and integrator."""

    LUGRE_EULER = 0
    LUGRE_RK4 = 1
    LUGRE_EXP2 = 2
    REGULAR_EXPLICIT = 3
    REGULAR_IMPLICIT = 4


def run(scene: Scene, method: Method, step_s: float) -> Floats:
    """Displacement of the tape mark (2,), m, by another law; NaN where the method diverges."""
    steps = max(1, math.ceil(scene.duration_s / step_s - 1e-9))
    half_s = np.linspace(0.0, scene.duration_s, 2 * steps + 1)
    hand, down = hand_speed(scene, half_s), np.zeros(2 * steps + 1)
    if scene.tap is not None:
        phase = np.clip((half_s - scene.tap.delay_s) / scene.tap.duration_s, 0.0, 1.0)
        peak_n = 0.5 * math.pi * scene.tap.impulse_n_s / scene.tap.duration_s
        down = peak_n * np.sin(math.pi * phase)
    knots_s, forces_n = grip_forces(scene)
    normal = np.array([np.interp(half_s, knots_s, f) for f in forces_n.T]).T.copy()
    p = np.array([
        scene.body.total_kg, scene.body.friction_static, scene.body.friction_kinetic,
        scene.contact.shear_stiffness_npm, scene.contact.shear_damping_nspm, float(scene.on_table),
    ])  # fmt: skip
    stretch = scene.initial_stretch(normal[0])
    z, _ = _follow(p, steps, scene.duration_s / steps, hand, down, normal, stretch, int(method))
    return np.array([0.0, z - hand_height(scene, half_s[-1:])[0]])


@njit(cache=True)
def _bristle(p: Floats, u: float, z: float, n: float) -> tuple[float, float]:
    """Rate of a LuGre bristle deflected by z, and the finger's force."""
    if n <= 0.0:
        return 0.0, 0.0
    ratio = u / STRIBECK_MPS
    level = n * (p[_MU_K] + (p[_MU_S] - p[_MU_K]) * math.exp(-ratio * ratio))
    rate = u - p[_K] * abs(u) / level * z
    return rate, p[_K] * z + p[_C] * rate


@njit(cache=True)
def _lugre_rates(
    p: Floats, x: Floats, hand: float, down: float, n: Floats, resting: bool, out: Floats
) -> None:
    """Derivative of x: height, speed, three bristles."""
    force = 0.0
    for i in range(3):
        out[2 + i], f = _bristle(p, hand - x[1], x[2 + i], n[i])
        force += f
    out[0] = x[1]
    out[1] = (force - down) / p[_M] - GRAVITY_MPS2
    if resting and out[1] < 0.0:
        out[0], out[1] = 0.0, 0.0


@njit(cache=True)
def _explicit(
    p: Floats, x: Floats, h: float, j: int, hand: Floats, down: Floats, normal: Floats,
    resting: bool, order: int, k: Floats, trial: Floats,
) -> None:  # fmt: skip
    """Step of explicit Euler (order 1) or RK4; tables in half steps."""
    _lugre_rates(p, x, hand[2 * j], down[2 * j], normal[2 * j], resting, k[0])
    if order == 1:
        for d in range(5):
            x[d] += h * k[0, d]
        return
    for stage in range(1, 4):
        span, at = (0.5 * h, 2 * j + 1) if stage < 3 else (h, 2 * j + 2)
        for d in range(5):
            trial[d] = x[d] + span * k[stage - 1, d]
        _lugre_rates(p, trial, hand[at], down[at], normal[at], resting, k[stage])
    for d in range(5):
        x[d] += h / 6 * (k[0, d] + 2 * k[1, d] + 2 * k[2, d] + k[3, d])


@njit(cache=True)
def _exponential_step(
    p: Floats, x: Floats, h: float, hand: float, down: float, n: Floats, resting: bool
) -> None:
    """EXP2: two sweeps; bristles exact for the middle speed, the new speed linear in the force."""
    v1 = x[1]
    for sweep in range(2):
        u = hand - 0.5 * (x[1] + v1)
        force, slope = 0.0, 0.0
        for i in range(3):
            if n[i] <= 0.0:
                if sweep == 1:
                    x[2 + i] = 0.0
                continue
            ratio = u / STRIBECK_MPS
            level = n[i] * (p[_MU_K] + (p[_MU_S] - p[_MU_K]) * math.exp(-ratio * ratio))
            decay = p[_K] * abs(u) / level
            e = math.exp(-decay * h)
            phi = (1.0 - e) / decay if decay * h > 1e-9 else h
            end = e * x[2 + i] + phi * u
            force += p[_K] * 0.5 * (x[2 + i] + end) + p[_C] * (end - x[2 + i]) / h
            slope += p[_K] * 0.5 * phi + p[_C] * phi / h
            if sweep == 1:
                x[2 + i] = end
        # the force falls by slope / 2 for every m/s that the end speed exceeds the last guess
        rate = force - down - p[_M] * GRAVITY_MPS2 + 0.5 * slope * v1
        new = (p[_M] * x[1] / h + rate) / (p[_M] / h + 0.5 * slope)
        v1 = 0.0 if resting and new < 0.0 else new
    x[0] += 0.5 * h * (x[1] + v1)
    x[1] = v1


@njit(cache=True)
def _regular(
    p: Floats, x: Floats, h: float, hand: float, down: float, n: Floats, resting: bool,
    implicit: bool,
) -> None:  # fmt: skip
    """Friction mu N u / v_s up to the speed v_s, mu N beyond."""
    cap = p[_MU_K] * (n[0] + n[1] + n[2])
    push = down + p[_M] * GRAVITY_MPS2
    u = hand - x[1]
    v = x[1] + h / p[_M] * (cap * min(max(u / REGULAR_MPS, -1.0), 1.0) - push)
    if implicit:
        b = cap / REGULAR_MPS
        v = (p[_M] / h * x[1] + b * hand - push) / (p[_M] / h + b)
        if abs(hand - v) > REGULAR_MPS:
            v = x[1] + h / p[_M] * (math.copysign(cap, hand - v) - push)
    if resting and v < 0.0:
        v = 0.0
    x[0] += h * v
    x[1] = v


@njit(cache=True)
def _follow(
    p: Floats, steps: int, h: float, hand: Floats, down: Floats, normal: Floats, stretch: Floats,
    method: int,
) -> tuple[float, float]:  # fmt: skip
    """Height and speed of the object at the end; tables (2 steps + 1,) at half steps."""
    x, k, trial = np.zeros(5), np.empty((4, 5)), np.empty(5)
    x[1] = hand[0]
    x[2:] = stretch
    for j in range(steps):
        resting = p[_TABLE] != 0.0 and x[0] <= 0.0
        middle, end = 2 * j + 1, 2 * j + 2
        if method <= 1:
            order = 1 if method == 0 else 4
            _explicit(p, x, h, j, hand, down, normal, resting, order, k, trial)
        elif method == 2:
            _exponential_step(p, x, h, hand[middle], down[middle], normal[middle], resting)
        else:
            _regular(p, x, h, hand[end], down[middle], normal[end], resting, method == 4)
        if not abs(x[1]) < 1e6:
            return np.nan, np.nan
        if p[_TABLE] != 0.0 and x[0] < 0.0:
            x[0], x[1] = 0.0, max(x[1], 0.0)
    return x[0], x[1]
