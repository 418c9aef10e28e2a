"""Settings of the controller and its loop, and the plan of one grasp."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.interfaces import PERIOD_S, Counts3, Vector3
from grasp.control.contact_estimator import Stiffness


class GripPlan(msgspec.Struct, frozen=True):
    """Plan of a grasp of one object: finger positions A, B, C in motor counts (paper, section V-B),
    and force."""

    preshape_counts: Counts3  # just short of the object, the thumb further back
    grip_counts: Counts3  # in contact, with too little force
    force_limit_n: float  # when the hand closes for slip: that of the guard (paper: 10 N)
    stiffness: Stiffness  # of the contact between thumb and object
    home: Vector3 | None = None  # of the arm, from an earlier run; None: its present position

    @property
    def shape_counts(self) -> Counts3:
        """Before rest counts are taken, the thumb stays open: B and C might push an object wider
        than stated onto it."""
        _, b, c = self.preshape_counts
        return 0, b, c


class ControllerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Speeds, heights and durations of a grasp. Values without a source are assumed."""

    first_grasp: Annotated[
        Literal["touch", "counts"] | None,
        Meta(description="touch: the fingers close until they feel the object, then by counts to "
             "first_force_n; counts: they close to object.grip_counts (paper, section V-B); null: "
             "touch in `grasp run lift`, `grasp.lift` and ROS, unless the grip is firm or "
             "guard.limit_mode is each_motor; elsewhere counts"),
    ] = None  # fmt: skip
    # the lift experiment is about a grip that is too weak; to carry things, 4 N
    first_force_n: Annotated[
        float, Meta(ge=0.5, le=30.0, description="estimated force of a first grasp by touch")
    ] = 2.0
    approach_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="finger speed in free air")
    ] = 0.11
    grip_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="finger speed when closing onto the object")
    ] = 0.022
    grip_force_n: Annotated[
        float, Meta(gt=0.0, le=60.0, description="force of a first grasp at given counts")
    ] = 10.0
    closing_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="finger speed of the closing for slip")
    ] = 0.11
    # two_stage: fast to the safe travel (`ForceGuard`), then slowly to the limit. constant: one
    # speed, as in the paper, and always with guard.limit_mode = each_motor
    closing: Annotated[
        Literal["two_stage", "constant"],
        Meta(description="closing for slip: in two stages, or at one speed"),
    ] = "two_stage"
    settle_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="wait after the grasp until the pads have relaxed")
    ] = 0.3
    baseline_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="rest in which the detector takes its baseline")
    ] = 0.3
    lift_height_m: Annotated[
        float, Meta(ge=0.01, le=1.0, description="height of the lift; assumed, 0.1-0.3 m")
    ] = 0.2
    lift_speed_mps: Annotated[
        float, Meta(ge=0.005, le=0.5, description="of the arm in the lift; assumed, 0.1-0.25")
    ] = 0.1
    lift_acceleration_mps2: Annotated[
        float, Meta(ge=0.05, le=5.0, description="of the arm in the lift; assumed")
    ] = 0.5
    slip_response: Annotated[
        Literal["stop_and_close", "close", "stop_and_step"],
        Meta(description="response to slip. stop_and_close: the arm stops while the hand closes to "
             "the force limit; close: the hand closes and the arm moves on (the paper's loop); "
             "stop_and_step: the arm stops and the hand closes in small steps"),
    ] = "stop_and_close"  # fmt: skip
    # with 0 steps, a third of the objects fall at a pull of 2 N
    margin_steps: Annotated[
        int, Meta(ge=0, le=20, description="closing steps that stop_and_step adds after slip")
    ] = 2
    # below gravity, because the braking unloads the grip; start with 1 on real devices
    slip_stop_mps2: Annotated[
        float, Meta(ge=0.1, le=9.0, description="deceleration of the arm when it stops for slip")
    ] = 8.0
    lower_speed_mps: Annotated[
        float, Meta(ge=0.005, le=0.5, description="speed of the arm, lowering and retreating")
    ] = 0.05
    # during a decision delay of 0.1 s the arm moves 0.5 mm: 0.5-1 N on a steep flank
    feel_speed_mps: Annotated[
        float, Meta(ge=0.005, le=0.1, description="speed of the arm close to the table")
    ] = 0.005
    retreat_m: Annotated[
        float, Meta(ge=0.0, le=0.5, description="rise of the arm after the set-down")
    ] = 0.05
    stop_deceleration_mps2: Annotated[
        float, Meta(ge=0.1, le=10.0, description="of the arm in a safe stop")
    ] = 1.0
    hold_s: Annotated[
        float, Meta(ge=0.0, le=600.0, description="hold at the top after the last slip")
    ] = 1.0
    # the detector's memory is used instead if it is longer
    limit_patience_s: Annotated[
        float, Meta(ge=0.05, le=5.0, description="duration of slip at the limit before a set-down")
    ] = 0.3
    # then no run ends as limit_reached
    hold_by_clock: Annotated[
        bool, Meta(description="hold for hold_s even during slip (paper, V-C)")
    ] = False
    contact_n: Annotated[
        float, Meta(ge=0.05, le=5.0, description="least estimated force of a finger in contact")
    ] = 0.3
    stale_after_s: Annotated[
        float, Meta(ge=0.02, le=1.0, description="age at which the state of hand or arm is stale")
    ] = 0.1
    # approach.start and hold have no such limit
    phase_timeout_s: Annotated[
        float, Meta(ge=1.0, le=600.0, description="longest duration of a state")
    ] = 30.0
    keep: Annotated[
        bool, Meta(description="end with the object held at the top, without set-down")
    ] = False
    firm: Annotated[
        bool, Meta(description="close to the force limit before the lift (paper, V-B)")
    ] = False
    reactions: Annotated[bool, Meta(description="respond to slip; false: open loop")] = True

    @property
    def unread(self) -> dict[str, str]:
        """Settings that the chosen slip response does not use, with the reason."""
        steps = () if self.slip_response == "stop_and_step" else ("margin_steps",)
        stops = ("slip_stop_mps2",) if self.slip_response == "close" else ()
        return dict.fromkeys((*steps, *stops), f"controller.slip_response = {self.slip_response}")


class LoopSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Period and deadlines of the control loop (`grasp.run.loop`)."""

    # paper: 100 Hz
    period_s: Annotated[
        float, Meta(ge=0.002, le=0.1, description="period of the loop and of tactile samples")
    ] = PERIOD_S
    # default: the measured median with `energy`; the paper's inference takes 0.021 s
    decision_delay_s: Annotated[
        float, Meta(ge=0.0, le=0.5, description="simulated time from sample to command")
    ] = 2e-5
    deadline_s: Annotated[
        float, Meta(ge=1.0, le=3600.0, description="longest duration of a run; assumed")
    ] = 180.0
