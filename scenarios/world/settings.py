"""What is assumed of hand, pads and fingertips, of what they touch and of what disturbs a scene."""

from enum import IntEnum
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from scenarios.world.objects import Name, TextureLength, TextureRms, within

GRAVITY_MPS2 = 9.81
HALF_APERTURE_M = 0.0775  # open hand, pad to centre plane; manual: 155 mm
PAD_HALF_LENGTH_M = 0.010  # flat pad, along the slip; assumed, 8-12 mm
WALL_STIFFNESS_NPM = 1e6  # of a fixed surface, printed ABS; assumed
GROSS_SLIP_MPS = 0.003  # paper, section III-B: the bound of the label `slip`
GROSS_TURN_RADPS = 0.2  # and of that label in rotation


Share = Annotated[float, within(0.0, 1.0)]
RelaxedShare = Annotated[float, within(0.0, 0.5)]
Stiffness = Annotated[float, within(500.0, 1e6)]
LongestStep = Annotated[float, within(1e-6, 0.05)]
Slope = Annotated[float, within(-0.4, 0.4)]
Memory = Annotated[float, within(0.002, 10.0)]  # s, time constant
Motion = Annotated[float, within(0.0, 0.5)]  # mm, rms
Hertz = Annotated[float, within(2.0, 45.0)]
Damping = Annotated[float, within(0.005, 2.0)]  # of critical
Lever = Annotated[float, within(-1.0, 1.0)]
Radius = Annotated[float, within(0.0, 1.0)]
Offset = Annotated[float, within(-0.03, 0.03)]
Impulse = Annotated[float, within(0.0, 15.0)]

# Contact levels

LevelName = Literal["L1", "L3", "L4"]
Step = Annotated[float, Meta(gt=0.0)]


class Level(IntEnum):
    """From the cheapest to the reference. POINTS is that of a study: it costs what SPIN does."""

    SLIDER = 1
    POINTS = 2
    SPIN = 3
    BRUSH = 4

    @property
    def label(self) -> str:
        """As a setting names it."""
        return f"L{int(self)}"


def level_named(label: LevelName) -> Level:
    """The level that a setting names."""
    return Level(int(label[1:]))


