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
) = range(9)  # fmt: skip
PARAMETERS = 9
# Of each pad: wander of either memory with what drives it, and the arm's mode.
FAST, FAST_DRIVE, SLOW, SLOW_DRIVE, MODE_COS, MODE_SIN = range(6)
DISTURBANCE = 6
JITTERS = 4  # of each pad: shift along x and y, rocking along x and y


@njit(cache=True)
def shake(
    p: Floats, dt_s: float, arm_moves: bool, draws: Floats, disturbance: Floats,
    normal_n: Floats, hung: bool, mounts: Floats, stiffness: Floats, pull: Floats, sides: Floats,
    motion: Floats, shaking: Floats, shift: Floats, totals: Floats, swayed: Floats,
) -> None:  # fmt: skip
    """Over dt_s, from loads normal_n (F,) and motion (F, 2) as the scene has them to totals (F,)
    and swayed (F, 2) of pads that are shaken. arm_moves, draws, disturbance as in ``disturb``.

    stiffness (F,), N/mm, and pull (F, 2), N, of the springs in touch; mounts (F,) N/mm. sides (F,),
    +1 or -1, of the free object that the pads hold; empty: it is fixed. hung: loads of mounts at
    approach zero, of either sign. shaking (F, 2): unit vectors along which the arm's mode sways the
    pads; shift (F, 2): what moves them besides, mm.
    """
    added = np.empty(normal_n.shape[0])
    disturb(p, dt_s, arm_moves, draws, disturbance, added)
    free = sides.shape[0] > 0
    for f in range(added.shape[0]):
        # in a series of springs, the base moves as much more as the mount gives way
        added[f] *= stiffness[f] + mounts[f]
        if free:
            added[f] -= p[LEVER_X] * pull[f, 0] + p[LEVER_Y] * pull[f, 1]
    if free:
        added = on_a_free_object(added, stiffness, sides)
    for f in range(added.shape[0]):
        totals[f] = normal_n[f] + added[f]
        if not hung:
            totals[f] = max(totals[f], 0.0) if normal_n[f] > 0.0 else 0.0
        sway_mm = p[SWAY_MM] * disturbance[MODE_SIN, f]
        for c in range(2):
            swayed[f, c] = motion[f, c] + sway_mm * shaking[f, c] + shift[f, c]


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
def jitter(dt_s: float, memory_s: float, draws: Floats, state: Floats) -> None:
    """Step the wander (unit variance 1/2) of each row of state (pads, JITTERS, 2) with standard
    normal draws (pads, JITTERS, 2): small motions of the pad sideways and about its axes."""
    for f in range(state.shape[0]):
        for k in range(JITTERS):
            wander(dt_s / memory_s, draws[f, k, 0], draws[f, k, 1], state[f, k])
