"""Vibration of the fingertips' pads, stepped exactly over any time (compiled).

Numba's cache does not detect changes in an imported kernel, so this file imports none. Lengths in
millimetres.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

(
    WANDER_MM, FAST_S, SLOW_S, MODE_MM, MODE_RADPS, MODE_DAMPING, SWAY_MM, LEVER_X, LEVER_Y,
    SHIFT_MM, ROCK_RAD, JITTER_S, HELD_RADPS, HELD_DAMPING,
) = range(14)  # fmt: skip
PARAMETERS = 14
# Per pad: fast and slow wander, each with the process that drives it, and the arm's mode.
FAST, FAST_DRIVE, SLOW, SLOW_DRIVE, MODE_COS, MODE_SIN = range(6)
DISTURBANCE = 6
JITTERS = 4  # per pad: shift along x and y, tilt along x and y
# Directions of the hand's motion at the pads (normal, x, y, tilt along x, tilt along y), and per
# direction the hand's position, the held object's position and its speed.
DIRECTIONS = 5
HAND, OBJECT, SPEED = range(3)
FOLLOWING = 3


@njit(cache=True)
def shake(
    p: Floats, dt_s: float, arm_moves: bool, normals: Floats, disturbance: Floats,
    jitter_normals: Floats, jitters: Floats, normal_n: Floats, on_mounts: bool, mounts: Floats,
    stiffness: Floats, motion: Floats, shaking: Floats, totals: Floats, swayed: Floats,
    rocked: Floats,
) -> None:  # fmt: skip
    """Add vibration over dt_s to pads that press on a fixed surface: loads normal_n (F,) and motion
    (F, 2) of the scene become totals (F,), swayed (F, 2) and rocked (F, 2), rad.

    arm_moves, normals, disturbance as in ``disturb``; jitter_normals and jitters (F, JITTERS, 2) as
    in ``jitter``. stiffness (F,), N/mm, of the springs in contact; mounts (F,), N/mm. on_mounts:
    loads are those of mounts at approach zero, of either sign. shaking (F, 2): unit vectors along
    which the arm's mode sways.
    """
    added = np.empty(normal_n.shape[0])
    disturb(p, dt_s, arm_moves, normals, disturbance, added)
    jitter(p, dt_s, jitter_normals, jitters)
    for f in range(added.shape[0]):
        # springs in series: the base moves further by the mount's deflection
        totals[f] = normal_n[f] + added[f] * (stiffness[f] + mounts[f])
        if not on_mounts:
            totals[f] = max(totals[f], 0.0) if normal_n[f] > 0.0 else 0.0
        sway_mm = p[SWAY_MM] * disturbance[MODE_SIN, f]
        for c in range(2):
            shift_mm = p[SHIFT_MM] * (math.sqrt(2.0) * jitters[f, c, 0])
            swayed[f, c] = motion[f, c] + sway_mm * shaking[f, c] + shift_mm
            rocked[f, c] = p[ROCK_RAD] * (math.sqrt(2.0) * jitters[f, 2 + c, 0])


@njit(cache=True)
def shake_held(
    p: Floats, dt_s: float, arm_moves: bool, normals: Floats, disturbance: Floats,
    jitter_normals: Floats, jitters: Floats, normal_n: Floats, stiffness: Floats, pull: Floats,
    sides: Floats, following: Floats, motion: Floats, shaking: Floats, totals: Floats,
    swayed: Floats, rocked: Floats,
) -> None:  # fmt: skip
    """As ``shake``, of pads that hold one free object, each on its side: sides (F,), +1 or -1.

    The hand shakes as a whole, by ``disturb`` and ``jitter`` of one pad, and the object follows
    with its inertia: following (DIRECTIONS, FOLLOWING). Friction pull (F, 2), N, on the pads' faces
    loads them through their levers, equally on both sides.
    """
    n = normal_n.shape[0]
    depth, hand = np.empty(1), np.empty(DIRECTIONS)
    disturb(p, dt_s, arm_moves, normals, disturbance, depth)
    jitter(p, dt_s, jitter_normals, jitters)
    hand[0] = depth[0]
    for c in range(2):
        jitter_mm = p[SHIFT_MM] * math.sqrt(2.0) * jitters[0, c, 0]
        hand[1 + c] = p[SWAY_MM] * disturbance[MODE_SIN, 0] * shaking[0, c] + jitter_mm
        hand[3 + c] = p[ROCK_RAD] * math.sqrt(2.0) * jitters[0, 2 + c, 0]
    follow(p[HELD_RADPS], p[HELD_DAMPING], dt_s, hand, following)
    left = hand - following[:, OBJECT]
    levered = np.empty(n)
    for f in range(n):
        levered[f] = -p[LEVER_X] * pull[f, 0] - p[LEVER_Y] * pull[f, 1]
    levered = on_a_free_object(levered, stiffness, sides)
    for f in range(n):
        totals[f] = normal_n[f] + sides[f] * left[0] * stiffness[f] + levered[f]
        totals[f] = max(totals[f], 0.0) if normal_n[f] > 0.0 else 0.0
        for c, side in enumerate((1.0, sides[f])):  # the pads face each other
            swayed[f, c] = motion[f, c] + side * left[1 + c]
            rocked[f, c] = side * left[3 + c]


@njit(cache=True)
def follow(radps: float, damping: float, dt_s: float, hand: Floats, following: Floats) -> None:
    """Motion of a damped mass on springs while the hand moves linearly to ``hand`` (DIRECTIONS,) in
    dt_s, stepped exactly. radps: natural frequency; damping: of critical, below 1."""
    decay, w = damping * radps, radps * math.sqrt(1.0 - damping * damping)
    keep = math.exp(-decay * dt_s)
    cos, sin = keep * math.cos(w * dt_s), keep * math.sin(w * dt_s) / w
    for k in range(hand.shape[0]):
        state = following[k]
        speed = (hand[k] - state[HAND]) / dt_s
        z, v = state[OBJECT] - state[HAND], state[SPEED] - speed  # relative to the hand
        state[HAND] = hand[k]
        state[OBJECT] = hand[k] + cos * z + sin * (v + decay * z)
        state[SPEED] = speed + cos * v - sin * (decay * v + radps * radps * z)


@njit(cache=True)
def on_a_free_object(added_n: Floats, stiffness: Floats, sides: Floats) -> Floats:
    """Load changes (F,) of pads on either side (+1 or -1) of a free object, from the changes
    added_n (F,) on a fixed one: the object moves until both sides change equally. stiffness (F,):
    of each pad's springs in contact, any unit; 0 without contact, where the load stays 0."""
    out = np.zeros(added_n.shape[0])
    push, total_stiffness = 0.0, 0.0
    for f in range(added_n.shape[0]):
        if stiffness[f] > 0.0:
            push += sides[f] * added_n[f]
            total_stiffness += stiffness[f]
    for f in range(added_n.shape[0]):
        if stiffness[f] > 0.0:
            out[f] = added_n[f] - sides[f] * stiffness[f] * push / total_stiffness
    return out


