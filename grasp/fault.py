"""Fault: what went wrong, as one value from where it is found to a run's result and exit code."""

from collections.abc import Iterable
from typing import Self

import msgspec

from drivers.errors import GraspError, Stale

ARM, GRIPPER, FINGERTIPS, DETECTOR, LOOP = "arm", "gripper", "fingertips", "detector", "loop"
WORLD = "world"  # beside the devices: the process that emulates them
TRIAL = "trial"  # no device: what became of the object, or a person's wish

# Kinds beside those of ``drivers.errors``. A kind has an exit code (grasp/cli/exits.py).
IMPLAUSIBLE = "implausible"  # a plausibility check failed: the device cannot be believed
SAFETY_STOP = "safety_stop"
INTERRUPTED = "interrupted"
INTERNAL = "internal"
LOST = "lost"  # the object; the verdict says what that means
NAMED = frozenset({IMPLAUSIBLE, Stale.kind, INTERNAL, LOST})  # kinds whose codes a user is shown


class Fault(msgspec.Struct, frozen=True):
    """Why a run ended early. ``code`` is its stable name, ``device`` one of the names above.

    ``message`` is for people and is never parsed; ``data`` has its numbers.
    """

    code: str
    device: str
    message: str
    remedy: str = ""
    data: dict[str, float | str] = {}
    kind: str = SAFETY_STOP

    @classmethod
    def of(cls, device: str, error: GraspError) -> Self:
        """What a device's driver raised."""
        return cls(error.kind, device, error.message, error.remedy, kind=error.kind)

    @property
    def line(self) -> str:
        """For people: with the code where the documentation lists it."""
        return f"{self.code}: {self.message}" if self.kind in NAMED else self.message


def stale(device: str, message: str) -> Fault:
    """A device that has not reported for too long."""
    remedy = f"check cable, power and load of the {device}, then run `grasp doctor`"
    return Fault(Stale.kind, device, message, remedy, kind=Stale.kind)


def lines(faults: Iterable[Fault]) -> str:
    """All of them in one line."""
    return "; ".join(fault.line for fault in faults)
