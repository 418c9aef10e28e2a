"""Fault: one value that describes an error, from its detection to a run's result and exit code."""

from collections.abc import Iterable
from typing import Self

import msgspec

from drivers.errors import GraspError, Stale

ARM, GRIPPER, FINGERTIPS, DETECTOR, LOOP = "arm", "gripper", "fingertips", "detector", "loop"
WORLD = "world"  # the process that emulates the devices
TRIAL = "trial"  # no device: the object's state, or a request of the operator

# Kinds in addition to those of ``drivers.errors``. Each has an exit code (grasp/cli/exits.py).
IMPLAUSIBLE = "implausible"  # a plausibility check failed: the device's data are wrong
SAFETY_STOP = "safety_stop"
INTERRUPTED = "interrupted"
INTERNAL = "internal"
LOST = "lost"  # the object; the verdict says what that means
SHOWN_CODE_KINDS = frozenset({IMPLAUSIBLE, Stale.kind, INTERNAL, LOST})  # shown with their code


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
        """Make a fault from an error that a device's driver raised."""
        return cls(error.kind, device, error.message, error.remedy, kind=error.kind)

    @property
    def line(self) -> str:
        """The message, preceded by the code where the documentation lists it."""
        return f"{self.code}: {self.message}" if self.kind in SHOWN_CODE_KINDS else self.message


def stale(device: str, message: str) -> Fault:
    """Make the fault of a device that has not reported for too long."""
    remedy = f"check cable, power and load of the {device}, then run `grasp doctor`"
    return Fault(Stale.kind, device, message, remedy, kind=Stale.kind)


def lines(faults: Iterable[Fault]) -> str:
    """All faults in one line."""
    return "; ".join(fault.line for fault in faults)