@njit(cache=True)
def disturb(
    p: Floats, dt_s: float, arm_moves: bool, normals: Floats, disturbance: Floats, pressed: Floats,
) -> None:  # fmt: skip
    """Depth of each pad beyond the commanded one, mm, into ``pressed`` (F,).

    Wander is an Ornstein-Uhlenbeck process filtered by another, which makes it as smooth as a
    force-controlled press. The arm's mode is a damped oscillation, driven while the arm moves and
    common to all pads. Both are stepped exactly over dt_s with standard normal ``normals``
    (4 F + 2,).
    """
    n = pressed.shape[0]
    keep = math.exp(-p[MODE_DAMPING] * p[MODE_RADPS] * dt_s)
    cos, sin = keep * math.cos(p[MODE_RADPS] * dt_s), keep * math.sin(p[MODE_RADPS] * dt_s)
    drive = math.sqrt(1.0 - keep * keep) if arm_moves else 0.0
    a, b = disturbance[MODE_COS, 0], disturbance[MODE_SIN, 0]
    disturbance[MODE_COS, :] = cos * a - sin * b + drive * normals[4 * n]
    disturbance[MODE_SIN, :] = sin * a + cos * b + drive * normals[4 * n + 1]
    for f in range(n):
        pad = disturbance[:, f]
        wander(dt_s / p[FAST_S], normals[f], normals[n + f], pad[FAST : FAST_DRIVE + 1])
        wander(dt_s / p[SLOW_S], normals[2 * n + f], normals[3 * n + f], pad[SLOW : SLOW_DRIVE + 1])
        pressed[f] = p[WANDER_MM] * (pad[FAST] + pad[SLOW])
        pressed[f] += p[MODE_MM] * pad[MODE_COS]


@njit(cache=True)
def wander(a: float, first: float, second: float, pair: Floats) -> None:
    """Step (y, x) over ``a`` time constants: x' = -x + white noise of variance 2, y' = x - y.
    The stationary variance of x is 1, of y 1/2. The noise of a step has the covariance of the
    exact solution; ``first`` and ``second`` are standard normal."""
    keep, keep2 = math.exp(-a), math.exp(-2.0 * a)
    xx, xy = 1.0 - keep2, 0.5 - keep2 * (a + 0.5)
    yy = 0.5 - keep2 * (a * (a + 1.0) + 0.5)
    y, x = pair[0], pair[1]
    pair[0] = keep * (y + a * x) + xy / math.sqrt(xx) * first
    pair[0] += math.sqrt(max(yy - xy * xy / xx, 0.0)) * second
    pair[1] = keep * x + math.sqrt(xx) * first


@njit(cache=True)
def jitter(p: Floats, dt_s: float, normals: Floats, state: Floats) -> None:
    """Step the jitter of each pad, sideways and in tilt: wander of variance 1/2 in each row of
    state (pads, JITTERS, 2), with standard normal ``normals`` (pads, JITTERS, 2)."""
    if p[SHIFT_MM] == 0.0 and p[ROCK_RAD] == 0.0:
        return
    for f in range(state.shape[0]):
        for k in range(JITTERS):
            wander(dt_s / p[JITTER_S], normals[f, k, 0], normals[f, k, 1], state[f, k])
