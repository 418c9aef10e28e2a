"""The phases of a grasp and every way from one to another, as one table for `transitions`.

Callbacks only note what happened; no device is touched from here, because an exception in an
`after` callback would leave the phase already changed.
"""

from enum import StrEnum

import msgspec
from transitions import EventData, Machine


class Phase(StrEnum):
    """Where a run stands."""

    IDLE = "idle"
    HOME = "home"  # the arm on its way to the home of an earlier run, the fingers as they are
    APPROACH = "approach"  # fingers on their way to just short of the object
    REST = "rest"  # there, unloaded: rest counts are taken
    GRASP = "grasp"  # B and C on their way to their positions on the object
    OPPOSE = "oppose"  # the thumb, last, on its way to its own
    SQUEEZE = "squeeze"  # a firm grip: the thumb closes until it stops at the force cap
    RELAX = "relax"  # the grip stands, the pads relax
    LISTEN = "listen"  # they have; the detector listens before the arm moves
    LIFT = "lift"  # the arm on its way up
    COMPENSATE = "compensate"
    HOLD = "hold"  # at the top
    LOWER = "lower"  # down to where the object may stand, had it slipped as far as it can have
    LAND = "land"  # from there slowly to where the lift began
    TOUCH = "touch"  # the grip has tightened on the way down: the arm stops, the pads relax
    PROBE = "probe"  # one small step down: an object that stands tightens the grip again
    RELEASE = "release"  # fingers on their way open
    RETREAT = "retreat"  # the arm on its way clear of the object
    DONE = "done"  # set down, and clear of it
    KEPT = "kept"  # held long enough, and nobody wants it set down
    LOST = "lost"  # the hand closed and met nothing: the arm stops, nothing is set down
    STOPPED = "stopped"  # by a person: the arm stops, a grip is kept
    FAULT = "fault"


class Trigger(StrEnum):
    """What makes the phase change."""

    START = "start"  # a run begins where the arm stands
    RETURN = "return"  # a run begins, elsewhere than its home
    RETURNED = "returned"  # the arm is there
    SHAPED = "shaped"  # fingers just short of the object
    RESTED = "rested"  # rest counts taken
    BRACED = "braced"  # B and C at their positions
    POSITIONED = "positioned"  # all fingers are, and a firm grip is wanted
    GRIPPED = "gripped"  # the grip is what it shall be
    RELAXED = "relaxed"  # the detector may listen
    LISTENED = "listened"  # long enough: the arm may move
    SLIP_REGISTERED = "slip_registered"
    FOUND = "found"  # by steps: a force that carries the object; it gets its margin
    SLIP_STOPPED = "slip_stopped"  # the arm is still on its way up
    SLIP_BORNE = "slip_borne"  # so it is; slip goes on at the force cap, and nobody minds
    LIFTED = "lifted"  # the arm is at the top, and nothing slips or nobody minds
    CAP_REACHED = "cap_reached"  # slip goes on although the force cannot rise any more
    FINISHED = "finished"  # held long enough: set it down
    KEEP = "keep"  # held long enough: that is all
    NEAR = "near"  # the arm is where the object may stand
    TIGHTENED = "tightened"  # the grip is tighter than when the way down began
    SETTLED = "settled"  # the arm stands, and what it feels is steady
    LOOSE = "loose"  # the step did not tighten the grip: either in the air, or of one width
    HIGH = "high"  # nor did it, and no object can stand yet
    LANDED = "landed"  # the object stands: where the lift began, or earlier if it had slipped
    OPENED = "opened"
    RETREATED = "retreated"
    LOSE = "lose"
    STOP = "stop"
    FAIL = "fail"


LOWERING_PHASES = frozenset({Phase.LOWER, Phase.LAND, Phase.TOUCH, Phase.PROBE})
AIRBORNE_PHASES = (
    frozenset({Phase.LIFT, Phase.COMPENSATE, Phase.HOLD, Phase.KEPT}) | LOWERING_PHASES
)
CLOSING_PHASES = frozenset({Phase.GRASP, Phase.OPPOSE, Phase.SQUEEZE})  # onto the object
CONTACT_PHASES = AIRBORNE_PHASES | CLOSING_PHASES | {Phase.RELAX, Phase.LISTEN}
# nobody has to feel anything
OPEN_PHASES = frozenset({Phase.IDLE, Phase.RELEASE, Phase.RETREAT, Phase.DONE})
UNMOVED_PHASES = frozenset({Phase.IDLE, Phase.DONE})  # nothing was told to move, or is any more
END_PHASES = frozenset({Phase.DONE, Phase.KEPT})  # all went well, and nothing more will follow
SAFE_PHASES = frozenset({Phase.LOST, Phase.STOPPED, Phase.FAULT})  # nothing leads out of them
# no rest counts have been taken, or a run has ended before it took any
UNRESTED_PHASES = SAFE_PHASES | {Phase.IDLE, Phase.HOME, Phase.APPROACH}

