"""What shakes the pads of the fingertips, stepped exactly over any time (compiled).

Numba's cache does not see changes in an imported kernel, so nothing of this file comes from
another. Lengths in millimetres.
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
# Of each pad: wander of either memory with what drives it, and the arm's mode.
FAST, FAST_DRIVE, SLOW, SLOW_DRIVE, MODE_COS, MODE_SIN = range(6)
DISTURBANCE = 6
JITTERS = 4  # of each pad: shift along x and y, rocking along x and y
# Of a held object: what the hand does to its pads (along their normal, along x and y, and tilts
# along x and y), and of each how far the object has followed, and how fast.
WAYS = 5
HAND, FOLLOWED, SPEED = range(3)
FOLLOWING = 3


@njit(cache=True)
def shake(
    p: Floats, dt_s: float, arm_moves: bool, draws: Floats, disturbance: Floats,
    jitter_draws: Floats, jitters: Floats, normal_n: Floats, hung: bool, mounts: Floats,
    stiffness: Floats, motion: Floats, shaking: Floats, totals: Floats, swayed: Floats,
    rocked: Floats,
) -> None:  # fmt: skip
    """Over dt_s, from loads normal_n (F,) and motion (F, 2) as the scene has them to totals (F,),
    swayed (F, 2) and rocked (F, 2), rad, of pads that press on what is fixed. arm_moves, draws,
    disturbance as in ``disturb``; jitter_draws and jitters (F, JITTERS, 2) as in ``jitter``.

    stiffness (F,), N/mm, of the springs in touch; mounts (F,) N/mm. hung: loads of mounts at
    approach zero, of either sign. shaking (F, 2): unit vectors along which the arm's mode sways.
    """
    added = np.empty(normal_n.shape[0])
    disturb(p, dt_s, arm_moves, draws, disturbance, added)
    jitter(p, dt_s, jitter_draws, jitters)
    for f in range(added.shape[0]):
        # in a series of springs, the base moves as much more as the mount gives way
        totals[f] = normal_n[f] + added[f] * (stiffness[f] + mounts[f])
        if not hung:
            totals[f] = max(totals[f], 0.0) if normal_n[f] > 0.0 else 0.0
        sway_mm = p[SWAY_MM] * disturbance[MODE_SIN, f]
        for c in range(2):
            shift_mm = p[SHIFT_MM] * (math.sqrt(2.0) * jitters[f, c, 0])
            swayed[f, c] = motion[f, c] + sway_mm * shaking[f, c] + shift_mm
            rocked[f, c] = p[ROCK_RAD] * (math.sqrt(2.0) * jitters[f, 2 + c, 0])


@njit(cache=True)
def shake_held(
    p: Floats, dt_s: float, arm_moves: bool, draws: Floats, disturbance: Floats,
    jitter_draws: Floats, jitters: Floats, normal_n: Floats, stiffness: Floats, pull: Floats,
    sides: Floats, following: Floats, motion: Floats, shaking: Floats, totals: Floats,
    swayed: Floats, rocked: Floats,
) -> None:  # fmt: skip
    """As ``shake``, of pads that hold one free object, each on its side: sides (F,), +1 or -1.

    The hand shakes as a whole, by what ``disturb`` and ``jitter`` say of the first pad (disturbance
    and jitters of one pad), and the object follows with its inertia: following (WAYS, FOLLOWING).
    Friction pull (F, 2), N, on the pads' faces loads them by their levers, alike on both sides.
    """
    n = normal_n.shape[0]
    depth, hand = np.empty(1), np.empty(WAYS)
    disturb(p, dt_s, arm_moves, draws, disturbance, depth)
    jitter(p, dt_s, jitter_draws, jitters)
    hand[0] = depth[0]
    for c in range(2):
        jitter_mm = p[SHIFT_MM] * math.sqrt(2.0) * jitters[0, c, 0]
        hand[1 + c] = p[SWAY_MM] * disturbance[MODE_SIN, 0] * shaking[0, c] + jitter_mm
        hand[3 + c] = p[ROCK_RAD] * math.sqrt(2.0) * jitters[0, 2 + c, 0]
    follow(p[HELD_RADPS], p[HELD_DAMPING], dt_s, hand, following)
    left = hand - following[:, FOLLOWED]
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
    """An object on springs follows the hand, which goes linearly to ``hand`` (WAYS,) in dt_s: a
    damped mass, stepped exactly. radps: of the mass on the springs; damping, below 1, of critical.
    """
    decay, w = damping * radps, radps * math.sqrt(1.0 - damping * damping)
    keep = math.exp(-decay * dt_s)
    cos, sin = keep * math.cos(w * dt_s), keep * math.sin(w * dt_s) / w
    for k in range(hand.shape[0]):
        own = following[k]
        speed = (hand[k] - own[HAND]) / dt_s
        z, v = own[FOLLOWED] - own[HAND], own[SPEED] - speed  # beside the hand, which is inertial
        own[HAND] = hand[k]
        own[FOLLOWED] = hand[k] + cos * z + sin * (v + decay * z)
        own[SPEED] = speed + cos * v - sin * (decay * v + radps * radps * z)


@njit(cache=True)
def on_a_free_object(added_n: Floats, stiffness: Floats, sides: Floats) -> Floats:
    """Loads (F,) that pads on either side (+1 or -1) of a free object gain when each would gain
    added_n (F,) on a fixed one: the object gives way until both sides gain alike. stiffness (F,):
    of each pad's springs in touch, any unit; 0 without touch, and nothing is gained there."""
    out = np.zeros(added_n.shape[0])
    push, whole = 0.0, 0.0
    for f in range(added_n.shape[0]):
        if stiffness[f] > 0.0:
            push += sides[f] * added_n[f]
            whole += stiffness[f]
    for f in range(added_n.shape[0]):
        if stiffness[f] > 0.0:
            out[f] = added_n[f] - sides[f] * stiffness[f] * push / whole
    return out


