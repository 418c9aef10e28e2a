"""Reference solution of the contact levels by adaptive Runge-Kutta.

It shares only the friction law with the backward Euler of a run.

A pad with a damper is an ordinary differential equation. Its force f is the radial return of
k s + c u, and the stretch follows s' = (f - k s) / c. The adaptive method is the embedded pair of
Dormand and Prince (1980), 5(4). Halving places a step at each onset and end of sliding and at the
lift-off. The body must be straight and centred, without relaxation.
"""

import math

import numpy as np
from numba import njit

from scenarios.world import laws
from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats, elements, parameters
from scenarios.world.settings import Level
from studies.contact.scene import Scene, hand_height, hand_speed, mark_of, press, tap_wrench

LEAST_STEP_S = 1e-9
DORMAND_PRINCE = np.array([
    [0, 0, 0, 0, 0, 0],
    [1 / 5, 0, 0, 0, 0, 0],
    [3 / 40, 9 / 40, 0, 0, 0, 0],
    [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])  # fmt: skip
FIFTH = np.array([35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84, 0])
FOURTH = np.array([5179 / 57600, 0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40])
NODES = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
# Indices of the vector q: friction, pads, body, arm, vibration, tap; Q_ALONG: 1 if only z moves.
(Q_MASS, Q_INERTIA, Q_MU_S, Q_MU_K, Q_K, Q_C, Q_A, Q_V, Q_VIB, Q_W, Q_TAP, Q_TAP_S, Q_TAP_N_S,
 Q_ALONG) = range(14)  # fmt: skip


def grip_forces(scene: Scene) -> tuple[Floats, Floats]:
    """Normal forces (K, 3), N, linear between the knots (K,), s: the thumb starts and stops."""
    p, travel = parameters(scene.contact, scene.body), np.array(scene.travel_m)
    first, closing = press(p, travel), scene.closing
    if closing is None:
        return np.array([0.0, scene.duration_s]), np.array([first, first])
    stiffness = np.zeros(FINGERS)
    laws.normal_stiffness(p, first, 0.0, stiffness)
    closes_s = (closing.force_stop_n - first[0]) / (stiffness[0] * closing.speed_mps)
    travel[0] += closing.speed_mps * closes_s
    last = press(p, travel)
    start_s, end_s = closing.start_s, scene.duration_s
    return np.array([0.0, start_s, start_s + closes_s, end_s]), np.array([first, first, last, last])


@njit(cache=True)
def _imposed(q: Floats, t: float) -> tuple[float, float, float]:
    """Height and speed of the hand, and the force of the tap."""
    ramp = q[Q_V] / q[Q_A]
    within = min(t, ramp)
    z = 0.5 * q[Q_A] * within * within + q[Q_V] * (t - within)
    z -= q[Q_VIB] / q[Q_W] ** 2 * math.sin(q[Q_W] * t)
    v = q[Q_A] * within - q[Q_VIB] / q[Q_W] * math.cos(q[Q_W] * t)
    since, push = t - q[Q_TAP], 0.0
    if 0.0 < since < q[Q_TAP_S]:
        w = math.pi / q[Q_TAP_S]
        push = 0.5 * q[Q_TAP_N_S] * w * math.sin(w * since)
    return z, v, push


@njit(cache=True)
def _rates(
    t: float, x: Floats, flags: Floats, update: bool, q: Floats, wrench: Floats, finger: Floats,
    places: Floats, n: Floats, out: Floats,
) -> bool:  # fmt: skip
    """Derivative of x: pose (3), speed (3), stretch (E x 3). flags (E + 1): sliding, resting last.
    With ``update`` the flags are updated; returns whether one has changed."""
    hand_z, hand_v, push = _imposed(q, t)
    count = finger.shape[0]
    force_y, torque = push * wrench[0], push * wrench[2]
    force_z = push * wrench[1] - q[Q_MASS] * GRAVITY_MPS2
    changed = False
    for e in range(count):
        share = places[e, 3]
        y, z = places[e, 0] - x[0], places[e, 1] + hand_z - x[1]
        spin, at = places[e, 2], 6 + 3 * e
        s0, s1, s2 = x[at], x[at + 1], x[at + 2]
        f0 = share * (q[Q_K] * s0 - q[Q_C] * (x[3] - x[5] * z))
        f1 = share * (q[Q_K] * s1 + q[Q_C] * (hand_v - x[4] - x[5] * y))
        f2 = share * (q[Q_K] * s2 - q[Q_C] * spin * x[5])
        size = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
        mu = q[Q_MU_K] if flags[e] != 0.0 else q[Q_MU_S]
        cap = mu * n[int(finger[e])] * share
        if update and (size > cap) != (flags[e] != 0.0):
            flags[e] = 1.0 - flags[e]
            changed = True
        if size > cap:
            shrink = cap / size
            f0, f1, f2 = f0 * shrink, f1 * shrink, f2 * shrink
        out[at] = (f0 / share - q[Q_K] * s0) / q[Q_C]
        out[at + 1] = (f1 / share - q[Q_K] * s1) / q[Q_C]
        out[at + 2] = (f2 / share - q[Q_K] * s2) / q[Q_C]
        force_y += f0
        force_z += f1
        torque += y * f1 - z * f0 + spin * f2
    resting = flags[count] != 0.0
    if update and resting and force_z > 0.0:
        flags[count], resting, changed = 0.0, False, True
    for d in range(3):
        out[d] = 0.0 if resting else x[3 + d]
    out[3] = 0.0 if resting or q[Q_ALONG] != 0.0 else force_y / q[Q_MASS]
    out[4] = 0.0 if resting else force_z / q[Q_MASS]
    out[5] = 0.0 if resting or q[Q_ALONG] != 0.0 else torque / q[Q_INERTIA]
    return changed


@njit(cache=True)
def _stage(x: Floats, k: Floats, h: float, weights: Floats, count: int, out: Floats) -> None:
    """out = x + h sum of weights k over the first ``count`` stages."""
    out[:] = x
    for j in range(count):
        if weights[j] != 0.0:
            for d in range(x.shape[0]):
                out[d] += h * weights[j] * k[j, d]


@njit(cache=True)
def _error(k: Floats, h: float, weights: Floats, lower: Floats, tolerance_m: float) -> float:
    """Largest difference of the two orders over the tolerance; a speed counts for 10 ms of it."""
    worst: float = 0.0
    for d in range(k.shape[1]):
        e = 0.0
        for j in range(weights.shape[0]):
            e += h * (weights[j] - lower[j]) * k[j, d]
        worst = max(worst, abs(e) * (0.01 if 3 <= d < 6 else 1.0) / tolerance_m)
    return worst


@njit(cache=True)
def _integrate(
    x: Floats, flags: Floats, times: Floats, normal: Floats, tolerance_m: float,
    table: Floats, weights: Floats, lower: Floats, nodes: Floats,
    q: Floats, wrench: Floats, finger: Floats, places: Floats,
) -> None:  # fmt: skip
    """Integrate over all knots."""
    stages = weights.shape[0]
    k = np.empty((stages, x.shape[0]))
    trial, rate, n, saved = np.empty(x.shape[0]), np.empty(x.shape[0]), np.empty(3), flags.copy()
    h = 1e-5
    for segment in range(times.shape[0] - 1):
        t, end = times[segment], times[segment + 1]
        whole = end - t
        while end - t > 1e-13:
            h = min(h, end - t)
            for i in range(stages):
                share = (t + nodes[i] * h - times[segment]) / whole
                n[:] = normal[segment] * (1 - share) + normal[segment + 1] * share
                _stage(x, k, h, table[i], i, trial)
                _rates(t + nodes[i] * h, trial, flags, False, q, wrench, finger, places, n, k[i])
            _stage(x, k, h, weights, stages, trial)
            share = (t + h - times[segment]) / whole
            n[:] = normal[segment] * (1 - share) + normal[segment + 1] * share
            saved[:] = flags
            changed = _rates(t + h, trial, flags, True, q, wrench, finger, places, n, rate)
            error = _error(k, h, weights, lower, tolerance_m)
            if (error > 1.0 or changed) and h > LEAST_STEP_S:
                flags[:] = saved
                h *= 0.5 if error <= 1.0 else max(0.2, 0.9 * error**-0.2)
                continue
            x[:] = trial
            t += h
            h *= min(4.0, 0.9 * max(error, 1e-8) ** -0.2)
            if not abs(x[1]) < 1e3:  # diverged: stop before an overflow
                x[:] = np.nan
                return


def adaptive(scene: Scene, level: Level, tolerance_m: float, points: int = 6) -> Floats:
    """Displacement of the tape mark (2,), m; local error below tolerance_m a step."""
    body, pads, tap, end = scene.body, scene.contact, scene.tap, np.array([scene.duration_s])
    if body.centre_aside_m != 0.0 or body.centre_above_m != 0.0 or pads.relaxation_fraction != 0.0:
        raise ValueError("the reference solves only straight, centred bodies without relaxation")
    q = np.array([
        body.total_kg, body.inertia_kgm2, body.friction_static, body.friction_kinetic,
        pads.shear_stiffness_npm, pads.shear_damping_nspm, scene.arm_mps2, scene.arm_mps,
        scene.shake_mps2, scene.shake_radps, *((0.0, 0.0, 0.0) if tap is None else
        (tap.delay_s, tap.duration_s, tap.impulse_n_s)), float(level is Level.SLIDER),
    ])  # fmt: skip
    knots_s, forces_n = grip_forces(scene)
    ends = {scene.arm_mps / scene.arm_mps2, q[Q_TAP], q[Q_TAP] + q[Q_TAP_S], *knots_s.tolist()}
    times = np.array(sorted(t for t in ends if t <= scene.duration_s))
    normal = np.array([np.interp(times, knots_s, n) for n in forces_n.T]).T.copy()
    table = elements(level, points)
    finger, places = table[:, laws.E_FINGER].copy(), table[:, : laws.E_FINGER].copy()
    x, flags = np.zeros(6 + 3 * len(finger)), np.zeros(len(finger) + 1)
    x[4] = hand_speed(scene, np.zeros(1))[0]
    stretch = x[6:].reshape(len(finger), 3)
    stretch[:, 1] = scene.initial_stretch(normal[0])[finger.astype(int)]
    flags[-1] = float(scene.on_table)
    wrench = np.zeros(3) if tap is None else tap_wrench(tap)
    rule = DORMAND_PRINCE, FIFTH, FOURTH, NODES
    _integrate(x, flags, times, normal, tolerance_m, *rule, q, wrench, finger, places)
    return mark_of(x[2], x[0], x[1] - hand_height(scene, end)[0])
