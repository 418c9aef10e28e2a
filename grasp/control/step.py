"""GraspStep: from one tactile frame and the device states to admitted commands.

Combines plausibility checks, detector, slip monitor, controller and force guard. A loop on devices,
a run in virtual time and a replay all use it. The result depends only on present and earlier
inputs: no clock, no sleep, no I/O.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from itertools import compress
from typing import Generic, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import Motion, SlipDetector
from drivers.errors import GraspError, counted, describe_exception, one_line
from drivers.interfaces import GripperState, TactileFrame, Vector3
from grasp.control.commands import CloseToLimit, Command, GripperCommand
from grasp.control.fault import Fault
from grasp.control.guard import ForceGuard
from grasp.control.monitors.checks import DETECTOR_FAILED, Monitors, failed, invalid_probabilities
from grasp.control.monitors.settings import MonitorSettings
from grasp.control.observation import NO_SLIP, Observation
from grasp.control.states import OPEN_STATES, UNTARED_STATES
from grasp.control.transition import Controller, Decision

AnyController = TypeVar("AnyController", bound=Controller)

SLIP_LIKELY = 0.5  # below this the kind of slip is not read: it is trained on slip only


class StepResult(msgspec.Struct, frozen=True):
    """Result of one step. ``admitted``: ``decision.commands`` after the guard."""

    observation: Observation
    decision: Decision
    admitted: tuple[Command, ...]


class GraspStep(Generic[AnyController]):
    """Detector, controller and guard of one run. Call ``decide`` once a tactile sample."""

    def __init__(
        self,
        detector: SlipDetector,
        controller: AnyController,
        guard: ForceGuard,
        monitors: Monitors | None = None,
        motion: Callable[[], Motion | None] = lambda: None,
    ) -> None:
        """``motion``: reads the detector's estimate of the kind of slip at its latest frame."""
        self.controller = controller
        self._motion = motion
        self._detector = detector
        self._guard = guard
        self._monitors = monitors or Monitors(MonitorSettings())
        self._estimated_n: Vector3 = (0.0, 0.0, 0.0)
        self._responsive_n: Vector3 = (0.0, 0.0, 0.0)
        self.last_close: CloseToLimit | None = None  # the closing that was admitted last
        self._tared = False  # counts are relative to rest counts that this run has taken
        self.hidden = Counter[str]()  # exceptions that were ignored, with their number
        self._reset_failure: Fault | None = None  # why the detector's last reset failed

    def decide(self, obs: Observation) -> StepResult:
        """Process one frame and the states of the other devices; ``obs`` has no derived values
        yet."""
        self._observe(obs)
        decision = self.controller.step(obs)
        if decision.reset_detector:
            obs.motion()  # of the state before: it keeps its first value
            self._reset_detector()
        if decision.first_grasp:
            self._guard.set_first_grasp(obs.gripper.min_closure_counts, self._estimated_n)
        admitted: tuple[Command, ...] = ()
        if decision.commands:
            admitted = tuple(self.admit(command, obs.gripper) for command in decision.commands)
            self._monitors.sent(admitted, obs.arm)
        return StepResult(obs, decision, admitted)

    def admit(self, command: Command, gripper: GripperState) -> Command:
        """The command that the guard admits instead, at the latest estimated force."""
        if not isinstance(command, GripperCommand):
            return command
        admitted = self._guard.admit(command, gripper, self._estimated_n)
        if isinstance(admitted, CloseToLimit):
            self.last_close = admitted
        return admitted

    def fallback(self, commands: Iterable[Command], gripper: GripperState) -> GripperCommand | None:
        """The first of these commands to the hand as the guard admits it now, to be sent later if
        the loop has ended. None: leave the hand as it is."""
        command = next((c for c in commands if isinstance(c, GripperCommand)), None)
        return None if command is None else self._guard.admit(command, gripper, self._estimated_n)

    def _observe(self, obs: Observation) -> None:
        """Set the derived values."""
        state = self.controller.state
        faults = obs.errors
        if found := self._monitors.check(state, obs):
            faults = (*faults, *filter(self._monitors.stops, found))
            obs.reported = tuple(fault for fault in found if fault not in faults)
        # `grasp.tare` counts as tared: there is no frame until this run's rest counts are taken
        self._tared |= state not in UNTARED_STATES
        # a detector that failed or hung must not delay the safe state
        safe_state_due = bool(obs.stop or faults) or self.controller.in_safe_state
        frame, probabilities = obs.frame, NO_SLIP
        failure: Fault | None = None
        if frame is not None and self._tared:
            if self._monitors.force_plausible:
                self._estimate_force(frame.counts.tolist())
            if not safe_state_due:
                probabilities, failure = self._detect(frame)
        if failure is not None and state not in OPEN_STATES:  # contact is expected
            faults = (*faults, failure)
        obs.probabilities = probabilities
        obs.faults = faults
        obs.estimated_n = self._estimated_n
        obs.responsive_n = self._responsive_n
        obs.overloaded = self._guard.overloaded(self._estimated_n)
        obs.last_close = self.last_close
        if grip := self._guard.grip:
            self._guard.observe(obs, self._estimated_n, self._monitors.fingertips.all_responsive)
            obs.reading, obs.rise_n, obs.rise_measured = grip.now, grip.rise_n, grip.measured
        obs.safe_travel_counts = self._guard.safe_travel(obs.gripper, self._estimated_n)
        obs.thumb_end_counts = self._guard.thumb_end_counts
        obs.motion = partial(self._kind_of_slip, probabilities, [])

    def _estimate_force(self, counts: list[list[int]]) -> None:
        a, b, c = map(sum, counts)
        self._estimated_n = self._responsive_n = self._guard.estimated_n((a, b, c))
        fingertips = self._monitors.fingertips
        if not fingertips.all_responsive:
            a, b, c = map(sum, map(compress, counts, fingertips.responsive))
            self._responsive_n = self._guard.estimated_n((a, b, c))

    def _detect(self, frame: TactileFrame) -> tuple[NDArray[np.float64], Fault | None]:
        """Probability of slip at each finger, and the fault if the detector failed. A stale frame
        resets the detector."""
        if frame.stale:
            self._reset_detector()
        if frame.stale or self._reset_failure:
            return NO_SLIP, self._reset_failure
        try:
            probabilities = self._detector.update(frame.counts)
        except KeyboardInterrupt:
            raise
        except BaseException as bug:  # a plug-in's bug must not end a run
            return NO_SLIP, _failed(bug)
        invalid = invalid_probabilities(probabilities)
        return (NO_SLIP, invalid) if invalid else (probabilities, None)

    def _kind_of_slip(
        self, probabilities: NDArray[np.float64], read: list[Motion | None]
    ) -> Motion | None:
        """The detector's estimate; ``read`` keeps it, because a reset of the detector ends it."""
        if not read:
            read.append(None)
            if max(probabilities.tolist()) > SLIP_LIKELY:
                with counted(self.hidden):  # only recorded, so a bug must not end a run
                    read[0] = self._motion()
        return read[0]

    def _reset_detector(self) -> None:
        """Reset the detector; after a failure it is not used until a reset succeeds."""
        try:
            self._detector.reset()
        except KeyboardInterrupt:
            raise
        except BaseException as bug:
            self._reset_failure = _failed(bug)
        else:
            self._reset_failure = None


def _failed(bug: BaseException) -> Fault:
    text = one_line(bug.message) if isinstance(bug, GraspError) else describe_exception(bug)
    return failed(DETECTOR_FAILED, how=text)
