"""What a grasp is given beforehand: where, how fast, how patient."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.interfaces import Counts3, Vector3
from grasp.contact_estimator import Stiffness


class GripPlan(msgspec.Struct, frozen=True):
    """Predetermined finger positions of one object, motor counts A, B, C (paper, section V-B), and
    the force to close with."""

    preshape_counts: Counts3  # just short of the object, the thumb further back
    grip_counts: Counts3  # in contact, with too little force
    force_cap_n: float  # to close with when slip is registered: the guard's limit (paper: 10 N)
    stiffness: Stiffness  # of the object's contact
    home: Vector3 | None = None  # of the arm, from an earlier run; None: where it stands


class ControllerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Speeds, heights and patience of a grasp. The figures without a source are assumed."""

    preshape_margin_counts: Annotated[
        int, Meta(ge=2, le=60, description="fingers wait this far short of the grip positions")
    ] = 15
    thumb_back_counts: Annotated[
        int, Meta(ge=0, le=100, description="the thumb, which closes last, waits further back")
    ] = 15
    approach_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="of the fingers in free air")
    ] = 0.11
    grip_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="of the fingers onto the object")
    ] = 0.022
    grip_force_n: Annotated[
        float, Meta(gt=0.0, le=60.0, description="force setting while moving to the grip positions")
    ] = 10.0
    closing_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="asked for when slip is registered")
    ] = 0.11
    closing: Annotated[
        Literal["two_stage", "constant"],
        Meta(
            description="to the force cap: fast by position to just short of the limit, then "
            "slowly; or at one speed (the paper's). With guard.cap_mode = each_motor at one speed"
        ),
    ] = "two_stage"
    relax_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="the pads relax, from the fingers' rest on")
    ] = 0.3
    listen_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="the detector listens before the arm lifts")
    ] = 0.3
    lift_height_m: Annotated[float, Meta(ge=0.01, le=1.0, description="paper: not stated")] = 0.2
    lift_speed_mps: Annotated[float, Meta(ge=0.005, le=0.5, description="paper: not stated")] = 0.1
    lift_acceleration_mps2: Annotated[
        float, Meta(ge=0.05, le=5.0, description="paper: not stated")
    ] = 0.5
    answer: Annotated[
        Literal["stop_and_jump", "jump", "stop_and_step"],
        Meta(
            description="to slip: the hand closes as fast as it may; in the lift the arm stops and "
            "goes on when slip is over, or with `jump` goes on rising (the paper's loop); with "
            "`stop_and_step` the hand presses no harder there than it has to"
        ),
    ] = "stop_and_jump"
    margin_steps: Annotated[
        int, Meta(ge=0, le=20, description="beyond the force found; without, a third fall at 2 N")
    ] = 2
    answer_stop_mps2: Annotated[
        float,
        Meta(
            ge=0.1, le=9.0,
            description="of that stop; below gravity, as on the way up it takes load off the grip; "
            "a lab begins with 1 (docs/hardware.md)",
        ),
    ] = 8.0  # fmt: skip
    lower_speed_mps: Annotated[float, Meta(ge=0.005, le=0.5, description="of the arm")] = 0.05
    landing_speed_mps: Annotated[
        float,
        Meta(
            ge=0.005, le=0.1,
            description="of the arm where the object may stand already, or faster, to need 0.8 of "
            "phase_timeout_s; in the 0.1 s of a late decision it goes 0.5 mm, 1 N on a steep flank",
        ),
    ] = 0.005  # fmt: skip
    retreat_m: Annotated[
        float, Meta(ge=0.0, le=0.5, description="upwards, after the fingers have opened")
    ] = 0.05
    stop_deceleration_mps2: Annotated[
        float, Meta(ge=0.1, le=10.0, description="of the arm, in every safe state")
    ] = 1.0
    hold_s: Annotated[
        float, Meta(ge=0.0, le=600.0, description="at the top, before it is set down")
    ] = 1.0
    cap_patience_s: Annotated[
        float,
        Meta(
            ge=0.05, le=5.0,
            description="slip may be registered so long after the mask of the last closing; as "
            "long as the detector remembers, where that is longer",
        ),
    ] = 0.3  # fmt: skip
    hold_by_clock: Annotated[
        bool,
        Meta(
            description="a hold ends after hold_s whatever the slip status says, and slip at the "
            "force cap is borne: there is no cap_reached (the paper's loop, section V-C, has none)"
        ),
    ] = False
    contact_n: Annotated[
        float, Meta(ge=0.05, le=5.0, description="measured force from which on there is contact")
    ] = 0.3
    stale_after_s: Annotated[
        float, Meta(ge=0.02, le=1.0, description="age at which gripper or arm state is too old")
    ] = 0.1
    phase_timeout_s: Annotated[
        float, Meta(ge=1.0, le=600.0, description="a phase other than idle and hold may last")
    ] = 30.0
    keep: Annotated[bool, Meta(description="keep holding at the top, set nothing down")] = False
    firm: Annotated[
        bool, Meta(description="close to the force cap before lifting, as for the tap (paper, V-B)")
    ] = False
    reactions: Annotated[
        bool, Meta(description="respond to slip; off in the twin run that judges false starts")
    ] = True

    @property
    def unread(self) -> dict[str, str]:
        """Settings for which the chosen response has no use, and what does not read them."""
        steps = () if self.answer == "stop_and_step" else ("margin_steps",)
        stops = ("answer_stop_mps2",) if self.answer == "jump" else ()
        return dict.fromkeys((*steps, *stops), f"controller.answer = {self.answer}")
