"""SafeState: what arm and hand shall do once a run has ended early, and what of it is not seen.

A fault, a person who stops, an object that is lost: by the phase in which it happened. The table is
in docs/architecture.md, "Safe states". Pursuit asks for one until it is seen.
"""

from collections.abc import Iterable
from typing import NamedTuple

import msgspec

from grasp.commands import CloseFast, Command, HoldFingers, StopArm
from grasp.controller_settings import ControllerSettings
from grasp.fault import ARM, IMPLAUSIBLE, Fault
from grasp.lift_progress import REPEAT_NS
from grasp.monitors.checks import implausible
from grasp.observation import Observation
from grasp.slip_response.close import SlipResponse
from grasp.states import AIRBORNE_STATES, CLOSING_STATES, CONTACT_STATES, UNMOVED_STATES, State

SAFE_STATE_NS = 3_000_000_000  # a safe state that is not seen is asked for so long; assumed


class Missing(NamedTuple):
    """What is not seen of a safe state, of each device; empty: all of it is."""

    arm: tuple[str, ...]
    hand: tuple[str, ...]


class SafeState(msgspec.Struct, frozen=True):
    """One that was entered: its phase (lost, stopped or fault), the phase before, when, and the
    faults that led to it or were found since. ``half_closed``: the first stage of an answer to slip
    was asked for, and its second was not yet."""

    phase: State
    before: State
    since_ns: int
    faults: tuple[Fault, ...] = ()
    half_closed: bool = False

    @property
    def arm_implausible(self) -> bool:
        """Whether the arm cannot be believed, whatever else is wrong: then neither can its
        standing."""
        return implausible(self.faults, ARM)

    @property
    def closes_hand(self) -> bool:
        """The object may be in the air, or an answer to slip is to be finished: the hand closes to
        the limit."""
        if self.phase is State.STOPPED:
            return self.half_closed
        return self.phase is State.FAULT and self.before in AIRBORNE_STATES

    @property
    def leaves_hand(self) -> bool:
        """The hand is told nothing: it touches nothing yet, or nothing any more, or a grip is kept,
        or there is nothing left to grip."""
        if self.before in UNMOVED_STATES or self.phase is State.LOST:
            return True
        kept = self.before in CONTACT_STATES - CLOSING_STATES and not self.half_closed
        return self.phase is State.STOPPED and kept

    def of_hand(self, closure: CloseFast) -> tuple[Command, ...]:
        """What is asked of the hand; ``closure``: the one that is due, to the limit."""
        if self.leaves_hand:
            return ()
        return (closure,) if self.closes_hand else (HoldFingers(),)

    def hand_is_safe(self, seen: Observation) -> bool:
        """Whether the status confirms the hand's part; never in the step that entered the state."""
        if self.before in UNMOVED_STATES:
            return True
        if seen.t_ns == self.since_ns and not self.leaves_hand:
            return False
        if self.closes_hand:
            return seen.closed_out
        return seen.hand_rests

    def missing_of_arm(self, seen: Observation, stale_ns: float) -> tuple[str, ...]:
        """What is not seen of an arm that stands; one not heard of for ``stale_ns`` is not seen."""
        if seen.arm.age_ns(seen.t_ns) > stale_ns:
            return ("the arm is not heard: whether it stands is unknown",)
        if self.arm_implausible:
            return ("the arm cannot be believed: whether it stands is unknown",)
        return ("the arm still moves",) if seen.pending or seen.arm.moving else ()

    def missing_of_hand(self, seen: Observation) -> tuple[str, ...]:
        """What is not seen of a hand that is as it shall be."""
        if seen.inputs.gripper_lost:
            return ("the hand is not heard: it holds as it stands",)
        if self.hand_is_safe(seen):
            return ()
        if seen.gripper.fault and not seen.gripper.active:
            return ("the hand reports a fault and moves no more: it holds as it stands",)
        return ("the hand is not as it should be",)


class Pursuit:
    """A safe state is reached when it is seen; until then it is asked for again and again.

    ``over``: all of it was seen, or waited for long enough. ``unreached``: what was not seen last.
    ``further``: checks that failed since; they are told, and change nothing that is asked for.
    """

    def __init__(
        self, safe: SafeState, settings: ControllerSettings, response: SlipResponse
    ) -> None:
        self._settings = settings
        self._response = response
        self.safe = safe
        self.over = False
        self.unreached: tuple[str, ...] = ()
        self.further: tuple[Fault, ...] = ()
        self._asked_ns = 0  # paces the requests

    def step(self, seen: Observation) -> tuple[Command, ...]:
        """What to ask for now."""
        self._take_further(seen.faults)
        stale_ns = self._settings.stale_after_s * 1e9
        arm, hand = self.safe.missing_of_arm(seen, stale_ns), self.safe.missing_of_hand(seen)
        self.unreached = (*arm, *hand)
        # what the hand was told before may set it going once more, though its status says it rests;
        # and an arm may go on though it says that it stands
        due = seen.t_ns - self._asked_ns >= REPEAT_NS
        reached = not self.unreached and due
        waited_ns = seen.t_ns - self.safe.since_ns
        if reached or waited_ns >= SAFE_STATE_NS:
            self.over = True
        elif self.unreached and due and not seen.pending:
            return self.ask(seen)
        return ()

    def ask(self, seen: Observation) -> tuple[Command, ...]:
        """Commands for each part of the safe state that is not confirmed yet."""
        self._asked_ns = seen.t_ns
        safe = self.safe
        stop = seen.arm.moving or seen.t_ns == safe.since_ns or safe.arm_implausible
        arm = (StopArm(self._settings.stop_deceleration_mps2),) if stop else ()
        tell_hand = not seen.inputs.gripper_lost and not safe.hand_is_safe(seen)
        return (*arm, *safe.of_hand(self._response.closing(seen))) if tell_hand else arm

    def _take_further(self, faults: Iterable[Fault]) -> None:
        known = {fault.code for fault in self.safe.faults}
        checks = (fault for fault in faults if fault.kind == IMPLAUSIBLE)
        if new := tuple(fault for fault in checks if fault.code not in known):
            self.further += new
            faults = (*self.safe.faults, *new)
            self.safe = msgspec.structs.replace(self.safe, faults=faults)
