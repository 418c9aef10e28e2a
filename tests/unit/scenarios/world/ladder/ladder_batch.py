"""Many scenes at level L1 at once: one array formula, float64, run by NumPy or compiled.

``step`` is written once, without branches. NumPy runs it on arrays of scenes; numba runs the same
source on blocks of scenes whose inner loop the compiler turns into vector instructions. A test
holds both to the single-scene level and to one another, parallel to serial too. Straight bodies,
pads without relaxation, scenes of equal length.
"""

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numba import njit, prange
from numba.extending import overload, register_jitable

from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats
from scenarios.world.ladder import rigid
from scenarios.world.ladder.scene import Scene

LANES = 64  # scenes a block: their state stays in the first-level cache
# Rows of the parameter array (ROWS, scenes).
(
    R_MASS, R_MU_S, R_MU_K, R_K, R_C, R_TABLE, R_A, R_V, R_VIB, R_W, R_TAP, R_TAP_S, R_TAP_N_S,
    R_TOP,
) = range(14)  # fmt: skip
R_STRETCH, R_NORMAL = 14, 17
ROWS = 20


class Batch(msgspec.Struct, frozen=True):
    """Scenes as arrays: p (ROWS, scenes); ramps (K, 5, scenes): start, 1/length, gain of each
    finger's force. A term that no scene states is not computed."""

    p: Floats
    ramps: Floats
    duration_s: float
    vibrates: bool
    tapped: bool


def pack(scenes: Sequence[Scene]) -> Batch:
    """Raises ValueError for scenes that the formula does not cover or that differ in length."""
    if len({s.duration_s for s in scenes}) != 1:
        raise ValueError("scenes of one batch are equally long")
    if any(s.body.shape != "straight" or s.contact.relaxation_fraction for s in scenes):
        raise ValueError("a batch knows neither flanks nor relaxation")
    forces = [rigid.grip_forces(s) for s in scenes]
    knots = max(len(f.t_s) for f in forces)
    p, ramps = np.zeros((ROWS, len(scenes))), np.zeros((knots - 1, 2 + FINGERS, len(scenes)))
    for j, (scene, force) in enumerate(zip(scenes, forces, strict=True)):
        m = rigid.motion(scene)
        p[:R_A, j] = (
            scene.mass_kg, scene.body.friction_static, scene.body.friction_kinetic,
            scene.contact.shear_stiffness_npm, scene.contact.shear_damping_nspm, scene.on_table,
        )  # fmt: skip
        p[R_A:R_TOP, j] = m[: rigid.M_MASS]
        p[R_TOP, j] = scene.body.body_above_grip_m
        p[R_STRETCH : R_STRETCH + FINGERS, j] = scene.initial_stretch(force.force_n[0])
        p[R_NORMAL : R_NORMAL + FINGERS, j] = force.force_n[0]
        count, span = len(force.t_s) - 1, np.diff(force.t_s)
        ramps[:count, 0, j] = force.t_s[:-1]
        ramps[:count, 1, j] = 1.0 / np.maximum(span, 1e-12)
        ramps[:count, 2:, j] = np.diff(force.force_n, axis=0)
    used = np.abs(ramps[:, 2:]).sum(axis=(1, 2)) > 0.0
    return Batch(
        p, np.ascontiguousarray(ramps[used]), scenes[0].duration_s,
        bool(p[R_VIB].any()), bool(p[R_TAP_N_S].any()),
    )  # fmt: skip


def pick(condition: Any, yes: Any, no: Any) -> Any:
    """``np.where``; compiled for one scene it is a choice of two numbers, which np.where is not."""
    return np.where(condition, yes, no)


@overload(pick)
def _pick_compiled(condition: Any, yes: Any, no: Any) -> Any:
    # numba holds the two signatures against one another, annotations included
    def choose(condition: Any, yes: Any, no: Any) -> Any:
        return yes if condition else no

    return choose


@register_jitable
def clip(x: Any, limit: Any) -> Any:
    """x cut to -limit..limit."""
    return pick(x > limit, limit, pick(x < -limit, -limit, x))


@register_jitable
def narrow(x: Any, known: Any, law: Any) -> Any:
    """The nearest points below and above the root that are known, x taken into account."""
    low, r_low, high, r_high = known
    inertia, push, b, a0, a1, a2, c0, c1, c2 = law
    r = inertia * x + push
    r = r - clip(a0 - b * x, c0) - clip(a1 - b * x, c1) - clip(a2 - b * x, c2)
    below = (r <= 0.0) & (x > low)
    above = (r >= 0.0) & (x < high)
    low, r_low = pick(below, x, low), pick(below, r, r_low)
    high, r_high = pick(above, x, high), pick(above, r, r_high)
    return low, r_low, high, r_high


