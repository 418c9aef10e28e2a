"""GraspStep: from one tactile frame and the device states to admitted commands.

Plausibility checks, detector, slip monitor, controller and force guard as one unit, which a loop on
devices, a run in virtual time and a replay all feed. A pure function of its inputs and those
before: no clock, no sleep, no I/O.
"""

from collections.abc import Callable
from contextlib import suppress

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from detector.interface import SlipDetector
from drivers.errors import GraspError, describe_exception, one_line
from drivers.interfaces import FINGERS, GripperState, TactileFrame, Vector3
from grasp.commands import CloseFast, Command, GripperCommand
from grasp.controller import Decision, GraspController
from grasp.fault import Fault
from grasp.guard import ForceGuard
from grasp.monitors.checks import Monitors, failed, no_probabilities
from grasp.monitors.settings import MonitorSettings
from grasp.observation import Observation, StepInput
from grasp.states import OPEN_STATES, UNTARED_STATES

SLIP_LIKELY = 0.5  # the kind of slip is learnt from slip alone, and means nothing below this


class StepResult(msgspec.Struct, frozen=True):
    """What one step concluded; ``admitted``: ``decision.commands`` after the guard."""

    observation: Observation
    decision: Decision
    admitted: tuple[Command, ...]


class GraspStep:
    """One run's detector, controller and guard; ``decide`` once a tactile sample."""

    def __init__(
        self,
        detector: SlipDetector,
        controller: GraspController,
        guard: ForceGuard,
        monitors: Monitors | None = None,
        motion: Callable[[], Motion | None] = lambda: None,
    ) -> None:
        """``motion``: the kind of slip of the detector's latest frame."""
        self.controller = controller
        self._motion = motion
        self._detector = detector
        self._guard = guard
        self._monitors = monitors or Monitors(MonitorSettings())
        self._measured_n: Vector3 = (0.0, 0.0, 0.0)
        self._felt_n: Vector3 = (0.0, 0.0, 0.0)
        self.last_close: CloseFast | None = None  # the closing that was admitted last
        self._rested = False  # counts are relative to rest counts that this run has taken
        self._not_reset: Fault | None = None  # why the detector's last reset failed

    def decide(self, inputs: StepInput) -> StepResult:
        """Take one frame with the states of the other devices."""
        observation = self._observe(inputs)
        decision = self.controller.step(observation)
        if decision.reset_detector:
            self._reset_detector()
        if decision.anchor:
            self._guard.anchor(inputs.gripper.min_closure_counts, self._measured_n)
        admitted = tuple(self.admit(command, inputs.gripper) for command in decision.commands)
        self._monitors.sent(admitted, inputs.arm)
        return StepResult(observation, decision, admitted)

    def admit(self, command: Command, gripper: GripperState) -> Command:
        """The command that may be sent in place of this one, by the force measured last."""
        if not isinstance(command, GripperCommand):
            return command
        admitted = self._guard.admit(command, gripper, self._measured_n)
        if isinstance(admitted, CloseFast):
            self.last_close = admitted
        return admitted

    def fallback(self, gripper: GripperState) -> GripperCommand | None:
        """The hand's command should no further step come; None where it stays as it is."""
        if self.controller.finished:
            return None
        hand = (c for c in self.controller.aborted() if isinstance(c, GripperCommand))
        command = next(hand, None)
        return None if command is None else self._guard.admit(command, gripper, self._measured_n)

    def _observe(self, inputs: StepInput) -> Observation:
        state = self.controller.state
        found = self._monitors.check(state, inputs)
        faults = (*inputs.errors, *filter(self._monitors.stops, found))
        reported = tuple(fault for fault in found if fault not in faults)
        self._rested |= state not in UNTARED_STATES
        # a detector that failed or hung must not delay the safe state that this step enters
        safe = bool(inputs.stop or faults) or self.controller.in_safe_state
        frame, probabilities = inputs.frame, np.zeros(FINGERS)
        failure: Fault | None = None
        if frame is not None and self._rested:
            if self._monitors.trusts_force:
                self._estimate_force(frame.counts)
            if not safe:
                probabilities, failure = self._detect(frame)
        if failure is not None and state not in OPEN_STATES:  # contact is expected
            faults = (*faults, failure)
        return Observation(
            inputs=inputs,
            probabilities=probabilities,
            faults=faults,
            reported=reported,
            measured_n=self._measured_n,
            felt_n=self._felt_n,
            overloaded=self._guard.overloaded(self._measured_n),
            last_close=self.last_close,
            reach_counts=self._guard.reach(inputs.gripper, self._measured_n),
            thumb_end=self._guard.thumb_end,
            motion=self._kind_of_slip(probabilities),
        )

    def _estimate_force(self, counts: NDArray[np.int16]) -> None:
        self._measured_n = self._felt_n = self._force_n(counts)
        if not self._monitors.fingertips.all_tell:
            self._felt_n = self._force_n(counts * self._monitors.fingertips.can_tell)

    def _detect(self, frame: TactileFrame) -> tuple[NDArray[np.float64], Fault | None]:
        """Probability of slip at each finger, and why there is none; a stale frame resets the
        detector."""
        if frame.stale:
            self._reset_detector()
        if frame.stale or self._not_reset:
            return np.zeros(FINGERS), self._not_reset
        try:
            answer = self._detector.update(frame.counts)
        except KeyboardInterrupt:
            raise
        except BaseException as bug:  # a plug-in's: none of its bugs may end a run
            return np.zeros(FINGERS), _failed(bug)
        wrong = no_probabilities(answer)
        return (np.zeros(FINGERS), wrong) if wrong else (answer, None)

    def _kind_of_slip(self, probabilities: NDArray[np.float64]) -> Motion | None:
        if probabilities.max() > SLIP_LIKELY:
            with suppress(Exception):  # recorded only: no bug may end a run
                return self._motion()
        return None

    def _force_n(self, counts: NDArray[np.int16]) -> Vector3:
        a, b, c = counts.sum(axis=1).tolist()
        return self._guard.measured_n((a, b, c))

    def _reset_detector(self) -> None:
        """A detector that fails here is not asked until a reset succeeds."""
        try:
            self._detector.reset()
        except KeyboardInterrupt:
            raise
        except BaseException as bug:
            self._not_reset = _failed(bug)
        else:
            self._not_reset = None


def _failed(bug: BaseException) -> Fault:
    said = one_line(bug.message) if isinstance(bug, GraspError) else describe_exception(bug)
    return failed("detector_failed", how=said)
