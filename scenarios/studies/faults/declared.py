"""Cases in which a fault takes the only thing that could have kept the object or stopped the arm.

Written before any run was looked at. A run may show what is named here, where it is named, if its
last line or its outcome tells the user so.
"""

import re
from collections.abc import Collection

import msgspec

from grasp.phases import AIRBORNE_PHASES
from scenarios.studies.faults.cases import Case, Fault

# before the hand is closed to the limit: the object rises with the first grasp's force alone
BEFORE_CLOSED = frozenset({"listen", "lift", "compensate"})
AIR = frozenset(phase.value for phase in AIRBORNE_PHASES) | BEFORE_CLOSED


class Declared(msgspec.Struct, frozen=True):
    """What may happen, and what the user is told; ``faults`` is a pattern of ``str(fault)``."""

    name: str
    faults: str
    phases: frozenset[str]  # of the end: the phase that the safe state followed
    may: frozenset[str]  # names of ``verdict.CHECKS``
    told: str  # a pattern of outcome and last line
    why: str
    lasting: bool = True  # only where the fault stays

    def of(self, fault: Fault, recovers: bool) -> bool:
        return not (self.lasting and recovers) and re.fullmatch(self.faults, str(fault)) is not None

    def covers(self, case: Case, phase: str, found: Collection[str], told: str) -> bool:
        """Whether all that was found in a run is what this names."""
        given = ((case.fault, case.recovers), (case.then, case.then_recovers))
        meant = any(fault is not None and self.of(fault, ends) for fault, ends in given)
        named = meant and phase in self.phases and set(found) <= self.may
        return named and re.search(self.told, told) is not None


CANNOT_BE_TOLD = r"holds by itself|not believed|refuses every motion|not heard"
DECLARED = (
    Declared(
        "the hand cannot be told to close", r"gripper link (cut|blinking|slow)", AIR,
        frozenset({"dropped"}), CANNOT_BE_TOLD,
        "with the force of the first grasp an object slips that only a closing could hold",
    ),
    Declared(
        "the hand does not take the closing", r"gripper (close|hold) (lost|late|half done)", AIR,
        frozenset({"dropped"}), CANNOT_BE_TOLD,
        "the same, though the hand answers",
    ),
    Declared(
        "the hand says that it is not to be moved", r"gripper g(ACT|IMC|FLT|MOD) .*", AIR,
        frozenset({"dropped"}), r"holds by itself|refuses every motion|not activated",
        "a hand that reports a fault, another mode or no activation is told nothing that moves it",
    ),
    Declared(
        "the arm does not take a stop", r"arm stop (lost|half done)", AIR | {"retreat", "release"},
        frozenset({"moving", "dropped", "time-out"}),
        r"arm (is )?still mov|cannot be believed|not heard",
        "nothing else of ours stops it: the emergency stop does, and the last line says so",
    ),
    Declared(
        "nobody is in control", r"loop stands still (0.3|1|3) s", AIR,
        frozenset({"dropped"}), r"loop_stood_still|dropped|expelled",
        "the arm's link stops the arm; slip that begins meanwhile is answered when that is back",
        lasting=False,
    ),
    Declared(
        "the detector is deaf, and does not show it", r"detector (hears nothing|frozen)", AIR,
        frozenset({"dropped"}), r"dropped|expelled|undetected|beyond_12cm|feels nothing|lost",
        "what it says is possible; only that contact is lost is noticed by others",
        lasting=False,
    ),
)  # fmt: skip
