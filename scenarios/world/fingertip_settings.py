"""What is assumed of a fingertip, and what one pad touches."""

from typing import Annotated

import msgspec
from msgspec import Meta


class Surface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What one pad touches. All figures are assumed."""

    curvature_per_mm: Annotated[
        tuple[float, float],
        Meta(description="along x and y of the pad before anything turns; 0 is flat"),
    ] = (0.0, 0.0)
    texture_rms_mm: Annotated[
        float, Meta(ge=0.0, le=1.0, description="irregularity; felt 0.3-0.45, smooth 0.01-0.2")
    ] = 0.1
    texture_length_mm: Annotated[
        float, Meta(ge=0.2, le=10.0, description="its correlation length; 1-2 mm")
    ] = 1.5
    friction_static: Annotated[float, Meta(ge=0.0, le=3.0, description="of rubber on it")] = 0.85
    friction_kinetic: Annotated[float, Meta(ge=0.0, le=3.0, description="when it slides")] = 0.7


class FingertipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geometry, rubber and noise of one fingertip, in the press and in the hand alike.

    CLIP: the middle of the range that the part `compliant` of the paper's set draws from
    (`config/datasets/paper.toml`; that range is named). The ranges were chosen by hand so that the
    set's statistics hold the authors' clip; no lift, tap or detector had a say.
    """

    pitch_mm: Annotated[
        float, Meta(ge=3.0, le=10.0, description="between barometers; assumed, 6-8")
    ] = 6.0
    taxels_mm: Annotated[
        tuple[tuple[float, float], ...],
        Meta(description="place of each barometer on the pad, x and y; none: two rows of three, "
             "pitch_mm apart, as in the kit. As many as `tactile.cells` has a finger"),
    ] = ()  # fmt: skip
    depth_mm: Annotated[
        float, Meta(ge=2.0, le=10.0, description="effective depth of the rubber; CLIP, 2.8-3.5")
    ] = 3.15
    pad_half_length_mm: Annotated[
        float, Meta(ge=3.0, le=20.0, description="of the spring bed, along x; assumed")
    ] = 10.0
    pad_half_width_mm: Annotated[
        float, Meta(ge=3.0, le=20.0, description="of the spring bed, along y; assumed")
    ] = 8.0
    crown_radius_mm: Annotated[
        float, Meta(ge=10.0, le=1000.0, description="of the pad's face; CLIP, 18-50")
    ] = 34.0
    tilt_rad: Annotated[
        float, Meta(ge=0.0, le=0.2, description="deviation of each pad's tilt, both axes; CLIP, "
                    "0.02-0.05")
    ] = 0.035  # fmt: skip
    tilt_x_rad: Annotated[
        float, Meta(ge=-0.4, le=0.4, description="mean of that tilt, rising along x: how the "
                    "authors' finger leaned on theirs, if it did; 0: nobody leans it on purpose")
    ] = 0.0  # fmt: skip
    tilt_y_rad: Annotated[float, Meta(ge=-0.4, le=0.4, description="likewise along y")] = 0.0
    foundation_n_per_mm3: Annotated[
        float, Meta(ge=0.02, le=2.0, description="spring bed, normal; CLIP, 0.35-0.8")
    ] = 0.575
    shear_share: Annotated[
        float, Meta(ge=0.1, le=1.0, description="of it, tangential stiffness; assumed from layer "
                    "theory, 0.4-0.6")
    ] = 0.5  # fmt: skip
    relaxation_slow_share: Annotated[
        float, Meta(ge=0.0, le=0.3, description="of that load, relaxes ten times slower, and as "
                    "much again a hundred times: rubber relaxes in log time, as barometers in "
                    "elastomer do; CLIP, 0.04-0.11")
    ] = 0.075  # fmt: skip
    relaxation_share: Annotated[
        float, Meta(ge=0.0, le=0.5, description="of a spring's load that relaxes; CLIP, 0.04-0.11")
    ] = 0.075
    relaxation_s: Annotated[
        float, Meta(ge=0.01, le=5.0, description="time constant of that; CLIP, 0.1")
    ] = 0.1
    wander_mm: Annotated[
        float, Meta(ge=0.0, le=0.1, description="rms of how much deeper or shallower the pad is "
                    "held than asked for; CLIP, 0.009-0.022")
    ] = 0.0155  # fmt: skip
    wander_fast_s: Annotated[
        float, Meta(ge=0.005, le=1.0, description="memory of its fast half; CLIP, 0.005-0.015")
    ] = 0.01
    wander_slow_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="memory of its slow half; CLIP, 0.5-1.5")
    ] = 1.0
    vibration_mm: Annotated[
        float, Meta(ge=0.0, le=0.1, description="likewise by the mode of an arm that moves; "
                    "CLIP, 0.002-0.01")
    ] = 0.006  # fmt: skip
    sway_mm: Annotated[
        float, Meta(ge=0.0, le=0.5, description="rms of that mode sideways; assumed, 0-0.05")
    ] = 0.01
    holding_share: Annotated[
        float, Meta(ge=0.0, le=2.0, description="how restless arm and hand are with an object in "
                    "them, over how restless while they press; what of it reaches the pads follows "
                    "from the object's inertia. Nobody has measured it: the middle of 0.1-1, over "
                    "which results should be swept")
    ] = 0.55  # fmt: skip
    held_damping: Annotated[
        float, Meta(ge=0.01, le=0.95, description="of a held object on its pads, of critical; "
                    "assumed, 0.1-0.3")
    ] = 0.2  # fmt: skip
    vibration_hz: Annotated[
        float, Meta(ge=2.0, le=45.0, description="frequency of that mode; CLIP, 10-25")
    ] = 17.5
    vibration_damping: Annotated[
        float, Meta(ge=0.005, le=1.0, description="of that mode; CLIP, 0.04-0.15")
    ] = 0.095
    noise_counts: Annotated[
        float, Meta(ge=0.0, le=5.0, description="rms before rounding; CLIP, 0.4-0.9")
    ] = 0.65
    rest_low: Annotated[int, Meta(ge=300, le=600, description="rest codes; assumed from")] = 420
    rest_high: Annotated[int, Meta(ge=300, le=600, description="rest codes; assumed to")] = 480
    warming_k: Annotated[
        float, Meta(ge=-20.0, le=20.0, description="of the board in the end; assumed, 0-10")
    ] = 5.0
    warming_s: Annotated[
        float, Meta(ge=10.0, le=10000.0, description="time constant of that; assumed")
    ] = 600.0
    fold_above_512: Annotated[
        bool,
        Meta(description="codes as the authors' driver read them: 512 + n comes out as 512 - n"),
    ] = False
    slip_direction_deg: Annotated[
        float,
        Meta(ge=-180.0, le=180.0, description="upwards in the pad's frame, from x; assumed: bodies "
             "reach further above the pads than fingers are long, so the hand comes from the side "
             "and the weight hangs across its fingers. Of a hand from above, tips down: 180"),
    ] = 90.0  # fmt: skip
    lever_x: Annotated[
        float, Meta(ge=-1.0, le=1.0, description="load lost for each newton of friction that drags "
                    "the pad along its x (the finger's length): height over reach of its "
                    "joint (a drum brake's shoe). Times friction below 1, or it jams; CLIP, 0.6-1")
    ] = 0.8  # fmt: skip
    lever_y: Annotated[
        float, Meta(ge=-1.0, le=1.0, description="likewise along y; CLIP, -0.5-0.5")
    ] = 0.0
    lateral_npmm: Annotated[
        float, Meta(ge=0.0, le=100.0, description="sideways stiffness of finger and arm that "
                    "press; 0 is rigid. In the hand it is the contact law's; CLIP, 3-10")
    ] = 6.5  # fmt: skip
    lateral_hz: Annotated[
        float, Meta(ge=4.0, le=40.0, description="frequency of what swings on it; CLIP, 8-18")
    ] = 13.0
    lateral_damping: Annotated[
        float, Meta(ge=0.01, le=2.0, description="of that; CLIP, 0.1-0.3")
    ] = 0.2
    shift_mm: Annotated[
        float, Meta(ge=0.0, le=0.1, description="rms of small motions sideways while it is held; "
                    "CLIP, 0.001-0.003")
    ] = 0.002  # fmt: skip
    rock_rad: Annotated[
        float, Meta(ge=0.0, le=0.02, description="rms of small rocking about both axes; CLIP, "
                    "0.0005-0.0015")
    ] = 0.001  # fmt: skip
    jitter_s: Annotated[
        float, Meta(ge=0.002, le=1.0, description="memory of shift and rocking; CLIP, 0.005-0.03")
    ] = 0.0175
    spring_mm: Annotated[
        float, Meta(ge=0.5, le=4.0, description="between springs of the bed: a texture is felt no "
                    "finer; numerical, 1 as in CLIP")
    ] = 1.0  # fmt: skip
    step_mm: Annotated[float, Meta(gt=0.0, le=1.0, description="longest path of an inner step")] = (
        0.05
    )
    step_s: Annotated[float, Meta(gt=0.0, le=0.01, description="no inner step need be shorter")] = (
        0.001
    )

    def __post_init__(self) -> None:
        if self.rest_low > self.rest_high:
            raise ValueError(f"rest_low {self.rest_low} is above rest_high {self.rest_high}")


def in_a_grasp(settings: FingertipSettings) -> FingertipSettings:
    """The same pads with an object in the hand. How the fingers give way sideways is the contact
    law's there."""
    share = settings.holding_share
    return msgspec.structs.replace(
        settings,
        wander_mm=share * settings.wander_mm,
        vibration_mm=share * settings.vibration_mm,
        sway_mm=share * settings.sway_mm,
        shift_mm=share * settings.shift_mm,
        rock_rad=share * settings.rock_rad,
        lateral_npmm=0.0,
    )
