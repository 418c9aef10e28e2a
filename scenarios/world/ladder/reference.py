"""The law of levels L1 to L4 integrated by explicit Runge-Kutta: a reference with nothing in common
with backward Euler but the law itself, and the methods that it is compared with.

With its damper the pad is an ordinary differential equation: the force is the radial return of
k s + c u, and what the spring does not take up slides, s' = (f - k s) / c. Adaptive: the embedded
pair of Dormand and Prince (1980), 5(4); every onset and end of sliding, and the lift-off, are
stepped onto by halving. Straight bodies without relaxation only.
"""

import math

import msgspec
import numpy as np
from numba import njit

from scenarios.world import laws
from scenarios.world.contact import GRAVITY_MPS2, Floats, elements
from scenarios.world.ladder import rigid
from scenarios.world.ladder.drive import tap_wrench
from scenarios.world.ladder.levels import SceneOutcome, outcome
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level

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
EULER = np.zeros((1, 6)), np.ones(1), np.zeros(1)
RK4 = (
    np.array([[0.0] * 6, [0.5] + [0.0] * 5, [0, 0.5, 0, 0, 0, 0], [0, 0, 1.0, 0, 0, 0]]),
    np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
    np.array([0.0, 0.5, 0.5, 1.0]),
)


class Problem(msgspec.Struct, frozen=True):
    """A scene at one level as the right-hand side takes it."""

    m: Floats  # rigid.motion
    body: Floats  # shear stiffness, damping, inertia, centre of mass y and z; 1 if only z moves
    wrench: Floats  # (3,) of a tap of 1 N
    finger: Floats  # (E,)
    elements: Floats  # (E, 4)
    times: Floats  # (K,) knots of everything
    normal: Floats  # (K, 3) there
    on_table: bool


def problem(scene: Scene, level: Level, brush_points: int = 6) -> Problem:
    """Raises ValueError for flanks, relaxation and a pull, which it does not know."""
    if scene.pull is not None:
        raise ValueError("the reference knows no pull")
    if scene.body.shape != "straight" or scene.contact.relaxation_fraction != 0.0:
        raise ValueError("the reference knows straight bodies without relaxation only")
    m, forces = rigid.motion(scene), rigid.grip_forces(scene)
    wrench = np.zeros(3)
    if scene.tap is not None:
        m[[rigid.M_TAP, rigid.M_TAP_S]] = scene.tap.delay_s, scene.tap.duration_s
        m[rigid.M_TAP_N_S] = scene.tap.impulse_n_s
        wrench = tap_wrench(scene.tap)[[0, 1, 3]]
    body, pads = scene.body, scene.contact
    motion = np.array([
        pads.shear_stiffness_npm, pads.shear_damping_nspm, body.inertia_kgm2,
        body.centre_aside_m, body.centre_above_m, float(level is Level.SLIDER),
    ])  # fmt: skip
    times = np.array(rigid.knots(scene, forces))
    normal = np.array([np.interp(times, forces.t_s, n) for n in forces.force_n.T]).T.copy()
    table = elements(pads, level, brush_points)
    finger, places = table[:, laws.E_FINGER].copy(), table[:, : laws.E_FINGER].copy()
    return Problem(m, motion, wrench, finger, places, times, normal, scene.on_table)


@njit(cache=True)
def _imposed(m: Floats, t: float) -> tuple[float, float, float]:
    """Height and speed of the hand, and the force of the tap, from the vector of rigid.motion."""
    ramp = m[rigid.M_V] / m[rigid.M_A] if m[rigid.M_V] > 0.0 else 0.0
    within = min(t, ramp)
    z = 0.5 * m[rigid.M_A] * within * within + m[rigid.M_V] * (t - within)
    v = m[rigid.M_A] * within
    if m[rigid.M_VIB] > 0.0:
        z -= m[rigid.M_VIB] / m[rigid.M_W] ** 2 * math.sin(m[rigid.M_W] * t)
        v -= m[rigid.M_VIB] / m[rigid.M_W] * math.cos(m[rigid.M_W] * t)
    since, push = t - m[rigid.M_TAP], 0.0
    if 0.0 < since < m[rigid.M_TAP_S]:
        w = math.pi / m[rigid.M_TAP_S]
        push = 0.5 * m[rigid.M_TAP_N_S] * w * math.sin(w * since)
    return z, v, push