def step(
    z: Any, v: Any, s0: Any, s1: Any, s2: Any, g0: Any, g1: Any, g2: Any,
    n0: Any, n1: Any, n2: Any, hand: Any, down: Any, h: float,
    m: Any, mu_s: Any, mu_k: Any, k: Any, c: Any, table: Any,
) -> Any:  # fmt: skip
    """One backward Euler step of every scene: height, speed, stretches, sliding flags (0 or 1).

    The balance of inertia and three sliders rises with the speed and is linear between six break
    points: the one just below and the one just above its root give it exactly.
    """
    b = k * h + c
    c0 = n0 * (mu_s + g0 * (mu_k - mu_s))
    c1 = n1 * (mu_s + g1 * (mu_k - mu_s))
    c2 = n2 * (mu_s + g2 * (mu_k - mu_s))
    a0, a1, a2 = k * s0 + b * hand, k * s1 + b * hand, k * s2 + b * hand
    inertia = m / h
    push = m * GRAVITY_MPS2 + down - inertia * v
    known = -1e300, 0.0, 1e300, 0.0
    law = inertia, push, b, a0, a1, a2, c0, c1, c2
    # written out: a loop over a tuple could raise, and then no vector instructions would be used
    known = narrow((a0 - c0) / b, known, law)
    known = narrow((a0 + c0) / b, known, law)
    known = narrow((a1 - c1) / b, known, law)
    known = narrow((a1 + c1) / b, known, law)
    known = narrow((a2 - c2) / b, known, law)
    known = narrow((a2 + c2) / b, known, law)
    low, r_low, high, r_high = known
    span = r_high - r_low
    inside = low - r_low * (high - low) / pick(span > 0.0, span, 1.0)
    new = pick(low < -1e299, high - r_high / inertia, inside)
    new = pick(high > 1e299, low - r_low / inertia, new)
    new = pick((table > 0.0) & (z + h * new < 0.0), -z / h, new)
    d, stiff = c / h, k + c / h
    f0, f1, f2 = a0 - b * new, a1 - b * new, a2 - b * new
    p0 = clip(f0, c0)
    p1 = clip(f1, c1)
    p2 = clip(f2, c2)
    t0 = pick(c0 > 0.0, (p0 + d * s0) / stiff, 0.0)
    t1 = pick(c1 > 0.0, (p1 + d * s1) / stiff, 0.0)
    t2 = pick(c2 > 0.0, (p2 + d * s2) / stiff, 0.0)
    g0 = pick((p0 != f0) & (c0 > 0.0), 1.0, 0.0)
    g1 = pick((p1 != f1) & (c1 > 0.0), 1.0, 0.0)
    g2 = pick((p2 != f2) & (c2 > 0.0), 1.0, 0.0)
    return z + h * new, new, t0, t1, t2, g0, g1, g2


def hand_height(p: Any, t: float, vibrates: bool) -> Any:
    """Height of the hand at time t."""
    within = np.minimum(t, p[R_V] / np.maximum(p[R_A], 1e-12))
    z = 0.5 * p[R_A] * within * within + p[R_V] * (t - within)
    if vibrates:
        w = np.maximum(p[R_W], 1e-12)
        z = z - p[R_VIB] / (w * w) * np.sin(w * t)
    return z


def impulse(p: Any, t: float) -> Any:
    """Impulse of the tap until time t."""
    phase = (t - p[R_TAP]) / np.maximum(p[R_TAP_S], 1e-12)
    phase = np.minimum(np.maximum(phase, 0.0), 1.0)
    return 0.5 * p[R_TAP_N_S] * (1.0 - np.cos(math.pi * phase))


def run_numpy(batch: Batch, step_s: float) -> Floats:
    """Slip distance of every scene, (scenes,), m."""
    p, ramps = batch.p, batch.ramps
    steps = max(1, math.ceil(batch.duration_s / step_s - 1e-9))
    h = batch.duration_s / steps
    zero = np.zeros(p.shape[1])
    z, v = zero, -p[R_VIB] / np.maximum(p[R_W], 1e-12)
    flags: Any = (zero, zero, zero)
    s: Any = tuple(p[R_STRETCH : R_STRETCH + FINGERS])
    height = hand_height(p, 0.0, batch.vibrates)
    given = impulse(p, 0.0)
    for j in range(steps):
        t = (j + 1) * h
        n = p[R_NORMAL : R_NORMAL + FINGERS].copy()
        for ramp in ramps:
            n += ramp[2:] * np.minimum(np.maximum((t - ramp[0]) * ramp[1], 0.0), 1.0)
        n = pick(height - z < p[R_TOP], n, 0.0)
        risen = hand_height(p, t, batch.vibrates)
        total = impulse(p, t) if batch.tapped else given
        arguments: tuple[Any, ...] = (
            z, v, *s, *flags, *n, (risen - height) / h, (total - given) / h, h,
            p[R_MASS], p[R_MU_S], p[R_MU_K], p[R_K], p[R_C], p[R_TABLE],
        )  # fmt: skip
        z, v, *rest = step(*arguments)
        s, flags = tuple(rest[:FINGERS]), tuple(rest[FINGERS:])
        height, given = risen, total
    slip: Floats = height - z
    return slip


