"""Accepted failures: cases in which the fault removes the only way to hold the object or stop the
arm.

A run may have the problems listed here if its last line or outcome reports them to the user.
"""

import re
from collections.abc import Collection

import msgspec

from grasp.control.states import AIRBORNE_STATES, State
from tests.nightly.faults.cases import Fault
from tests.nightly.last_line import CANNOT_COMMAND, FIRST_GRASP

# the object may already rise before the hand is closed to the limit
AIR = frozenset(phase.value for phase in AIRBORNE_STATES) | {"grasp.baseline"}
ANY = frozenset(phase.value for phase in State)


class Declared(msgspec.Struct, frozen=True):
    """An accepted failure, and the text that must report it."""

    why: str
    faults: str  # pattern of ``str(fault)``
    phases: frozenset[str]  # before the safe state
    may: frozenset[str]  # names of ``verdict.CHECKS`` that may fail
    reported: str  # pattern of outcome and last line
    lasting: bool = True  # only for a permanent fault

    def covers(
        self, faults: Collection[tuple[Fault, bool]], phase: str, found: Collection[str], text: str
    ) -> bool:
        """Whether this covers all problems found; ``faults``: each with whether it ended."""
        matches = any(
            not (self.lasting and ends) and re.fullmatch(self.faults, str(fault))
            for fault, ends in faults
        )
        allowed = matches and phase in self.phases and set(found) <= self.may
        return allowed and re.search(self.reported, text) is not None


DECLARED = (
    Declared(
        "two wrong signals of hand or fingertips that agree look like contact, or like none",
        r"fingertips finger . (sticks high|close|drifts|frozen)",
        frozenset({"grasp.brace", "grasp.settle", "grasp.baseline"}),
        frozenset({"misleading"}), r"wider than its file says|bears nothing|no contact",
        lasting=False,
    ),
    Declared(
        "two wrong fingertips look like an overload, or hide slip; the outcome reports it",
        r"fingertips finger . (sticks high|close|drifts|frozen)", ANY,
        frozenset({"missed", "dropped"}), r"^(dropped|limit_reached|undetected|alarm_stayed);",
        lasting=False,
    ),
    *([Declared(
        "by touch, two wrong signals look like a contact, or hide one, before the object rises",
        r"fingertips finger . (sticks high|close|drifts|frozen)", ANY,
        frozenset({"misleading", "missed", "hand"}),
        r"feels nothing|nothing is between|not open|fingertip_dead|^(expelled|limit_reached);",
        lasting=False,
    )] if FIRST_GRASP == "touch" else []),
    Declared(
        "beside a second wrong fingertip, a thumb that reads too high bounds the safe closing",
        r"fingertips finger A sticks high", AIR, frozenset({"hand"}), r"fingertip_dead",
        lasting=False,
    ),
    Declared(
        "an object that slips with the force of the first grasp cannot be held without a closing",
        r"gripper link (cut|blinking)", AIR, frozenset({"dropped"}), CANNOT_COMMAND,
    ),
    Declared(
        "the same with a hand that is still connected",
        r"gripper (close|hold) lost", AIR, frozenset({"dropped"}), CANNOT_COMMAND,
    ),
    Declared(
        "a hand that reports a fault, another mode or no activation is not commanded",
        r"gripper g(ACT|IMC|FLT|MOD) .*", AIR, frozenset({"dropped"}),
        r"holds by itself|refuses every motion|not activated",
    ),
    Declared(
        "without slip detection the grasp stays too weak; the outcome reports the failed lift",
        r"detector detects nothing", ANY, frozenset({"missed"}),
        r"^(dropped|undetected|limit_reached);",
    ),
    Declared(
        "the hand closes to the limit and holds; the outcome reports the false alarm",
        r"detector detects slip", ANY, frozenset({"missed"}),
        r"^(false_start|alarm_stayed|limit_reached);", lasting=False,
    ),
    Declared(
        "an arm that loses every stop cannot be stopped: the last line asks for the emergency stop",
        r"arm stop lost", AIR | {"release.open", "release.retreat"},
        frozenset({"moving", "unstopped", "dropped", "time-out"}),
        r"arm (is )?still mov|implausible|does not report",
    ),
    Declared(
        "the hand opens and ignores commands until it is open",
        r"gripper (rATR|rMOD) set by another client", ANY,
        frozenset({"dropped", "hand", "misleading"}), r"automatic release|mode change|rMOD",
        lasting=False,
    ),
    Declared(
        "the status has no force or speed settings; changed targets last until the next refresh",
        r"gripper (r(FR|SP)[ABC] set|all fingers closed) by another client", ANY,
        frozenset({"force", "misleading"}), r"^over_force;", lasting=False,
    ),
    Declared(
        "a hand that reports no activation is not commanded, so another client's target stays",
        r"gripper rPR[ABC] set by another client", ANY, frozenset({"force"}),
        r"^over_force;.*not activated", lasting=False,
    ),
    Declared(
        "repeated commands of another client act until each next refresh",
        r"gripper .* by another client", ANY,
        frozenset({"force", "unstopped", "hand", "dropped"}), r"another client",
    ),
)  # fmt: skip
