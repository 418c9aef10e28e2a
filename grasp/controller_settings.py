"""Settings of the controller and its loop, and the plan of one grasp."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.interfaces import PERIOD_S, Counts3, Vector3
from grasp.contact_estimator import Stiffness


class GripPlan(msgspec.Struct, frozen=True):
    """Finger positions for one object, motor counts A, B, C (paper, section V-B), and the force cap
    for closing."""

    preshape_counts: Counts3  # just short of the object, the thumb further back
    grip_counts: Counts3  # in contact, with too little force
    force_cap_n: float  # for closing when slip is registered: the guard's limit (paper: 10 N)
    stiffness: Stiffness  # of the object's contact
    home: Vector3 | None = None  # of the arm, from an earlier run; None: its present position


class ControllerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Speeds, heights and durations of a grasp. Values without a source are assumed."""

    # distance before the grip positions at which the fingers wait, and more for the thumb
    preshape_margin_counts: Annotated[int, Meta(ge=2, le=60, description="short of grip")] = 15
    thumb_back_counts: Annotated[int, Meta(ge=0, le=100, description="thumb further back")] = 15
    approach_speed_mps: Annotated[float, Meta(ge=0.022, le=0.11, description="in free air")] = 0.11
    grip_speed_mps: Annotated[float, Meta(ge=0.022, le=0.11, description="to the object")] = 0.022
    grip_force_n: Annotated[float, Meta(gt=0.0, le=60.0, description="of the first grasp")] = 10.0
    closing_speed_mps: Annotated[float, Meta(ge=0.022, le=0.11, description="for slip")] = 0.11
    # to the force cap: fast by position to just short of the limit, then slowly; or at one speed
    # (as in the paper, and always with guard.cap_mode = each_motor)
    closing: Annotated[
        Literal["two_stage", "constant"], Meta(description="speed of closing for slip")
    ] = "two_stage"
    settle_s: Annotated[float, Meta(ge=0.02, le=5.0, description="for the pads to relax")] = 0.3
    baseline_s: Annotated[float, Meta(ge=0.02, le=5.0, description="baseline of detector")] = 0.3
    lift_height_m: Annotated[float, Meta(ge=0.01, le=1.0, description="assumed, 0.1-0.3")] = 0.2
    lift_speed_mps: Annotated[float, Meta(ge=0.005, le=0.5, description="assumed, 0.1-0.25")] = 0.1
    lift_acceleration_mps2: Annotated[float, Meta(ge=0.05, le=5.0, description="assumed")] = 0.5
    slip_response: Annotated[
        Literal["stop_and_close", "close", "stop_and_step"],
        Meta(description="in the lift the arm stops while the hand closes; with `close` the arm "
             "moves on (the paper's loop); with `stop_and_step` the hand closes in small steps"),
    ] = "stop_and_close"  # fmt: skip
    # without a margin, a third of the objects fall at a pull of 2 N
    margin_steps: Annotated[int, Meta(ge=0, le=20, description="added to the force found")] = 2
    # below gravity, because the braking unloads the grip; start with 1 on real devices
    slip_stop_mps2: Annotated[float, Meta(ge=0.1, le=9.0, description="for slip")] = 8.0
    lower_speed_mps: Annotated[float, Meta(ge=0.005, le=0.5, description="of the arm")] = 0.05
    # during a decision delay of 0.1 s the arm moves 0.5 mm: 0.5-1 N on a steep flank
    feel_speed_mps: Annotated[float, Meta(ge=0.005, le=0.1, description="lower.feel")] = 0.005
    retreat_m: Annotated[float, Meta(ge=0.0, le=0.5, description="up from the object")] = 0.05
    stop_deceleration_mps2: Annotated[float, Meta(ge=0.1, le=10.0, description="safe stop")] = 1.0
    hold_s: Annotated[float, Meta(ge=0.0, le=600.0, description="at the top of the lift")] = 1.0
    # or the detector's memory, if that is longer
    cap_patience_s: Annotated[float, Meta(ge=0.05, le=5.0, description="slip at the cap")] = 0.3
    # if true, no run ends as cap_reached (paper, section V-C)
    hold_by_clock: Annotated[bool, Meta(description="hold for hold_s even during slip")] = False
    contact_n: Annotated[float, Meta(ge=0.05, le=5.0, description="least force of contact")] = 0.3
    stale_after_s: Annotated[float, Meta(ge=0.02, le=1.0, description="oldest device state")] = 0.1
    # of each state except approach.start and hold
    phase_timeout_s: Annotated[float, Meta(ge=1.0, le=600.0, description="of a state")] = 30.0
    keep: Annotated[bool, Meta(description="keep holding at the top, no set-down")] = False
    firm: Annotated[bool, Meta(description="close to the cap before the lift (paper, V-B)")] = False
    reactions: Annotated[bool, Meta(description="respond to slip; off in open-loop runs")] = True

    @property
    def unread(self) -> dict[str, str]:
        """Settings that the chosen slip response does not use, with the reason."""
        steps = () if self.slip_response == "stop_and_step" else ("margin_steps",)
        stops = ("slip_stop_mps2",) if self.slip_response == "close" else ()
        return dict.fromkeys((*steps, *stops), f"controller.slip_response = {self.slip_response}")


class LoopSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Period and deadlines of the control loop (`grasp.loop`)."""

    # of a tactile sample (paper: 100 Hz)
    period_s: Annotated[float, Meta(ge=0.002, le=0.1, description="one sample")] = PERIOD_S
    # by default the median with `energy`; the paper's inference takes 0.021 s
    decision_delay_s: Annotated[float, Meta(ge=0.0, le=0.5, description="in virtual time")] = 2e-5
    # independent of the time-outs of states; assumed
    deadline_s: Annotated[float, Meta(ge=1.0, le=3600.0, description="of a run")] = 180.0