@njit(cache=True)
def _rates(
    t: float, x: Floats, flags: Floats, judge: bool, m: Floats, body: Floats, wrench: Floats,
    finger: Floats, elements: Floats, n: Floats, out: Floats,
) -> bool:  # fmt: skip
    """Derivative of x: pose (3), speed (3), stretch (E x 3). flags (E + 1): sliding, resting last.
    With ``judge`` the flags are brought up to date, and True means that one has changed."""
    hand_z, hand_v, push = _imposed(m, t)
    count = finger.shape[0]
    force_y, torque = push * wrench[0], push * wrench[2]
    torque -= body[3] * push * wrench[1] - body[4] * push * wrench[0]
    force_z = push * wrench[1] - m[rigid.M_MASS] * GRAVITY_MPS2
    changed = False
    for e in range(count):
        share = elements[e, 3]
        y = elements[e, 0] - body[3] - x[0]
        z = elements[e, 1] + hand_z - body[4] - x[1]
        spin, at = elements[e, 2], 6 + 3 * e
        s0, s1, s2 = x[at], x[at + 1], x[at + 2]
        f0 = share * (body[0] * s0 - body[1] * (x[3] - x[5] * z))
        f1 = share * (body[0] * s1 + body[1] * (hand_v - x[4] - x[5] * y))
        f2 = share * (body[0] * s2 - body[1] * spin * x[5])
        size = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
        mu = m[rigid.M_MU_K] if flags[e] != 0.0 else m[rigid.M_MU_S]
        cap = mu * n[int(finger[e])] * share
        if judge and (size > cap) != (flags[e] != 0.0):
            flags[e] = 1.0 - flags[e]
            changed = True
        if size > cap:
            shrink = cap / size
            f0, f1, f2 = f0 * shrink, f1 * shrink, f2 * shrink
        out[at] = (f0 / share - body[0] * s0) / body[1]
        out[at + 1] = (f1 / share - body[0] * s1) / body[1]
        out[at + 2] = (f2 / share - body[0] * s2) / body[1]
        force_y += f0
        force_z += f1
        torque += y * f1 - z * f0 + spin * f2
    resting = flags[count] != 0.0
    if judge and resting and force_z > 0.0:
        flags[count], resting, changed = 0.0, False, True
    for d in range(3):
        out[d] = 0.0 if resting else x[3 + d]
    out[3] = 0.0 if resting or body[5] != 0.0 else force_y / m[rigid.M_MASS]
    out[4] = 0.0 if resting else force_z / m[rigid.M_MASS]
    out[5] = 0.0 if resting or body[5] != 0.0 else torque / body[2]
    return changed


@njit(cache=True)
def _stage(
    x: Floats, k: Floats, h: float, weights: Floats, count: int, out: Floats
) -> None:  # fmt: skip
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
    x: Floats, flags: Floats, times: Floats, normal: Floats, tolerance_m: float, fixed_s: float,
    table: Floats, weights: Floats, lower: Floats, nodes: Floats,
    m: Floats, body: Floats, wrench: Floats, finger: Floats, elements: Floats,
) -> int:  # fmt: skip
    """Integrate over all knots; returns the evaluations. fixed_s > 0: no control of the step."""
    stages = weights.shape[0]
    k = np.empty((stages, x.shape[0]))
    trial, rate, n, saved = np.empty(x.shape[0]), np.empty(x.shape[0]), np.empty(3), flags.copy()
    evaluations: int = 0
    h = 1e-5
    for segment in range(times.shape[0] - 1):
        t, end = times[segment], times[segment + 1]
        whole = end - t
        fixed = whole / math.ceil(whole / fixed_s - 1e-9) if fixed_s > 0.0 else np.inf
        while end - t > 1e-13:
            h = min(fixed if fixed_s > 0.0 else h, end - t)
            for i in range(stages):
                share = (t + nodes[i] * h - times[segment]) / whole
                n[:] = normal[segment] * (1 - share) + normal[segment + 1] * share
                _stage(x, k, h, table[i], i, trial)
                at = t + nodes[i] * h
                _rates(at, trial, flags, False, m, body, wrench, finger, elements, n, k[i])
            evaluations += stages
            _stage(x, k, h, weights, stages, trial)
            share = (t + h - times[segment]) / whole
            n[:] = normal[segment] * (1 - share) + normal[segment + 1] * share
            saved[:] = flags
            changed = _rates(t + h, trial, flags, True, m, body, wrench, finger, elements, n, rate)
            error = 0.0 if fixed_s > 0.0 else _error(k, h, weights, lower, tolerance_m)
            if fixed_s == 0.0 and (error > 1.0 or changed) and h > LEAST_STEP_S:
                flags[:] = saved
                h *= 0.5 if error <= 1.0 else max(0.2, 0.9 * error**-0.2)
                continue
            x[:] = trial
            t += h
            h *= min(4.0, 0.9 * max(error, 1e-8) ** -0.2)
            if not abs(x[1]) < 1e3:  # diverged: spare the rest, and the overflow
                x[:] = np.nan
                return evaluations
    return evaluations


def adaptive(scene: Scene, level: Level, tolerance_m: float, brush_points: int = 6) -> SceneOutcome:
    """Reference of a scene at L1 to L4, local error held below tolerance_m a step."""
    rule = DORMAND_PRINCE, FIFTH, FOURTH, NODES
    return _run(problem(scene, level, brush_points), scene, level, tolerance_m, 0.0, rule)


def explicit(scene: Scene, level: Level, step_s: float, order: int) -> SceneOutcome:
    """Explicit Euler (order 1) or classical Runge-Kutta (4) at a fixed step; NaN: diverged."""
    table, weights, nodes = EULER if order == 1 else RK4
    rule = table, weights, weights, nodes
    return _run(problem(scene, level), scene, level, 1.0, step_s, rule)


def _run(
    q: Problem, scene: Scene, level: Level, tolerance_m: float, step_s: float,
    rule: tuple[Floats, Floats, Floats, Floats],
) -> SceneOutcome:  # fmt: skip
    count = len(q.finger)
    x, flags = np.zeros(6 + 3 * count), np.zeros(count + 1)
    x[4] = _imposed(q.m, 0.0)[1]
    stretch = x[6:].reshape(count, 3)
    stretch[:, 1] = scene.initial_stretch(q.normal[0])[q.finger.astype(int)]
    flags[count] = float(q.on_table)
    _integrate(
        x, flags, q.times, q.normal, tolerance_m, step_s, *rule,
        q.m, q.body, q.wrench, q.finger, q.elements,
    )  # fmt: skip
    hand_z, hand_v, _ = _imposed(q.m, scene.duration_s)
    pose, speed = x[:3] - [0.0, hand_z, 0.0], x[3:6] - [0.0, hand_v, 0.0]
    peak = float(q.normal.max())
    return outcome(scene, level, step_s, pose, speed, q.normal[-1], peak)
