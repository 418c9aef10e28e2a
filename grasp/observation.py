"""StepInput: all inputs of one control step. Observation: these, and what was derived from them."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from drivers.interfaces import ArmState, Counts3, Detection, GripperState, TactileFrame, Vector3
from grasp.commands import CloseFast
from grasp.fault import ARM, GRIPPER, Fault, stale


class StepInput(msgspec.Struct, frozen=True, kw_only=True):
    """All inputs of one step; ``frame`` is None until the fingertips have sent one.

    ``pending``: a command of an earlier step has not reached its device yet. ``errors``: what the
    drivers raised since the last step. ``set_down``: the experiment is done, and a held object may
    be set down. ``stop``: why the run is to end now; None while it may go on.
    ``late_ns``: by how much this step began too late, after the devices were read; ``took_ns``: how
    long the step before took. Both are 0 in virtual time.
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


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """All that the controller may know: the step's inputs, and what follows from them.

    ``probabilities``: of slip, (3,), zeros without a fresh frame. ``faults``: ``inputs.errors`` and
    plausibility checks that failed; ``reported``: those that end no run.
    ``measured_n``: estimated force of each finger; ``felt_n``: from those taxels alone that would
    show its end, since none of them is at a rail or stuck. ``overloaded``: measured force is above
    the limit and its margin. ``last_close``: the closing that was admitted last. ``reach_counts``,
    ``thumb_end``: see ``ForceGuard``.
    ``motion``: the kind of slip, where the detector can tell; recorded and shown, never used.
    """

    inputs: StepInput
    probabilities: NDArray[np.float64]
    faults: tuple[Fault, ...] = ()
    reported: tuple[Fault, ...] = ()
    measured_n: Vector3 = (0.0, 0.0, 0.0)
    felt_n: Vector3 = (0.0, 0.0, 0.0)
    overloaded: bool = False
    last_close: CloseFast | None = None
    reach_counts: Counts3 | None = None
    thumb_end: int | None = None
    motion: Motion | None = None

    @property
    def t_ns(self) -> int:
        return self.inputs.t_ns

    @property
    def frame(self) -> TactileFrame | None:
        return self.inputs.frame

    @property
    def gripper(self) -> GripperState:
        return self.inputs.gripper

    @property
    def arm(self) -> ArmState:
        return self.inputs.arm

    @property
    def pending(self) -> bool:
        """A command of an earlier step has not reached its device yet."""
        return self.inputs.pending

    def device_fault(self, old_ns: float) -> Fault | None:
        """The first fault that gripper or arm reports, or whose state is older than ``old_ns``."""
        if self.gripper.age_ns(self.t_ns) > old_ns:
            return stale(GRIPPER, "gripper status too old")
        if self.arm.age_ns(self.t_ns) > old_ns:
            return stale(ARM, "arm state too old")
        if self.gripper.fault:
            text = f"gripper fault: {self.gripper.fault_text}"
            return Fault("gripper_fault", GRIPPER, text, "clear the fault of the hand first")
        if self.arm.stopped_by_safety:
            text = "arm stopped by its safety system"
            return Fault("arm_safety_stop", ARM, text, "release the stop at the arm's pendant")
        return None

    @property
    def hand_rests(self) -> bool:
        """Whether the fingers stand, and no command is on its way."""
        return not self.pending and self.gripper.at_rest

    @property
    def closed_out(self) -> bool:
        """Whether no closing would have an effect: the hand is at its cap, or the guard admits none
        since measured force is above the limit."""
        return self.at_cap or (self.overloaded and self.hand_rests)

    @property
    def unfinished(self) -> bool:
        """Whether a first stage rests short of the force cap, and another closing is due."""
        return self.first_stage and self.hand_rests and not self.closed_out

    @property
    def first_stage(self) -> bool:
        """Whether the closing that was admitted last was a first stage."""
        return self.last_close is not None and self.last_close.more

    @property
    def at_cap(self) -> bool:
        """Whether another closing would have no effect: each finger that closed last is latched in
        contact, or stands at the last count that the guard admits, unless that was a first stage.
        True also while a command, mostly one to the arm, is on its way."""
        close, thumb = self.last_close, self.gripper.fingers[0]
        if not self.gripper.at_rest:
            return False
        if self.thumb_end is not None and thumb.position_counts >= self.thumb_end:
            return True
        if close is None:  # only a step to the cap latches a thumb that no closing was sent to
            return self.gripper.thumb_latched
        fingers = zip(self.gripper.fingers, close.closing, close.limits_counts, strict=True)
        return all(
            f.detection is Detection.CONTACT_CLOSING
            or (f.position_counts >= limit and not close.more)
            for f, closes, limit in fingers
            if closes
        )