@njit(cache=True)
def disturb(
    p: Floats, dt_s: float, arm_moves: bool, draws: Floats, disturbance: Floats, pressed: Floats,
) -> None:  # fmt: skip
    """How much deeper each pad is held than asked for, mm (F,).

    Wander is an Ornstein-Uhlenbeck process that drags another behind it, so it is as
    smooth as what a force loop holds; the arm's mode is damped, turns as it decays, is driven while
    the arm moves, and is common to all pads. All are stepped exactly over dt_s with standard normal
    draws (4 F + 2,).
    """
    n = pressed.shape[0]
    keep = math.exp(-p[MODE_DAMPING] * p[MODE_RADPS] * dt_s)
    cos, sin = keep * math.cos(p[MODE_RADPS] * dt_s), keep * math.sin(p[MODE_RADPS] * dt_s)
    drive = math.sqrt(1.0 - keep * keep) if arm_moves else 0.0
    a, b = disturbance[MODE_COS, 0], disturbance[MODE_SIN, 0]
    disturbance[MODE_COS, :] = cos * a - sin * b + drive * draws[4 * n]
    disturbance[MODE_SIN, :] = sin * a + cos * b + drive * draws[4 * n + 1]
    for f in range(n):
        own = disturbance[:, f]
        wander(dt_s / p[FAST_S], draws[f], draws[n + f], own[FAST : FAST_DRIVE + 1])
        wander(dt_s / p[SLOW_S], draws[2 * n + f], draws[3 * n + f], own[SLOW : SLOW_DRIVE + 1])
        pressed[f] = p[WANDER_MM] * (own[FAST] + own[SLOW])
        pressed[f] += p[MODE_MM] * own[MODE_COS]


@njit(cache=True)
def wander(a: float, draw: float, other: float, pair: Floats) -> None:
    """Step (y, x) over ``a`` time constants: x' = -x + white noise of variance 2, y' = x - y.
    Variance of x is 1 in the long run, of y 1/2; the noise of a step has the covariance of the
    exact solution."""
    keep, gone = math.exp(-a), math.exp(-2.0 * a)
    xx, xy = 1.0 - gone, 0.5 - gone * (a + 0.5)
    yy = 0.5 - gone * (a * (a + 1.0) + 0.5)
    y, x = pair[0], pair[1]
    pair[0] = keep * (y + a * x) + xy / math.sqrt(xx) * draw
    pair[0] += math.sqrt(max(yy - xy * xy / xx, 0.0)) * other
    pair[1] = keep * x + math.sqrt(xx) * draw


@njit(cache=True)
def jitter(p: Floats, dt_s: float, draws: Floats, state: Floats) -> None:
    """Step the wander (unit variance 1/2) of each row of state (pads, JITTERS, 2) with standard
    normal draws (pads, JITTERS, 2): small motions of the pad sideways and about its axes."""
    if p[SHIFT_MM] == 0.0 and p[ROCK_RAD] == 0.0:
        return
    for f in range(state.shape[0]):
        for k in range(JITTERS):
            wander(dt_s / p[JITTER_S], draws[f, k, 0], draws[f, k, 1], state[f, k])
