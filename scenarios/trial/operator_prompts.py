"""Prompts to the operator of a real rig, who places objects and reads tape marks."""

import math
from typing import Protocol

import msgspec

from grasp.control.states import SAFE_STATES, State
from grasp.run import signals
from grasp.run.loop import Tick
from scenarios.rigs.rig import GraspRig

MOST_MM = 500.0
HOLD_S = 600.0  # at the top: the operator's reading ends the hold
WITHDRAWN = "Ignore the question: the trial ended before it was answered"
DEADLINE_S = 3600.0  # of a trial with an operator, who looks, measures and types


class Operator(Protocol):
    """The operator's terminal. ``poll`` returns a typed line, None if there is none yet."""

    def say(self, text: str) -> None: ...

    def poll(self) -> str | None: ...


class TapeMark(msgspec.Struct, frozen=True):
    """The operator's reading of the object's tape mark."""

    moved_m: float
    held: bool


def place_object(rig: GraspRig, operator: Operator, which: str) -> None:
    """Ask the operator to place the object and wait, keeping the devices active, hand open."""
    operator.say(
        f"{which}. Put the object on the table between the fingers, its mark at the pads: Enter"
    )
    while operator.poll() is None:
        signals.check()
        rig.wait_and_poll()


def read_mark(operator: Operator, line: str) -> TapeMark | None:
    """The reading on a typed line: millimetres, or l for lost. Otherwise asks again and returns
    None."""
    typed = line.strip()
    if typed.lower() in ("l", "lost"):
        return TapeMark(0.0, held=False)
    try:
        moved_mm = float(
            typed.lower().removesuffix("mm").replace(",", ".").replace("_", " ")
        )  # float() would accept 1_0, which is a typing error
    except ValueError:
        moved_mm = math.nan
    if 0.0 <= moved_mm <= MOST_MM:
        return TapeMark(moved_mm * 1e-3, held=True)
    operator.say(f"{typed!r} is not valid: type 0 to {MOST_MM:g} mm, or l for lost")
    return None


class SlipReading:
    """Asks the operator for the slip distance once the lifted object is held still."""

    def __init__(self, operator: Operator, hold_s: float) -> None:
        self.mark: TapeMark | None = None
        self._operator, self._hold_s = operator, hold_s
        self._since_s: float | None = None  # held at the top
        self._asked = False

    def take(self, tick: Tick) -> bool:
        """Take one tick; True when the object may be set down."""
        if self.mark is not None:
            return True
        if tick.decision.state in SAFE_STATES:
            self._give_up()
        elif self._asked:
            line = self._operator.poll()
            self.mark = None if line is None else read_mark(self._operator, line)
        elif tick.decision.state is State.HOLD and not tick.arm.moving:
            self._ask(tick.t_ns * 1e-9)
        return self.mark is not None

    def _give_up(self) -> None:
        """Withdraw an open question, so that the next message is not read as its answer."""
        if self._asked:
            self._operator.say(WITHDRAWN)
        self._asked = False

    def _ask(self, t_s: float) -> None:
        self._since_s = t_s if self._since_s is None else self._since_s
        if t_s - self._since_s >= self._hold_s:
            self._asked = True
            self._operator.say(
                "How far has the object slipped, pads to tape mark, in mm? (0: not at all; l: lost)"
            )
