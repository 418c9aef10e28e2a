"""Cases in which a fault takes the only thing that could have kept the object or stopped the arm.

Written before any run of the plan was looked at, but for those that say otherwise. A run may show
what is named here, where it is named, if its last line or its outcome tells the user so.
"""

import re
from collections.abc import Collection

import msgspec

from grasp.phases import AIRBORNE_PHASES, Phase
from scenarios.studies.faults.cases import Fault

# before the hand is closed to the limit: the object rises with the first grasp's force alone
BEFORE_CLOSED = frozenset({"listen", "lift", "compensate"})
AIR = frozenset(phase.value for phase in AIRBORNE_PHASES) | BEFORE_CLOSED
ANY = frozenset(phase.value for phase in Phase)


class Declared(msgspec.Struct, frozen=True):
    """What may happen, and what the user is told; ``faults`` is a pattern of ``str(fault)``."""

    name: str
    faults: str
    phases: frozenset[str]  # of the end: the phase that the safe state followed
    may: frozenset[str]  # names of ``verdict.CHECKS``
    told: str  # a pattern of outcome and last line
    why: str
    lasting: bool = True  # only where the fault stays
    beforehand: bool = True  # no run had been looked at
    since: frozenset[str] = frozenset()  # of ``may``: what was added after runs had been

    def of(self, fault: Fault, recovers: bool) -> bool:
        return not (self.lasting and recovers) and re.fullmatch(self.faults, str(fault)) is not None

    def foretold(self, found: Collection[str]) -> bool:
        """Whether all of this had been named before any run was looked at."""
        return self.beforehand and self.since.isdisjoint(found)

    def covers(
        self, faults: Collection[tuple[Fault, bool]], phase: str, found: Collection[str], told: str
    ) -> bool:
        """Whether all that was found in a run is what this names: ``faults`` that explain it, and
        whether they ended by themselves."""
        meant = any(self.of(fault, ends) for fault, ends in faults)
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
        "the detector does not hear the slip, and nothing else tells of it",
        r"detector (hears nothing|frozen)", ANY,
        frozenset({"missed"}), r"^(dropped|undetected|cap_reached);",
        "the grasp stays too weak: the object stays on the table or slips back to it, and the "
        "outcome says that the lift failed",
        beforehand=False,
    ),
    Declared(
        "the detector hears a slip that there is none",
        r"detector hears slip", ANY,
        frozenset({"missed"}), r"^(false_start|alarm_stayed|cap_reached);",
        "the hand closes to the limit, which holds; the outcome says that the alarm was false",
        lasting=False, beforehand=False,
    ),
    Declared(
        "the arm does not take a stop", r"arm stop (lost|half done)", AIR | {"retreat", "release"},
        frozenset({"moving", "unstopped", "dropped", "time-out"}),
        r"arm (is )?still mov|cannot be believed|not heard",
        "nothing else of ours stops it: the emergency stop does, and the last line says so",
        since=frozenset({"unstopped"}),
    ),
    Declared(
        "another client has the hand release or change its mode",
        r"gripper (rATR|rMOD) set by another client", ANY,
        frozenset({"dropped", "hand", "misleading"}), r"automatic release|mode change|in mode",
        "it opens, and obeys nobody until it has: nothing that is written here stops that",
        lasting=False, beforehand=False,
    ),
    Declared(
        "another client raises force or speed while a finger closes",
        r"gripper (r(FR|SP)[ABC] set|all fingers closed) by another client", ANY,
        frozenset({"force"}), r"^over_force;",
        "no status shows either, and targets beside them are written over at the next refresh",
        lasting=False, beforehand=False,
    ),
    Declared(
        "another client goes on commanding the hand", r"gripper .* by another client", ANY,
        frozenset({"force", "unstopped", "hand", "dropped"}), r"another client",
        "each of its commands is written over at the next refresh and no earlier: what it presses "
        "or opens until then adds up",
        beforehand=False,
    ),
)  # fmt: skip
