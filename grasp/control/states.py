"""The states of a grasp and every transition between them, as one table for `transitions`.

The only callback logs the change; nothing here commands a device. The diagram in
docs/architecture.md is made from this table.
"""

from enum import StrEnum

import msgspec
from transitions import EventData, Machine


class State(StrEnum):
    """State of a run. The part before the dot is the top level."""

    START = "approach.start"  # nothing has been commanded yet
    HOME = "approach.home"  # the arm on its way to the home of an earlier run
    SHAPE = "approach.shape"  # fingers on their way to just short of the object
    TARE = "grasp.tare"  # unloaded: rest counts are taken
    BRACE = "grasp.brace"  # B and C on their way to their positions on the object
    CLOSE = "grasp.close"  # the thumb closes last; for a firm grip then to the force limit
    SETTLE = "grasp.settle"  # the pads relax
    BASELINE = "grasp.baseline"  # the detector takes its baseline before the arm moves
    LIFT = "lift"  # the arm on its way up
    COMPENSATE = "compensate"  # the response to slip
    HOLD = "hold"  # at the top
    DESCEND = "lower.descend"  # fast, to the greatest height at which the object can stand
    FEEL = "lower.feel"  # slowly, until the grip shows that it stands (`grasp.control.set_down`)
    OPEN = "release.open"  # fingers on their way open
    RETREAT = "release.retreat"  # the arm on its way clear of the object
    SET_DOWN = "done.set_down"  # the object stands, and the arm is clear of it
    KEPT = "done.kept"  # held long enough, and kept in the hand as requested
    LOST = "lost"  # contact or object lost: the arm stops, nothing is set down
    STOPPED = "stopped"  # by a person: the arm stops, a grip is kept
    FAULT = "fault"


class Trigger(StrEnum):
    """Event that changes the state; the log has its cause as text."""

    AWAY = "away"  # a run begins with the arm away from its home
    AT_HOME = "at_home"
    SHAPED = "shaped"  # fingers just short of the object
    TARED = "tared"  # rest counts taken
    BRACED = "braced"  # B and C at their positions
    TIGHTEN = "tighten"  # a firm grip is set, or a finger bears nothing
    GRIPPED = "gripped"  # the grip is complete
    SETTLED = "settled"  # the pads have relaxed
    READY = "ready"  # the detector has a baseline: the arm may move
    SLIP = "slip"  # or contact lost, or more force due
    STEADY = "steady"  # slip is over, or no response is left; the arm continues up
    AT_TOP = "at_top"  # the same, with the arm at the top
    LOWER = "lower"  # held long enough; slip cannot be stopped; or no object can stand here yet
    FEEL = "feel"  # near where the object may stand, or the grip tightens; each step from there
    STANDS = "stands"  # the object stands: where the lift began, or earlier if it had slipped
    KEEP = "keep"  # held long enough, and `keep` is set
    OPENED = "opened"
    CLEAR = "clear"  # the arm is clear of the object
    LOSE = "lose"
    STOP = "stop"
    FAIL = "fail"


LOWERING_STATES = frozenset({State.DESCEND, State.FEEL})
AIRBORNE_STATES = LOWERING_STATES | {State.LIFT, State.COMPENSATE, State.HOLD, State.KEPT}
CLOSING_STATES = frozenset({State.BRACE, State.CLOSE})  # onto the object
GRIPPED_STATES = frozenset({State.SETTLE, State.BASELINE})  # all fingers in contact, at rest
CONTACT_STATES = AIRBORNE_STATES | CLOSING_STATES | GRIPPED_STATES
UNMOVED_STATES = frozenset({State.START, State.SET_DOWN})  # before and after all motion
OPEN_STATES = UNMOVED_STATES | {State.OPEN, State.RETREAT}  # no contact is expected
END_STATES = frozenset({State.SET_DOWN, State.KEPT})  # a run that succeeded has finished
SAFE_STATES = frozenset({State.LOST, State.STOPPED, State.FAULT})  # without transitions out
# states in which the run may have taken no rest counts
UNTARED_STATES = SAFE_STATES | {State.START, State.HOME, State.SHAPE}