TRANSITIONS: tuple[tuple[Trigger, tuple[Phase, ...], Phase], ...] = (
    (Trigger.START, (Phase.IDLE,), Phase.APPROACH),
    (Trigger.RETURN, (Phase.IDLE,), Phase.HOME),
    (Trigger.RETURNED, (Phase.HOME,), Phase.APPROACH),
    (Trigger.SHAPED, (Phase.APPROACH,), Phase.REST),
    (Trigger.RESTED, (Phase.REST,), Phase.GRASP),
    (Trigger.BRACED, (Phase.GRASP,), Phase.OPPOSE),
    (Trigger.POSITIONED, (Phase.OPPOSE,), Phase.SQUEEZE),
    (Trigger.GRIPPED, (Phase.OPPOSE, Phase.SQUEEZE), Phase.RELAX),
    (Trigger.RELAXED, (Phase.RELAX,), Phase.LISTEN),
    (Trigger.LISTENED, (Phase.LISTEN,), Phase.LIFT),
    (Trigger.SLIP_REGISTERED, (Phase.LIFT, Phase.HOLD), Phase.COMPENSATE),
    (Trigger.FOUND, (Phase.LIFT, Phase.HOLD), Phase.COMPENSATE),
    (Trigger.SLIP_STOPPED, (Phase.COMPENSATE,), Phase.LIFT),
    (Trigger.SLIP_BORNE, (Phase.COMPENSATE,), Phase.LIFT),
    (Trigger.LIFTED, (Phase.LIFT, Phase.COMPENSATE), Phase.HOLD),
    (Trigger.CAP_REACHED, (Phase.COMPENSATE,), Phase.LOWER),
    (Trigger.FINISHED, (Phase.HOLD,), Phase.LOWER),
    (Trigger.KEEP, (Phase.HOLD,), Phase.KEPT),
    (Trigger.NEAR, (Phase.LOWER,), Phase.LAND),
    (Trigger.TIGHTENED, (Phase.LOWER, Phase.LAND), Phase.TOUCH),
    (Trigger.SETTLED, (Phase.TOUCH,), Phase.PROBE),
    (Trigger.LOOSE, (Phase.PROBE,), Phase.LAND),
    (Trigger.HIGH, (Phase.PROBE,), Phase.LOWER),
    (Trigger.LANDED, (Phase.LAND, Phase.PROBE), Phase.RELEASE),
    (Trigger.OPENED, (Phase.RELEASE,), Phase.RETREAT),
    (Trigger.RETREATED, (Phase.RETREAT,), Phase.DONE),
    (Trigger.LOSE, tuple(p for p in Phase if p in AIRBORNE_PHASES - END_PHASES), Phase.LOST),
    (Trigger.STOP, tuple(p for p in Phase if p not in SAFE_PHASES), Phase.STOPPED),
    (Trigger.FAIL, tuple(p for p in Phase if p not in SAFE_PHASES), Phase.FAULT),
)


class PhaseChange(msgspec.Struct, frozen=True):
    """One transition, as it is logged: phase entered, when, and why."""

    phase: str
    t_ns: int
    cause: str


class PhaseMachine:
    """The present phase and the log of how it was reached."""

    def __init__(self, phase: Phase = Phase.IDLE) -> None:
        self.log: list[PhaseChange] = []
        self._machine = Machine(
            model=None,
            states=[p.value for p in Phase],
            initial=phase.value,
            transitions=[
                {"trigger": t.value, "source": [s.value for s in sources], "dest": dest.value}
                for t, sources, dest in TRANSITIONS
            ],
            auto_transitions=False,
            send_event=True,
            after_state_change=self._note,
        )
        self._model = _Model()
        self._machine.add_model(self._model)
        self.phase = phase

    @property
    def before(self) -> Phase:
        """The phase before the present one."""
        return Phase(self.log[-2].phase) if len(self.log) > 1 else Phase.IDLE

    def first_ns(self, phase: Phase) -> int:
        """When that phase was entered for the first time; raises ValueError if it never was."""
        times = [change.t_ns for change in self.log if change.phase == phase]
        if not times:
            raise ValueError(f"{phase} was never entered")
        return times[0]

    def fire(self, trigger: Trigger, t_ns: int, cause: str) -> None:
        """Make the transition; raises transitions.MachineError where the table has no such way."""
        self._machine.events[trigger.value].trigger(self._model, t_ns=t_ns, cause=cause)

    def _note(self, event: EventData) -> None:
        self.phase = Phase(self._model.state)
        self.log.append(PhaseChange(self.phase.value, event.kwargs["t_ns"], event.kwargs["cause"]))


class _Model:
    """What `transitions` hangs the state on."""

    state: str
