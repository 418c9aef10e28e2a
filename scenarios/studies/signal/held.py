"""How much of what shakes a pressed pad is left where the hand holds the object.

A held object rides on the arm with its pads, a mass m on springs K: when the arm moves by w, the
pads deform by r with r'' + 2 zeta w0 r' + w0^2 r = -w'', w0^2 = K / m. So of a motion far below w0
little is left, (w / w0)^2, near it more than all, and above it all. The share of a motion with a
spectrum is that of the root mean squares. Whether the arm is as restless with an object in the hand
as while it presses by force, nobody has measured: that is assumed here.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenarios.world.contact import held_radps
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.fingertip_settings import FingertipSettings
from scenarios.world.objects import GraspObject

HIGHEST_HZ, STEP_HZ = 500.0, 0.05
Floats = NDArray[np.float64]


class HeldShares(msgspec.Struct, frozen=True):
    """Of one object: its frequency on the pads along their normal, and what is left of wander
    and of the arm's mode there."""

    held_hz: float
    wander: float
    vibration: float


def transfer(hz: Floats, held_hz: float, damping: float) -> Floats:
    """Relative motion of object and arm over the arm's, at each frequency."""
    r = hz / held_hz
    out: Floats = r**2 / np.sqrt((1.0 - r**2) ** 2 + (2.0 * damping * r) ** 2)
    return out


def wander_share(memories_s: tuple[float, ...], held_hz: float, damping: float) -> float:
    """Of wander, equal parts of such memories: a process that drags another behind it has the
    spectrum 1 / (1 + (w tau)^2)^2."""
    hz = np.arange(STEP_HZ, HIGHEST_HZ, STEP_HZ)
    power = sum(s / (1.0 + (2 * math.pi * hz * s) ** 2) ** 2 for s in memories_s)
    return float(np.sqrt((power * transfer(hz, held_hz, damping) ** 2).sum() / np.sum(power)))


def share(
    body: GraspObject, contact: ContactSettings, fingertip: FingertipSettings, damping: float
) -> HeldShares:
    """Of an object in three fingers; damping is that of the object on the pads, of critical."""
    held_hz = held_radps(contact, body) / (2 * math.pi)
    mode = float(transfer(np.array([fingertip.vibration_hz]), held_hz, damping)[0])
    memories = (fingertip.wander_fast_s, fingertip.wander_slow_s)
    return HeldShares(held_hz, wander_share(memories, held_hz, damping), mode)
