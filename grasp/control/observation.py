"""StepInput: all inputs of one control step. Observation: the inputs and derived values."""

from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import Motion
from drivers.interfaces import (
    FINGERS,
    ArmState,
    Counts3,
    Detection,
    GripperState,
    TactileFrame,
    Vector3,
)
from grasp.control.commands import CloseToLimit
from grasp.control.fault import ARM, GRIPPER, Fault, stale
from grasp.control.grip_measure import Reading

NO_SLIP = np.zeros(FINGERS)  # the probabilities of a step without any
NO_SLIP.flags.writeable = False


class StepInput(msgspec.Struct, kw_only=True):
    """All inputs of one step. ``frame`` is None until the fingertips have sent one.

    ``pending``: a command of an earlier step has not reached its device yet. ``errors``: faults
    that the drivers raised since the last step. ``set_down``: the experiment is complete, and a
    held object is to be set down. ``stop``: why the run must end now, else None.
    ``late_ns``: delay of this step's start, including the reading of the devices. ``took_ns``:
    duration of the previous step. Both are 0 in virtual time.
    """

    t_ns: int
    frame: TactileFrame | None
    rest_taken: bool
    gripper: GripperState
    arm: ArmState
    pending: bool = False
    errors: tuple[Fault, ...] = ()
    gripper_lost: bool = False
    set_down: bool = False
    stop: Fault | None = None
    late_ns: int = 0
    took_ns: int = 0


class Observation(StepInput, kw_only=True):
    """All that the controller knows in one step: the inputs, and values derived from them.

    Made with the inputs; ``GraspStep`` sets the derived values once, before the controller's step.

    ``probabilities``: of slip, (3,); zeros without a fresh frame. ``faults``: ``errors`` and
    plausibility checks that failed; ``reported``: failed checks that do not end the run.
    ``estimated_n``: estimated force of each finger, N; ``responsive_n``: the same from responsive
    taxels only, which are neither saturated nor stuck and so would show the loss of contact.
    ``overloaded``: estimated force exceeds the limit by more than the estimate's margin.
    ``last_close``: the closing that was admitted last. ``safe_travel_counts``,
    ``thumb_end_counts``: see ``ForceGuard``.
    ``reading``, ``rise_n``, ``rise_measured``: of a grip by touch, see ``GripMeasure``.
    ``motion``: reads the kind of slip, where the detector estimates it: once, at the latest before
    the next step. It is only recorded and shown, and takes longer than the detector itself.
    """

    probabilities: NDArray[np.float64] = NO_SLIP
    faults: tuple[Fault, ...] = ()
    reported: tuple[Fault, ...] = ()
    estimated_n: Vector3 = (0.0, 0.0, 0.0)
    responsive_n: Vector3 = (0.0, 0.0, 0.0)
    overloaded: bool = False
    last_close: CloseToLimit | None = None
    safe_travel_counts: Counts3 | None = None
    thumb_end_counts: int | None = None
    reading: Reading | None = None
    rise_n: float | None = None
    rise_measured: bool = False
    motion: Callable[[], Motion | None] = lambda: None

    def device_fault(self, old_ns: float) -> Fault | None:
        """The first fault of gripper or arm: a state older than ``old_ns``, or a reported fault."""
        gripper, arm = self.gripper, self.arm
        if self.t_ns - gripper.t_ns > old_ns:
            return stale(GRIPPER, "gripper status too old")
        if self.t_ns - arm.t_ns > old_ns:
            return stale(ARM, "arm state too old")
        if gripper.fault:
            text = f"gripper fault: {gripper.fault_text}"
            return Fault("gripper_fault", GRIPPER, text, "clear the fault of the hand first")
        if arm.stopped_by_safety:
            text = "arm stopped by its safety system"
            return Fault("arm_safety_stop", ARM, text, "release the stop at the arm's pendant")
        return None

    @property
    def by_touch(self) -> bool:
        """Whether the first grasp was closed by touch, so that readings at rest bound the force."""
        return self.rise_n is not None

    @property
    def hand_rests(self) -> bool:
        """Whether the fingers are at rest, and no command is on its way."""
        return not self.pending and self.gripper.at_rest

    @property
    def closing_exhausted(self) -> bool:
        """Whether no closing would have an effect: the hand is at the force limit, or the guard
        admits no closing because estimated force is above the limit."""
        return self.at_limit or (self.overloaded and self.hand_rests)

    @property
    def second_stage_due(self) -> bool:
        """Whether a first stage has ended below the force limit, so that the second is due."""
        return self.first_stage and self.hand_rests and not self.closing_exhausted

    @property
    def first_stage(self) -> bool:
        """Whether the closing that was admitted last was a first stage."""
        return self.last_close is not None and self.last_close.first_stage

    @property
    def at_limit(self) -> bool:
        """Whether the hand is at the force limit, so that another closing would have no effect.

        Each finger that the last closing moved is then latched in contact or, unless it was a first
        stage, at the last position that the guard admits. Can be true while a command is pending.
        """
        close, thumb = self.last_close, self.gripper.fingers[0]
        if not self.gripper.at_rest:
            return False
        if self.thumb_end_counts is not None:
            return self.gripper.thumb_latched or thumb.position_counts >= self.thumb_end_counts
        if close is None:  # without a closing, only a step to the limit latches the thumb
            return self.gripper.thumb_latched
        fingers = zip(self.gripper.fingers, close.closing, close.ends_counts, strict=True)
        for finger, closes, end_counts in fingers:
            at_limit = finger.position_counts >= end_counts and not close.first_stage
            if closes and not at_limit and finger.detection is not Detection.CONTACT_CLOSING:
                return False
        return True