# A division that could raise would keep the compiler from using vector instructions.
_compiled = njit(error_model="numpy", forceinline=True)
_step, _hand_height, _impulse = _compiled(step), _compiled(hand_height), _compiled(impulse)


@njit(cache=True, error_model="numpy")
def _block(
    p: Floats, ramps: Floats, first: int, last: int, steps: int, h: float, vibrates: bool,
    tapped: bool, out: Floats,
) -> None:  # fmt: skip
    """Scenes first..last, step by step in lockstep."""
    count = last - first
    q = p[:, first:last].copy()
    # One array a quantity: only then does the compiler know that they do not overlap.
    z, v, hand, given = np.zeros(count), np.empty(count), np.empty(count), np.zeros(count)
    s0, s1, s2 = q[R_STRETCH].copy(), q[R_STRETCH + 1].copy(), q[R_STRETCH + 2].copy()
    g0, g1, g2 = np.zeros(count), np.zeros(count), np.zeros(count)
    n0, n1, n2 = np.empty(count), np.empty(count), np.empty(count)
    mass, mu_s, mu_k = q[R_MASS].copy(), q[R_MU_S].copy(), q[R_MU_K].copy()
    k, c, table = q[R_K].copy(), q[R_C].copy(), q[R_TABLE].copy()
    speed, down = np.empty(count), np.zeros(count)
    for i in range(count):
        v[i] = -q[R_VIB, i] / max(q[R_W, i], 1e-12)
        hand[i] = _hand_height(q[:, i], 0.0, vibrates)
    for j in range(steps):
        t = (j + 1) * h
        n0[:], n1[:], n2[:] = q[R_NORMAL], q[R_NORMAL + 1], q[R_NORMAL + 2]
        for r in range(ramps.shape[0]):
            ramp = ramps[r, :, first:last]
            for i in range(count):
                part = clip((t - ramp[0, i]) * ramp[1, i], 1.0)
                part = part if part > 0.0 else 0.0
                n0[i] += ramp[2, i] * part
                n1[i] += ramp[3, i] * part
                n2[i] += ramp[4, i] * part
        for i in range(count):
            on = 1.0 if hand[i] - z[i] < q[R_TOP, i] else 0.0
            n0[i], n1[i], n2[i] = on * n0[i], on * n1[i], on * n2[i]
            risen = _hand_height(q[:, i], t, vibrates)
            speed[i] = (risen - hand[i]) / h
            hand[i] = risen
        if tapped:
            for i in range(count):
                total = _impulse(q[:, i], t)
                down[i] = (total - given[i]) / h
                given[i] = total
        for i in range(count):
            z[i], v[i], s0[i], s1[i], s2[i], g0[i], g1[i], g2[i] = _step(
                z[i], v[i], s0[i], s1[i], s2[i], g0[i], g1[i], g2[i], n0[i], n1[i], n2[i],
                speed[i], down[i], h, mass[i], mu_s[i], mu_k[i], k[i], c[i], table[i],
            )  # fmt: skip
    for i in range(count):
        out[first + i] = hand[i] - z[i]


@njit(cache=True)
def _serial(
    p: Floats, ramps: Floats, steps: int, h: float, vibrates: bool, tapped: bool, out: Floats
) -> None:
    for block in range((out.shape[0] + LANES - 1) // LANES):
        first = block * LANES
        _block(p, ramps, first, min(first + LANES, out.shape[0]), steps, h, vibrates, tapped, out)


@njit(cache=True, parallel=True)
def _parallel(
    p: Floats, ramps: Floats, steps: int, h: float, vibrates: bool, tapped: bool, out: Floats
) -> None:
    # The scenes live in their own function: a scalar first set in an inner loop of a prange body is
    # silently 0 after it (numba 0.68.1).
    for block in prange((out.shape[0] + LANES - 1) // LANES):
        first = block * LANES
        _block(p, ramps, first, min(first + LANES, out.shape[0]), steps, h, vibrates, tapped, out)


def run(batch: Batch, step_s: float, parallel: bool = False) -> Floats:
    """As run_numpy, compiled. ``parallel``: on as many threads as numba may use."""
    steps = max(1, math.ceil(batch.duration_s / step_s - 1e-9))
    out = np.empty(batch.p.shape[1])
    kernel = _parallel if parallel else _serial
    kernel(batch.p, batch.ramps, steps, batch.duration_s / steps, batch.vibrates, batch.tapped, out)
    return out