class ContactLevels(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Level and longest step, and those while a tap moves the object."""

    level: LevelName
    step_s: Step
    impact_level: LevelName
    impact_step_s: Step

    def __post_init__(self) -> None:
        _check_levels(self.level, self.impact_level)


class ContactTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`config/contact_levels.toml`: levels of a lift, of a tap by its direction, and
    the least of any run whose object has its weight aside or is pulled."""

    lift: ContactLevels
    top: ContactLevels
    side: ContactLevels
    closing: ContactLevels
    aside: ContactLevels
    pull: ContactLevels


class WorldSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contact levels in place of those that `config/contact_levels.toml` has for a run."""

    # auto: by scenario; L1 where no scenario is known
    level: Literal["auto", "L1", "L3", "L4"] = "auto"
    # while a tap moves the object, never less than level; auto: as level, and where that is auto,
    # by scenario; L4 where none is known
    impact_level: Literal["auto", "L1", "L3", "L4"] = "auto"

    def __post_init__(self) -> None:
        if "auto" not in (self.level, self.impact_level):
            _check_levels(self.level, self.impact_level)


def _check_levels(level: str, impact_level: str) -> None:
    if impact_level < level:
        raise ValueError(f"impact_level: {impact_level} is less than level, {level}")


# Hand and pads


class ContactSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Compliances of the pads; those that nobody varies are constants of ``contact``."""

    shear_stiffness_npm: Stiffness = 8000.0  # tangential; derived, 6-12 N/mm
    # tangential; assumed, 5-16 N s/m
    shear_damping_nspm: Annotated[float, within(0.0, 200.0)] = 12.0
    # damping over stiffness along the closing axis, of what an impact along it has struck; as in
    # shear; assumed, 0.5-3 ms
    normal_loss_s: Annotated[float, within(0.0, 0.01)] = 1.5e-3
    relaxation_fraction: RelaxedShare = 0.1  # of the normal force; clip 0.05-0.15
    step_s: LongestStep = 5e-4  # of the integration
    impact_step_s: LongestStep = 1e-4  # and while an impact moves the object


class Surface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What one pad touches."""

    curvature_per_mm: tuple[float, float] = (0.0, 0.0)  # along x and y of the pad; 0 is flat
    texture_rms_mm: float = 0.1  # irregularity; felt 0.3-0.45, smooth 0.01-0.2
    texture_length_mm: float = 1.5  # its correlation length; 1-2 mm
    friction_static: float = 0.85  # of rubber on it
    friction_kinetic: float = 0.7


class FingertipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geometry, rubber and noise of one fingertip, in the press and in the hand alike; those that
    nobody varies are constants of ``fingertip``.

    CLIP: the middle of the range that the part `compliant` of the paper's set draws from
    (`config/datasets/paper.toml`; that range is named). The ranges were chosen by hand so that the
    set's statistics hold the authors' clip; no lift, tap or detector had a say.
    """

    # place of each barometer on the pad, x and y; none: two rows of three, as in the kit. As many
    # as `tactile.cells` has a finger
    taxels_mm: tuple[tuple[float, float], ...] = ()
    depth_mm: Annotated[float, within(2.0, 10.0)] = 3.15  # effective, of the rubber; CLIP, 2.8-3.5
    crown_radius_mm: Annotated[float, within(10.0, 1000.0)] = 34.0  # of the face; CLIP, 18-50
    tilt_rad: Annotated[float, within(0.0, 0.2)] = 0.035  # deviation, both axes; CLIP, 0.02-0.05
    tilt_x_rad: Slope = 0.0  # mean, rising along x, as the authors' finger leaned
    tilt_y_rad: Slope = 0.0
    foundation_n_per_mm3: Annotated[float, within(0.02, 2.0)] = 0.575  # bed, normal; CLIP, 0.35-0.8
    relaxation_share: RelaxedShare = 0.075  # of a spring's load; CLIP, 0.04-0.11
    relaxation_s: Memory = 0.1  # time constant of that; CLIP, 0.1
    # relaxes ten times slower, and as much again 100 times: rubber relaxes in log time; CLIP,
    # 0.04-0.11
    relaxation_slow_share: RelaxedShare = 0.075
    # rms of how much deeper or shallower the pad is held than asked for; CLIP, 0.009-0.022
    wander_mm: Motion = 0.0155
    wander_fast_s: Memory = 0.01  # of its fast half; CLIP, 0.005-0.015
    wander_slow_s: Memory = 1.0  # and of its slow half; CLIP, 0.5-1.5
    vibration_mm: Motion = 0.006  # by the mode of an arm that moves; CLIP, 0.002-0.01
    vibration_hz: Hertz = 17.5  # of that mode; CLIP, 10-25
    vibration_damping: Damping = 0.095  # of that mode; CLIP, 0.04-0.15
    sway_mm: Motion = 0.01  # rms of that mode sideways; assumed, 0-0.05
    # how restless arm and hand are with an object in them, over how restless while they press; what
    # of it reaches the pads follows from the object's inertia. Nobody has measured it: the middle
    # of 0.1-1, over which results should be swept
    holding_share: Annotated[float, within(0.0, 2.0)] = 0.55
    noise_counts: Annotated[float, within(0.0, 5.0)] = 0.65  # rms before rounding; CLIP, 0.4-0.9
    warming_k: Annotated[float, within(-20.0, 20.0)] = 5.0  # of the board in the end; assumed, 0-10
    warming_s: Annotated[float, within(10.0, 10000.0)] = 600.0  # time constant of that; assumed
    # codes as the authors' driver read them: 512 + n comes out as 512 - n
    fold_above_512: bool = False
    # upwards in the pad's frame, from x. Assumed: bodies reach further above the pads than fingers
    # are long, so the hand comes from the side and the weight hangs across its fingers. Of a hand
    # from above, tips down: 180
    slip_direction_deg: Annotated[float, within(-180.0, 180.0)] = 90.0
    # load lost for each newton of friction that drags the pad along its x (the finger's length):
    # height over reach of its joint (a drum brake's shoe). Times friction below 1, or it jams
    lever_x: Lever = 0.8  # CLIP, 0.6-1
    lever_y: Lever = 0.0  # likewise along y; CLIP, -0.5-0.5
    # sideways, of what presses; 0: rigid; CLIP, 3-10
    lateral_npmm: Annotated[float, within(0.0, 100.0)] = 6.5
    lateral_hz: Hertz = 13.0  # of what swings on it; CLIP, 8-18
    lateral_damping: Damping = 0.2  # of that; CLIP, 0.1-0.3
    shift_mm: Motion = 0.002  # rms of small motions sideways; CLIP, 0.001-0.003
    rock_rad: Annotated[float, within(0.0, 0.02)] = 0.001  # rms; CLIP, 0.0005-0.0015
    jitter_s: Memory = 0.0175  # of both; CLIP, 0.005-0.03
    spring_mm: Annotated[float, within(0.5, 4.0)] = 1.0  # apart; no finer texture is felt


def in_a_grasp(settings: FingertipSettings) -> FingertipSettings:
    """The same pads with an object in the hand. How the fingers give way sideways is the contact
    law's there."""
    restless = ("wander_mm", "vibration_mm", "sway_mm", "shift_mm", "rock_rad")
    calmer = {name: settings.holding_share * getattr(settings, name) for name in restless}
    return msgspec.structs.replace(settings, **calmer, lateral_npmm=0.0)


# One fingertip pressed on what is fixed


class FixedSurface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is pressed on. A radius of 0 is straight along that axis of the fingertip."""

    name: Name
    description: str = ""
    radius_x_m: Radius = 0.0  # along the fingertip's x
    radius_y_m: Radius = 0.0
    texture_rms_m: TextureRms = 0.00015  # sanded print; assumed, 0.05-0.3 mm
    texture_length_m: TextureLength = 0.0015  # assumed, 1-2 mm
    friction_kinetic: Annotated[float, within(0.0, 3.0)] = 0.82  # of urethane; assumed, 0.5-1.2
    friction_ratio: Annotated[float, within(1.0, 3.0)] = 1.2  # static over it; assumed, 1.1-1.35


class PressSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Stiffness between arm and surface, and where the surface is. All assumed."""

    finger_stiffness_npm: Stiffness = 5000.0  # linkage, 3-10 N/mm
    arm_stiffness_npm: Stiffness = 40000.0  # at the tool, 20-60 N/mm
    off_apex_x_m: Offset = 0.0  # of the start, tool x
    off_apex_y_m: Offset = 0.0
    slope_x: Slope = 0.0  # of the surface along tool x, -0.02-0.02
    slope_y: Slope = 0.0
    axis_x_m: Offset = 0.0  # contact from the axis of turns, tool x, 0-0.01
    axis_y_m: Offset = 0.0


# What a scene may add


class Impact(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One tap of a mallet: a half-sine pulse, then a longer one while the hand follows through. The
    same in a stated scene, in a cell and over a cell's control channel.

    ``top`` strikes downwards, ``side`` across the closing axis, ``closing`` along it, onto the
    thumb. Struck ``delay_s`` from now. ``offset_m``: from the grip's centre, beside it
    for an impact on the top, above it for one on the side.
    """

    impulse_n_s: Impulse  # assumed, 0.08-0.45 N s
    duration_s: Annotated[float, Meta(gt=0.0, le=0.2)]  # assumed, 2-16 ms
    direction: Literal["top", "side", "closing"] = "top"
    offset_m: Annotated[float, within(-0.5, 0.5)] = 0.0
    follow_n_s: Impulse = 0.0
    follow_s: Annotated[float, within(0.0, 1.0)] = 0.0
    delay_s: Annotated[float, within(0.0, 10.0)] = 0.0

    def __post_init__(self) -> None:
        if self.follow_n_s > 0.0 and self.follow_s == 0.0:
            raise ValueError("follow_n_s: a hand follows through for some time: follow_s > 0")


class PullSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A downward force on the object once the arm stands still with it in the air."""

    force_n: Annotated[float, within(0.0, 200.0)] = 0.0  # beside the weight; 0: none
    # height of the object then at least; more than an arm that pauses to answer slip has risen,
    # where the top is meant
    above_m: Annotated[float, within(0.0, 1.0)] = 0.005


class DamageSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is wrong with every fingertip from the beginning of a trial."""

    taxels_lost: Share = 0.0  # of each fingertip, drawn: their first value stays
    gain_lost: Share = 0.0  # of every change from rest; the noise stays
