"""Cases in which a fault takes the only thing that could have held the object or stopped the arm.

A run may show what is named here, where it is named, if its last line or outcome tells the user.
"""

import re
from collections.abc import Collection

import msgspec

from grasp.states import AIRBORNE_STATES, State
from tests.nightly.faults.cases import Fault
from tests.nightly.last_line import CANNOT_COMMAND

# with the first grasp's force alone, before the hand is closed to the limit, the object may rise
AIR = frozenset(phase.value for phase in AIRBORNE_STATES) | {"grasp.baseline"}
ANY = frozenset(phase.value for phase in State)


class Declared(msgspec.Struct, frozen=True):
    """What may happen, and what the user is told."""

    why: str
    faults: str  # pattern of ``str(fault)``
    phases: frozenset[str]  # that the safe state followed
    may: frozenset[str]  # names of ``verdict.CHECKS``
    told: str  # pattern of outcome and last line
    lasting: bool = True  # only where the fault stays

    def covers(
        self, faults: Collection[tuple[Fault, bool]], phase: str, found: Collection[str], told: str
    ) -> bool:
        """Whether this names all that was found; ``faults``: with whether they ended."""
        meant = any(
            not (self.lasting and ends) and re.fullmatch(self.faults, str(fault))
            for fault, ends in faults
        )
        named = meant and phase in self.phases and set(found) <= self.may
        return named and re.search(self.told, told) is not None


DECLARED = (
    Declared(
        "with the force of the first grasp an object slips that only a closing could hold",
        r"gripper link (cut|blinking)", AIR, frozenset({"dropped"}), CANNOT_COMMAND,
    ),
    Declared(
        "the same, though the hand answers",
        r"gripper (close|hold) lost", AIR, frozenset({"dropped"}), CANNOT_COMMAND,
    ),
    Declared(
        "a hand that reports a fault, another mode or no activation is not commanded",
        r"gripper g(ACT|IMC|FLT|MOD) .*", AIR, frozenset({"dropped"}),
        r"holds by itself|refuses every motion|not activated",
    ),
    Declared(
        "without detection the grasp stays too weak; the outcome says that the lift failed",
        r"detector detects nothing", ANY, frozenset({"missed"}),
        r"^(dropped|undetected|cap_reached);",
    ),
    Declared(
        "the hand closes to the limit, which holds; the outcome says that the alarm was false",
        r"detector detects slip", ANY, frozenset({"missed"}),
        r"^(false_start|alarm_stayed|cap_reached);", lasting=False,
    ),
    Declared(
        "nothing else stops an arm that takes no stop: the last line asks for the emergency stop",
        r"arm stop lost", AIR | {"release.open", "release.retreat"},
        frozenset({"moving", "unstopped", "dropped", "time-out"}),
        r"arm (is )?still mov|implausible|cannot be believed|does not report|not heard",
    ),
    Declared(
        "the hand opens and obeys nobody until it has",
        r"gripper (rATR|rMOD) set by another client", ANY,
        frozenset({"dropped", "hand", "misleading"}), r"automatic release|mode change|in mode",
        lasting=False,
    ),
    Declared(
        "no status shows force or speed; targets beside them are written over at the next refresh",
        r"gripper (r(FR|SP)[ABC] set|all fingers closed) by another client", ANY,
        frozenset({"force", "misleading"}), r"^over_force;", lasting=False,
    ),
    Declared(
        "a hand that reports no activation is not commanded, so another client's target stays",
        r"gripper rPR[ABC] set by another client", ANY, frozenset({"force"}),
        r"^over_force;.*not activated", lasting=False,
    ),
    Declared(
        "another client goes on: until the next refresh its commands act, and that adds up",
        r"gripper .* by another client", ANY,
        frozenset({"force", "unstopped", "hand", "dropped"}), r"another client",
    ),
)  # fmt: skip
