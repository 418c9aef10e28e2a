"""GraspStep: detector, slip monitor, controller and force guard as one unit, fed a frame at a time.

A loop on devices, a run in virtual time and the replay of a recording all feed this unit and none
of them repeats anything of it. No clock is read, nothing sleeps, nothing does I/O: what a step
concludes follows from its inputs and those before.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from drivers.errors import GraspError, in_words, one_line
from drivers.interfaces import FINGERS, GripperState, TactileFrame, Vector3
from grasp.commands import CloseFast, Command, GripperCommand
from grasp.controller import Decision, GraspController
from grasp.fault import Fault
from grasp.guard import ForceGuard
from grasp.monitors.checks import Monitors, failed, no_probabilities
from grasp.monitors.settings import MonitorSettings
from grasp.observation import Observation, StepInput
from grasp.states import OPEN_STATES, UNTARED_STATES

HEARD = 0.5  # likelier slip than not: heads have learnt from slip alone, and say nothing of rest


class Detector(Protocol):
    """See ``detector.interface``."""

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]: ...


class StepResult(msgspec.Struct, frozen=True):
    """What one step concluded: ``admitted`` are ``decision.commands`` as the guard lets them go."""

    observation: Observation
    decision: Decision
    admitted: tuple[Command, ...]


class GraspStep:
    """From what the devices say to the commands that may go to them."""

    def __init__(
        self,
        detector: Detector,
        controller: GraspController,
        guard: ForceGuard,
        monitors: Monitors | None = None,
        motion: Callable[[], Motion | None] = lambda: None,
    ) -> None:
        """``motion``: what kind of slip the detector's latest frame is of."""
        self.controller = controller
        self._motion = motion
        self._detector = detector
        self._guard = guard
        self._monitors = monitors or Monitors(MonitorSettings())
        self._measured_n: Vector3 = (0.0, 0.0, 0.0)
        self._felt_n: Vector3 = (0.0, 0.0, 0.0)
        self._last_close: CloseFast | None = None
        self._rested = False  # fingertips' counts are against the rest that this run has taken
        # why the detector did not forget the past when it was last asked to
        self._remembers: Fault | None = None

    def decide(self, inputs: StepInput) -> StepResult:
        """Take one frame with the states of the other devices."""
        observation = self._observe(inputs)
        decision = self.controller.step(observation)
        if decision.reset_detector:
            self._forget()
        if decision.anchor:
            self._guard.anchor(inputs.gripper.at_least_counts, self._measured_n)
        admitted = tuple(self.admit(command, inputs.gripper) for command in decision.commands)
        self._monitors.sent(admitted, inputs.arm)
        return StepResult(observation, decision, admitted)

    @property
    def last_close(self) -> CloseFast | None:
        """The closing that was admitted last."""
        return self._last_close

    def admit(self, command: Command, gripper: GripperState) -> Command:
        """The command that may go out in place of this one, by the force measured last."""
        if not isinstance(command, GripperCommand):
            return command
        admitted = self._guard.admit(command, gripper, self._measured_n)
        if isinstance(admitted, CloseFast):
            self._last_close = admitted
        return admitted

    def fallback(self, gripper: GripperState) -> GripperCommand | None:
        """The hand's safe command should no further step come, as the guard admits it now; None
        where the hand stays as it is."""
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
        self._rested = self._rested or state not in UNTARED_STATES
        # a detector that failed or hung must not delay the safe state that this step enters
        safe = bool(inputs.stop or faults) or self.controller.in_safe_state
        probabilities, failure = self._ask(inputs.frame if self._rested else None, not safe)
        if failure is not None and state not in OPEN_STATES:  # somebody has to feel something
            faults = (*faults, failure)
        return Observation(
            inputs=inputs,
            probabilities=probabilities,
            faults=faults,
            reported=reported,
            measured_n=self._measured_n,
            felt_n=self._felt_n,
            overloaded=self._guard.overloaded(self._measured_n),
            last_close=self._last_close,
            reach_counts=self._guard.reach(inputs.gripper, self._measured_n),
            thumb_end=self._guard.thumb_end,
            motion=self._kind_of_slip(probabilities),
        )

    def _ask(
        self, frame: TactileFrame | None, ask: bool
    ) -> tuple[NDArray[np.float64], Fault | None]:
        """Probability of slip at each finger, and why there is none. A stale frame is no sample,
        and forgets the past; codes at the end of their range are no force. None: there is no frame,
        or it is counted from the rest of an earlier run, since when the pads were pressed.
        ``ask``: whether the detector may be called."""
        if frame is None:
            return np.zeros(FINGERS), None
        if self._monitors.fingertips.believable:
            self._measured_n = self._force_n(frame.counts)
            self._felt_n = self._measured_n
            if not self._monitors.fingertips.all_tell:
                self._felt_n = self._force_n(frame.counts * self._monitors.fingertips.can_tell)
        if not ask:
            return np.zeros(FINGERS), None
        if frame.stale:
            self._forget()
        if frame.stale or self._remembers:
            return np.zeros(FINGERS), self._remembers
        try:
            answer = self._detector.update(frame.counts)
        except KeyboardInterrupt:
            raise
        except BaseException as bug:  # a plug-in's code: no bug of it may end a run
            return np.zeros(FINGERS), _failed(bug)
        wrong = no_probabilities(answer)
        return (np.zeros(FINGERS), wrong) if wrong else (answer, None)

    def _kind_of_slip(self, probabilities: NDArray[np.float64]) -> Motion | None:
        """Nothing is decided by it, and no bug of it may end a run."""
        if probabilities.max() > HEARD:
            with suppress(Exception):
                return self._motion()
        return None

    def _force_n(self, counts: NDArray[np.int16]) -> Vector3:
        a, b, c = counts.sum(axis=1).tolist()
        return self._guard.measured_n((a, b, c))

    def _forget(self) -> None:
        """One that cannot is not asked until it can: no bug of a detector may end a run."""
        try:
            self._detector.reset()
        except KeyboardInterrupt:
            raise
        except BaseException as bug:
            self._remembers = _failed(bug)
        else:
            self._remembers = None


def _failed(bug: BaseException) -> Fault:
    said = one_line(bug.message) if isinstance(bug, GraspError) else in_words(bug)
    return failed("detector_failed", how=said)