# names of the top level, each for all states in it
LIFTED = ("lift", "compensate", "hold", "lower")
RUNNING = ("approach", "grasp", *LIFTED, "release", "done")

Transitions = tuple[tuple[Trigger, tuple[str, ...], State], ...]  # trigger, from, to

TRANSITIONS: Transitions = (
    (Trigger.AWAY, (State.START,), State.HOME),
    (Trigger.AT_HOME, (State.START, State.HOME), State.SHAPE),
    (Trigger.SHAPED, (State.SHAPE,), State.TARE),
    (Trigger.TARED, (State.TARE,), State.BRACE),
    (Trigger.BRACED, (State.BRACE,), State.CLOSE),
    (Trigger.TIGHTEN, (State.CLOSE, State.SETTLE), State.CLOSE),
    (Trigger.GRIPPED, (State.CLOSE,), State.SETTLE),
    (Trigger.SETTLED, (State.SETTLE,), State.BASELINE),
    (Trigger.READY, (State.BASELINE,), State.LIFT),
    (Trigger.SLIP, (State.LIFT, State.HOLD), State.COMPENSATE),
    (Trigger.STEADY, (State.COMPENSATE,), State.LIFT),
    (Trigger.AT_TOP, (State.LIFT, State.COMPENSATE), State.HOLD),
    (Trigger.LOWER, (State.HOLD, State.COMPENSATE, State.FEEL), State.DESCEND),
    (Trigger.FEEL, (State.DESCEND, State.FEEL), State.FEEL),
    (Trigger.STANDS, (State.FEEL,), State.OPEN),
    (Trigger.KEEP, (State.HOLD,), State.KEPT),
    (Trigger.OPENED, (State.OPEN,), State.RETREAT),
    (Trigger.CLEAR, (State.RETREAT,), State.SET_DOWN),
    (Trigger.LOSE, LIFTED, State.LOST),
    (Trigger.STOP, RUNNING, State.STOPPED),
    (Trigger.FAIL, RUNNING, State.FAULT),
)


class PhaseChange(msgspec.Struct, frozen=True):
    """Recorded transition: the state entered, the time, and the cause."""

    phase: str
    t_ns: int
    cause: str


class _Model:
    state: str  # set by `transitions`


def _within(names: tuple[str, ...]) -> list[str]:
    """The states with these names, and those in the top levels with these names."""
    return [s.value for s in State if {s.value, s.value.partition(".")[0]} & {*names}]


class StateMachine:
    """The current state and the log of transitions."""

    def __init__(self, state: State = State.START, transitions: Transitions = TRANSITIONS) -> None:
        self.state = state
        self.log: list[PhaseChange] = []
        self._model = _Model()
        self._machine = Machine(
            self._model, states=[str(s) for s in State], initial=state.value,
            transitions=[[str(t), _within(sources), str(to)] for t, sources, to in transitions],
            auto_transitions=False, send_event=True, after_state_change=self._note,
        )  # fmt: skip

    @property
    def before(self) -> State:
        """The state before the current one."""
        return State(self.log[-2].phase) if len(self.log) > 1 else State.START

    def first_ns(self, state: State) -> int:
        """Time at which a state was first entered, ns; raises ValueError if it never was."""
        return min(change.t_ns for change in self.log if change.phase == state)

    def fire(self, trigger: Trigger, t_ns: int, cause: str) -> None:
        """Make the transition; raises transitions.MachineError where the table has none."""
        self._machine.events[trigger.value].trigger(self._model, t_ns=t_ns, cause=cause)

    def _note(self, event: EventData) -> None:
        self.state = State(self._model.state)
        self.log.append(PhaseChange(self.state.value, event.kwargs["t_ns"], event.kwargs["cause"]))
