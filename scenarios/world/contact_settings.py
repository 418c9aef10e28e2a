"""What is assumed of the hand's compliances and of the pads."""

from typing import Annotated

import msgspec
from msgspec import Meta

GRAVITY_MPS2 = 9.81
GROSS_SLIP_MPS = 0.003  # paper, section III-B: the bound of the label `slip`
GROSS_TURN_RADPS = 0.2  # and of that label in rotation


class ContactSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Compliances of hand and pads."""

    half_aperture_m: Annotated[
        float,
        Meta(gt=0.02, le=0.1, description="pad to centre plane, open; manual: 155 mm opening"),
    ] = 0.0775
    mount_stiffness_npm: Annotated[
        float,
        Meta(
            ge=500.0,
            le=1e6,
            description="linkage of one finger; assumed, 3-10 N/mm: without it "
            "one motor count would be 7-15 N and no insufficient grasp would exist",
        ),
    ] = 5000.0
    pad_stiffness_npm: Annotated[
        float, Meta(ge=500.0, le=1e6, description="10 mm urethane pad, normal; derived, 12-20 N/mm")
    ] = 15000.0
    pad_half_length_m: Annotated[
        float, Meta(ge=0.0, le=0.02, description="flat pad, along the slip; assumed, 8-12 mm")
    ] = 0.010
    shear_stiffness_npm: Annotated[
        float, Meta(ge=500.0, le=1e6, description="pad, tangential; derived, 6-12 N/mm")
    ] = 8000.0
    shear_damping_nspm: Annotated[
        float, Meta(ge=0.0, le=200.0, description="pad, tangential; assumed, 5-16 N s/m")
    ] = 12.0
    normal_loss_s: Annotated[
        float,
        Meta(
            ge=0.0, le=0.01,
            description="damping over stiffness of finger and pad along the closing axis, of what "
            "a blow along it has struck; as the pad's in shear, assumed, 0.5-3 ms",
        ),
    ] = 1.5e-3  # fmt: skip
    relaxation_fraction: Annotated[
        float, Meta(ge=0.0, le=0.5, description="of the normal force; real clip 0.05-0.15")
    ] = 0.1
    relaxation_time_s: Annotated[
        float, Meta(ge=0.01, le=5.0, description="of that fraction; real clip 0.1-0.3 s")
    ] = 0.2
    gross_slip_mps: Annotated[
        float, Meta(gt=0.0, le=1.0, description="truth: faster is gross slip; paper: 3 mm/s")
    ] = GROSS_SLIP_MPS
    gross_turn_radps: Annotated[
        float, Meta(gt=0.0, le=60.0, description="truth: so is a faster turn; paper: 0.2 rad/s")
    ] = GROSS_TURN_RADPS
    force_rise_n: Annotated[
        float,
        Meta(
            gt=0.0,
            le=10.0,
            description="truth: a grip force has increased by this much; a few wander deviations",
        ),
    ] = 0.2
    finger_spacing_m: Annotated[
        float, Meta(ge=0.0, le=0.1, description="of B and C; assumed, 40-75 mm")
    ] = 0.06
    step_s: Annotated[float, Meta(ge=1e-5, le=0.05, description="largest integration step")] = 5e-4
    blow_step_s: Annotated[
        float, Meta(ge=1e-6, le=0.05, description="largest step while a blow moves the object")
    ] = 1e-4

    @property
    def turn_lever_m(self) -> float:
        """Slip that a radian of rotation is worth: the ratio of the two bounds of gross slip."""
        return self.gross_slip_mps / self.gross_turn_radps
