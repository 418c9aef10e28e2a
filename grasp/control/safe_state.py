"""SafeState: what arm and hand do once a run has ended early. SafeStateSupervisor: requests it
until it is confirmed.

The commands depend on the cause (a fault, a stop by a person, a lost object) and on the state in
which it occurred. The table is in docs/force-limit.md, "Faults and reactions".
"""

from collections.abc import Iterable
from typing import NamedTuple, Self

import msgspec

from grasp.control.commands import CloseToLimit, Command, HoldFingers, StopArm
from grasp.control.controller_settings import ControllerSettings
from grasp.control.fault import ARM, IMPLAUSIBLE, Fault
from grasp.control.monitors.checks import implausible
from grasp.control.observation import Observation
from grasp.control.slip_response.close import SlipResponse
from grasp.control.state_timer import REPEAT_NS
from grasp.control.states import (
    AIRBORNE_STATES,
    CLOSING_STATES,
    CONTACT_STATES,
    UNMOVED_STATES,
    State,
    StateMachine,
)

SAFE_STATE_NS = 3_000_000_000  # longest time for which a safe state is requested; assumed


class Unconfirmed(NamedTuple):
    """Parts of a safe state that the device states do not confirm, in words; empty if all are."""

    arm: tuple[str, ...]
    hand: tuple[str, ...]


class SafeState(msgspec.Struct, frozen=True):
    """A safe state that was entered: its state (lost, stopped or fault), the state before, the time
    and the faults that led to it or were found since. ``half_closed``: the first stage of a closing
    for slip was commanded and the second was not."""

    phase: State
    before: State
    since_ns: int
    faults: tuple[Fault, ...] = ()
    half_closed: bool = False

    @property
    def arm_implausible(self) -> bool:
        """Whether the arm's data are implausible, so that its standstill cannot be confirmed."""
        return implausible(self.faults, ARM)

    @property
    def closes_hand(self) -> bool:
        """Whether the hand closes: the object may be in the air, or a closing is half done."""
        if self.phase is State.STOPPED:
            return self.half_closed
        return self.phase is State.FAULT and self.before in AIRBORNE_STATES

    @property
    def leaves_hand(self) -> bool:
        """Whether the hand gets no command: no contact, a grip to keep, or a lost object."""
        if self.before in UNMOVED_STATES or self.phase is State.LOST:
            return True
        kept = self.before in CONTACT_STATES - CLOSING_STATES and not self.half_closed
        return self.phase is State.STOPPED and kept

    def hand_commands(self, closure: CloseToLimit) -> tuple[Command, ...]:
        """Commands to the hand. ``closure``: the closing to the limit, used where one is due."""
        if self.leaves_hand:
            return ()
        return (closure,) if self.closes_hand else (HoldFingers(),)

    def hand_is_safe(self, obs: Observation) -> bool:
        """Whether the hand's status confirms its part. In the step that enters the safe state it
        cannot, unless the hand gets no command."""
        if self.before in UNMOVED_STATES:
            return True
        if obs.t_ns == self.since_ns and not self.leaves_hand:
            return False
        if self.closes_hand:
            return obs.closing_exhausted
        return obs.hand_rests

    def unconfirmed_arm(self, obs: Observation, stale_ns: float) -> tuple[str, ...]:
        """Why the arm's standstill is not confirmed; empty if it is. A state older than
        ``stale_ns`` confirms nothing."""
        if obs.arm.age_ns(obs.t_ns) > stale_ns:
            return ("the arm does not report: whether it has stopped is unknown",)
        if self.arm_implausible:
            return ("the arm's data are implausible: whether it has stopped is unknown",)
        return ("the arm still moves",) if obs.pending or obs.arm.moving else ()

    def unconfirmed_hand(self, obs: Observation) -> tuple[str, ...]:
        """Why the hand's part is not confirmed; empty if it is."""
        if obs.gripper_lost:
            return ("the hand does not report: it keeps its position",)
        if self.hand_is_safe(obs):
            return ()
        if obs.gripper.fault and not obs.gripper.active:
            return ("the hand reports a fault and no longer moves: it keeps its position",)
        return ("the hand has not reached its safe state",)


class SafeStateSupervisor:
    """Repeats the commands of a safe state until the device states confirm it.

    ``over``: it was confirmed, or ``SAFE_STATE_NS`` have passed. ``unconfirmed``: the parts that
    were not confirmed at the last step. ``later_faults``: checks that have failed since the safe
    state was entered; they are reported and do not change the commands to the hand.
    """

    def __init__(
        self, safe: SafeState, settings: ControllerSettings, response: SlipResponse
    ) -> None:
        self._settings = settings
        self._response = response
        self.safe = safe
        self.over = False
        self.unconfirmed: tuple[str, ...] = ()
        self.later_faults: tuple[Fault, ...] = ()
        self._requested_ns = 0  # time of the last request

    @classmethod
    def enter(
        cls, machine: StateMachine, obs: Observation, faults: tuple[Fault, ...],
        settings: ControllerSettings, response: SlipResponse,
    ) -> Self:  # fmt: skip
        """Supervise the safe state that the machine has just entered because of these faults."""
        half_closed = machine.before is State.COMPENSATE and obs.first_stage
        safe = SafeState(machine.state, machine.before, obs.t_ns, faults, half_closed)
        return cls(safe, settings, response)

    def step(self, obs: Observation) -> tuple[Command, ...]:
        """Commands to send now."""
        self._take_later_faults(obs.faults)
        stale_ns = self._settings.stale_after_s * 1e9
        arm, hand = self.safe.unconfirmed_arm(obs, stale_ns), self.safe.unconfirmed_hand(obs)
        self.unconfirmed = (*arm, *hand)
        # only a state confirmed some time after the last request counts as reached: until then the
        # hand may still start although it reports rest, or the arm move on although it reports none
        due = obs.t_ns - self._requested_ns >= REPEAT_NS
        reached = not self.unconfirmed and due
        waited_ns = obs.t_ns - self.safe.since_ns
        if reached or waited_ns >= SAFE_STATE_NS:
            self.over = True
        elif self.unconfirmed and due and not obs.pending:
            return self.request(obs)
        return ()

    def request(self, obs: Observation) -> tuple[Command, ...]:
        """Commands for each part of the safe state that is not confirmed yet."""
        self._requested_ns = obs.t_ns
        safe = self.safe
        stop = obs.arm.moving or obs.t_ns == safe.since_ns or safe.arm_implausible
        arm = (StopArm(self._settings.stop_deceleration_mps2),) if stop else ()
        if obs.gripper_lost or safe.hand_is_safe(obs):
            return arm
        return (*arm, *safe.hand_commands(self._response.closing(obs)))

    def _take_later_faults(self, faults: Iterable[Fault]) -> None:
        known = {fault.code for fault in self.safe.faults}
        checks = (fault for fault in faults if fault.kind == IMPLAUSIBLE)
        if new := tuple(fault for fault in checks if fault.code not in known):
            self.later_faults += new
            faults = (*self.safe.faults, *new)
            self.safe = msgspec.structs.replace(self.safe, faults=faults)
