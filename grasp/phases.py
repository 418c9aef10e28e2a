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
    APPROACH = "approach"
    GRASP = "grasp"
    LIFT = "lift"
    COMPENSATE = "compensate"
    HOLD = "hold"
    LOWER = "lower"
    RELEASE = "release"
    FAULT = "fault"


class Trigger(StrEnum):
    """What makes the phase change."""

    START = "start"  # a run begins
    SHAPED = "shaped"  # rest counts taken, fingers just short of the object
    GRIPPED = "gripped"  # all fingers rest at their predetermined positions
    SLIP_REGISTERED = "slip_registered"
    SLIP_STOPPED = "slip_stopped"
    LIFTED = "lifted"  # the arm is at the top and nothing slips
    CAP_REACHED = "cap_reached"  # slip goes on although the force cannot rise any more
    FINISHED = "finished"  # held long enough: set it down
    LANDED = "landed"
    RETREATED = "retreated"
    FAIL = "fail"


TRANSITIONS: tuple[tuple[Trigger, tuple[Phase, ...], Phase], ...] = (
    (Trigger.START, (Phase.IDLE,), Phase.APPROACH),
    (Trigger.SHAPED, (Phase.APPROACH,), Phase.GRASP),
    (Trigger.GRIPPED, (Phase.GRASP,), Phase.LIFT),
    (Trigger.SLIP_REGISTERED, (Phase.LIFT, Phase.HOLD), Phase.COMPENSATE),
    (Trigger.SLIP_STOPPED, (Phase.COMPENSATE,), Phase.HOLD),
    (Trigger.LIFTED, (Phase.LIFT,), Phase.HOLD),
    (Trigger.CAP_REACHED, (Phase.COMPENSATE,), Phase.LOWER),
    (Trigger.FINISHED, (Phase.HOLD,), Phase.LOWER),
    (Trigger.LANDED, (Phase.LOWER,), Phase.RELEASE),
    (Trigger.RETREATED, (Phase.RELEASE,), Phase.IDLE),
    (Trigger.FAIL, tuple(p for p in Phase if p is not Phase.FAULT), Phase.FAULT),
)

CONTACT_PHASES = frozenset({Phase.GRASP, Phase.LIFT, Phase.COMPENSATE, Phase.HOLD, Phase.LOWER})
AIRBORNE_PHASES = frozenset({Phase.LIFT, Phase.COMPENSATE, Phase.HOLD, Phase.LOWER})


class PhaseChange(msgspec.Struct, frozen=True):
    """One transition, as it is logged: phase entered, when, and why."""

    phase: str
    t_ns: int
    cause: str


class PhaseMachine:
    """The present phase and the log of how it was reached."""

    def __init__(self) -> None:
        self.log: list[PhaseChange] = []
        self._machine = Machine(
            model=None,
            states=[p.value for p in Phase],
            initial=Phase.IDLE.value,
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
        self.phase = Phase.IDLE

    def fire(self, trigger: Trigger, t_ns: int, cause: str) -> None:
        """Make the transition; raises transitions.MachineError where the table has no such way."""
        self._machine.events[trigger.value].trigger(self._model, t_ns=t_ns, cause=cause)

    def _note(self, event: EventData) -> None:
        self.phase = Phase(self._model.state)
        self.log.append(PhaseChange(self.phase.value, event.kwargs["t_ns"], event.kwargs["cause"]))


class _Model:
    """What `transitions` hangs the state on."""

    state: str


def mermaid() -> str:
    """State diagram of the table, in Mermaid's language."""
    lines = ["stateDiagram-v2", "    [*] --> idle"]
    for trigger, sources, dest in TRANSITIONS:
        if trigger is Trigger.FAIL:
            lines.append(
                f"    note right of {dest.value}: {trigger.value} leads here from every phase"
            )
            continue
        lines += [f"    {s.value} --> {dest.value}: {trigger.value}" for s in sources]
    return "\n".join(lines) + "\n"
