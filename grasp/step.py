"""GraspStep: detector, slip monitor, controller and force guard as one unit, fed a frame at a time.

A loop on devices, a run in virtual time and the replay of a recording all feed this unit and none
of them repeats anything of it. No clock is read, nothing sleeps, nothing does I/O: what a step
concludes follows from what it is told now and was told before.
"""

from collections.abc import Callable
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from drivers.errors import GraspError, SuppressBugs, in_words, one_line
from drivers.interfaces import FINGERS, GripperState, TactileFrame, Vector3
from grasp.commands import CloseFast, Command, GripperCommand
from grasp.controller import Decision, GraspController
from grasp.doubt import Doubts, wrong_probabilities
from grasp.doubt_settings import DoubtSettings
from grasp.guard import ForceGuard
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
        doubts: Doubts | None = None,
        motion: Callable[[], Motion | None] = lambda: None,
    ) -> None:
        """``motion``: what kind of slip the detector's latest frame is of."""
        self.controller = controller
        self._motion = motion
        self._detector = detector
        self._guard = guard
        self._doubts = doubts or Doubts(DoubtSettings())
        self._measured_n: Vector3 = (0.0, 0.0, 0.0)
        self._felt_n: Vector3 = (0.0, 0.0, 0.0)
        self._last_close: CloseFast | None = None
        self._rested = False  # fingertips' counts are against the rest that this run has taken
        self._remembers = ""  # why the detector did not forget the past when it was last told to

    def decide(self, inputs: StepInput) -> StepResult:
        """Take one frame with the states of the other devices."""
        observation = self._observe(inputs)
        decision = self.controller.step(observation)
        if decision.reset_detector:
            self._forget()
        if decision.anchor:
            self._guard.anchor(inputs.gripper.at_least_counts, self._measured_n)
        admitted = tuple(self.admit(command, inputs.gripper) for command in decision.commands)
        self._doubts.sent(admitted, inputs.arm)
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
        doubt = self._doubts.of(
            state,
            inputs.frame,
            inputs.gripper,
            inputs.arm,
            inputs.pending,
            inputs.late_ns,
            inputs.took_ns,
        )
        self._rested = self._rested or state not in UNTARED_STATES
        # a detector that failed or hung must not delay the safe state that this step enters
        safe = bool(inputs.stop or inputs.trouble or doubt) or self.controller.in_safe_state
        probabilities, deaf = self._listen(inputs.frame if self._rested else None, not safe)
        if state in OPEN_STATES:  # nobody has to feel anything
            deaf = ""
        return Observation(
            inputs=inputs,
            probabilities=probabilities,
            doubt=doubt or deaf,
            measured_n=self._measured_n,
            felt_n=self._felt_n,
            overloaded=self._guard.overloaded(self._measured_n),
            last_close=self._last_close,
            reach_counts=self._guard.reach(inputs.gripper, self._measured_n),
            thumb_end=self._guard.thumb_end,
            motion=self._kind_of_slip(probabilities),
        )

    def _listen(self, frame: TactileFrame | None, ask: bool) -> tuple[NDArray[np.float64], str]:
        """Probability of slip at each finger, and why there is none. A stale frame is no sample,
        and forgets the past; codes at the end of their range are no force. None: there is no frame,
        or it is counted from the rest of an earlier run, since when the pads were pressed.
        ``ask``: whether the detector may be called."""
        if frame is None:
            return np.zeros(FINGERS), ""
        if self._doubts.believes_force:
            self._measured_n = self._force_n(frame.counts)
            self._felt_n = self._measured_n
            if not self._doubts.all_tell:
                self._felt_n = self._force_n(frame.counts * self._doubts.can_tell)
        if not ask:
            return np.zeros(FINGERS), ""
        if frame.stale:
            self._forget()
        if frame.stale or self._remembers:
            return np.zeros(FINGERS), self._remembers
        return self._ask(frame.counts)

    def _kind_of_slip(self, probabilities: NDArray[np.float64]) -> Motion | None:
        """Nothing is decided by it, and no bug of it may end a run."""
        if probabilities.max() > HEARD:
            with SuppressBugs():
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
            self._remembers = ""

    def _ask(self, counts: NDArray[np.int16]) -> tuple[NDArray[np.float64], str]:
        """The detector's answer, or what is wrong with it: no bug of a detector may end a run."""
        try:
            answer = self._detector.update(counts)
        except KeyboardInterrupt:
            raise
        except BaseException as bug:
            return np.zeros(FINGERS), _failed(bug)
        wrong = wrong_probabilities(answer)
        return (np.zeros(FINGERS), wrong) if wrong else (answer, "")


def _failed(bug: BaseException) -> str:
    """As a cause of a safe state, of which several are joined by "; "."""
    said = one_line(bug.message) if isinstance(bug, GraspError) else in_words(bug)
    return f"detector_failed: {said}".replace(";", ",")
