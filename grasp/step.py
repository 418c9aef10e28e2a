"""GraspStep: detector, slip monitor, controller and force guard as one unit, fed a frame at a time.

A loop on devices, a run in virtual time and the replay of a recording all feed this unit and none
of them repeats anything of it. No clock is read, nothing sleeps, nothing does I/O: what a step
concludes follows from what it is told now and was told before.
"""

from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGERS, ArmState, GripperState, TactileFrame, Vector3
from grasp.commands import Command, GripperCommand
from grasp.controller import Decision, GraspController, Observation
from grasp.guard import ForceGuard


class Detector(Protocol):
    """See ``detector.interface``."""

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]: ...


class StepInput(msgspec.Struct, frozen=True):
    """Everything that one step is told; ``frame`` is None until the fingertips have sent one.

    ``pending``, ``trouble``, ``gripper_lost``, ``set_down``, ``stop``: as in ``Observation``.
    """

    t_ns: int
    frame: TactileFrame | None
    rest_taken: bool
    gripper: GripperState
    arm: ArmState
    pending: bool = False
    trouble: str = ""
    gripper_lost: bool = False
    set_down: bool = False
    stop: str = ""


class StepResult(msgspec.Struct, frozen=True):
    """What one step concluded: ``admitted`` are ``decision.commands`` as the guard lets them go."""

    observation: Observation
    decision: Decision
    measured_n: Vector3
    admitted: tuple[Command, ...]


class GraspStep:
    """From what the devices say to the commands that may go to them."""

    def __init__(self, detector: Detector, controller: GraspController, guard: ForceGuard) -> None:
        self.controller = controller
        self._detector = detector
        self._guard = guard
        self._measured_n: Vector3 = (0.0, 0.0, 0.0)

    def decide(self, told: StepInput) -> StepResult:
        """Take one frame with the states of the other devices."""
        observation = self._observe(told)
        decision = self.controller.step(observation)
        if decision.reset_detector:
            self._detector.reset()
        if decision.anchor:
            self._guard.anchor(told.gripper.positions, self._measured_n)
        admitted = tuple(self.admit(command, told.gripper) for command in decision.commands)
        return StepResult(observation, decision, self._measured_n, admitted)

    def admit(self, command: Command, gripper: GripperState) -> Command:
        """The command that may go out in place of this one, by the force measured last."""
        if isinstance(command, GripperCommand):
            return self._guard.admit(command, gripper, self._measured_n)
        return command

    def _observe(self, told: StepInput) -> Observation:
        return Observation(
            t_ns=told.t_ns,
            probabilities=self._listen(told.frame),
            tactile_stale=told.frame is not None and told.frame.stale,
            rest_taken=told.rest_taken,
            gripper=told.gripper,
            arm=told.arm,
            pending=told.pending,
            trouble=told.trouble,
            gripper_lost=told.gripper_lost,
            set_down=told.set_down,
            stop=told.stop,
        )

    def _listen(self, frame: TactileFrame | None) -> NDArray[np.float64]:
        """Probability of slip at each finger; a stale frame is no sample, and forgets the past."""
        if frame is None:
            return np.zeros(FINGERS)
        a, b, c = frame.counts.sum(axis=1).tolist()
        self._measured_n = self._guard.measured_n((a, b, c))
        if frame.stale:
            self._detector.reset()
            return np.zeros(FINGERS)
        return self._detector.update(frame.counts)
