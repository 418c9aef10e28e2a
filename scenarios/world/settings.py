"""Settings of the simulated world: hand, pads, fingertips, surfaces and disturbances."""

from enum import IntEnum
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from scenarios.world.objects import Name, TextureLength, TextureRms, within

GRAVITY_MPS2 = 9.81
HALF_APERTURE_M = 0.0775  # open hand, pad to centre plane; manual: 155 mm
PAD_HALF_LENGTH_M = 0.010  # flat pad, along the slip; assumed, 8-12 mm
WALL_STIFFNESS_NPM = 1e6  # of a fixed surface, printed ABS; assumed
GROSS_SLIP_MPS = 0.003  # lower bound of the label `slip` (paper, section III-B)
GROSS_TURN_RADPS = 0.2  # lower bound of that label in rotation


RelaxedShare = Annotated[float, within(0.0, 0.5)]
Stiffness = Annotated[float, within(500.0, 1e6)]
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
    """Contact models from the fastest to the reference."""

    SLIDER = 1
    SPIN = 3
    BRUSH = 4

    @property
    def label(self) -> str:
        """Its name in settings."""
        return f"L{int(self)}"


def level_named(label: LevelName) -> Level:
    """The level that a setting names."""
    return Level(int(label[1:]))


class ContactLevels(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contact level and longest step of a run, and during a tap."""

    level: LevelName
    step_s: Step
    impact_level: LevelName
    impact_step_s: Step

    def __post_init__(self) -> None:
        _check_levels(self.level, self.impact_level)


class ContactTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`config/contact_levels.toml`: levels of a lift and of a tap by direction; ``aside`` and
    ``pull`` are lower bounds for objects with an offset mass or a pull."""

    lift: ContactLevels
    top: ContactLevels
    side: ContactLevels
    closing: ContactLevels
    aside: ContactLevels
    pull: ContactLevels


class WorldSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contact levels in place of those that `config/contact_levels.toml` has for a run."""

    level: Annotated[
        Literal["auto", "L1", "L3", "L4"],
        Meta(description="contact model; auto: by scenario, L1 without one"),
    ] = "auto"
    # auto: as level; where level is auto too, by scenario, and L4 without a scenario
    impact_level: Annotated[
        Literal["auto", "L1", "L3", "L4"],
        Meta(description="contact model during a tap, at least `level`"),
    ] = "auto"

    def __post_init__(self) -> None:
        if "auto" not in (self.level, self.impact_level):
            _check_levels(self.level, self.impact_level)


def _check_levels(level: str, impact_level: str) -> None:
    if impact_level < level:
        raise ValueError(f"impact_level: {impact_level} is below level, {level}")


# Hand and pads


class ContactSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Compliance of the pads; fixed values are constants of ``contact``."""

    shear_stiffness_npm: Annotated[float, within(500.0, 1e6, "of a pad, tangential")] = 8000.0
    shear_damping_nspm: Annotated[float, within(0.0, 200.0, "of a pad, tangential; assumed")] = 12.0
    # as in shear; assumed, 0.5-3 ms
    normal_loss_s: Annotated[
        float,
        within(0.0, 0.01, "pad's damping over stiffness, in an impact along the closing axis"),
    ] = 1.5e-3
    # real recording: 0.05-0.15
    relaxation_fraction: Annotated[
        float, within(0.0, 0.5, "part of the normal force that relaxes")
    ] = 0.1
    # holds an object where it stands until the fingers push harder; assumed, 0.3-0.6
    table_friction: Annotated[
        float, within(0.0, 1.0, "of the object on the table, along the closing axis")
    ] = 0.0
    step_s: Annotated[float, within(1e-6, 0.05, "longest step of the simulation")] = 5e-4
    impact_step_s: Annotated[float, within(1e-6, 0.05, "longest step during an impact")] = 1e-4


class Surface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Surface at one pad: curvature, texture and friction."""

    curvature_per_mm: tuple[float, float] = (0.0, 0.0)  # along x and y of the pad; 0 is flat
    texture_rms_mm: float = 0.1  # irregularity; felt cloth 0.3-0.45, smooth 0.01-0.2
    texture_length_mm: float = 1.5  # its correlation length; 1-2 mm
    friction_static: float = 0.85  # of rubber on it
    friction_kinetic: float = 0.7


class FingertipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geometry, rubber and noise of one fingertip, pressed or in the hand; fixed values are
    constants of ``fingertip``.

    FIT: the middle of the stated range, from which the part `compliant` of the paper's data set is
    sampled (`config/datasets/paper.toml`). These ranges were chosen by hand so that the statistics
    of the data set include those of the authors' recording.
    """

    # position (x, y) of each barometer on the pad; none: the kit's two rows of three. Their number
    # must be that of `tactile.cells` per finger
    taxels_mm: tuple[tuple[float, float], ...] = ()
    depth_mm: Annotated[float, within(2.0, 10.0)] = 3.15  # effective, of the rubber; FIT, 2.8-3.5
    crown_radius_mm: Annotated[float, within(10.0, 1000.0)] = 34.0  # of the face; FIT, 18-50
    tilt_rad: Annotated[float, within(0.0, 0.2)] = 0.035  # deviation, both axes; FIT, 0.02-0.05
    tilt_x_rad: Slope = 0.0  # mean, rising along x
    tilt_y_rad: Slope = 0.0
    foundation_n_per_mm3: Annotated[float, within(0.02, 2.0)] = 0.575  # bed, normal; FIT, 0.35-0.8
    relaxation_share: RelaxedShare = 0.075  # of a spring's load; FIT, 0.04-0.11
    relaxation_s: Memory = 0.1  # time constant of that; FIT, 0.1
    # share of each of two slower terms (10 and 100 times the time constant), since rubber relaxes
    # in log time; FIT, 0.04-0.11
    relaxation_slow_share: RelaxedShare = 0.075
    # rms deviation of the pad's depth from the commanded one; FIT, 0.009-0.022
    wander_mm: Motion = 0.0155
    wander_fast_s: Memory = 0.01  # of its fast half; FIT, 0.005-0.015
    wander_slow_s: Memory = 1.0  # of its slow half; FIT, 0.5-1.5
    vibration_mm: Motion = 0.006  # by the structural mode of a moving arm; FIT, 0.002-0.01
    vibration_hz: Hertz = 17.5  # of that mode; FIT, 10-25
    vibration_damping: Damping = 0.095  # of that mode; FIT, 0.04-0.15
    sway_mm: Motion = 0.01  # rms of that mode sideways; assumed, 0-0.05
    # motion of arm and hand with a held object, relative to that while pressing; the inertia of the
    # object determines how much reaches the pads. Not measured: the middle of 0.1-1; sweep it
    holding_share: Annotated[float, within(0.0, 2.0)] = 0.55
    noise_counts: Annotated[float, within(0.0, 5.0)] = 0.65  # rms before rounding; FIT, 0.4-0.9
    warming_k: Annotated[float, within(-20.0, 20.0)] = 5.0  # final rise of the board; assumed, 0-10
    warming_s: Annotated[float, within(10.0, 10000.0)] = 600.0  # its time constant; assumed
    # as the authors' driver reads codes: 512 + n becomes 512 - n
    fold_above_512: bool = False
    # angle of upwards from x in the pad's frame. Assumed: objects are taller than the fingers are
    # long, so the hand grasps from the side. A hand that grasps from above, tips down: 180
    slip_direction_deg: Annotated[float, within(-180.0, 180.0)] = 90.0
    # load lost per newton of friction along the pad's x (the finger's length): height over reach of
    # its joint, as of a drum brake's shoe. lever_x times friction must be below 1, or it jams
    lever_x: Lever = 0.8  # FIT, 0.6-1
    lever_y: Lever = 0.0  # likewise along y; FIT, -0.5-0.5
    # lateral stiffness of the mount; 0: rigid; FIT, 3-10
    lateral_npmm: Annotated[float, within(0.0, 100.0)] = 6.5
    lateral_hz: Hertz = 13.0  # its natural frequency; FIT, 8-18
    lateral_damping: Damping = 0.2  # its damping; FIT, 0.1-0.3
    shift_mm: Motion = 0.002  # rms of lateral jitter; FIT, 0.001-0.003
    rock_rad: Annotated[float, within(0.0, 0.02)] = 0.001  # rms of tilt jitter; FIT, 0.0005-0.0015
    jitter_s: Memory = 0.0175  # of both; FIT, 0.005-0.03
    spring_mm: Annotated[float, within(0.5, 4.0)] = 1.0  # spacing; resolves no finer texture


def settings_in_grasp(settings: FingertipSettings) -> FingertipSettings:
    """Settings of the same pads while they hold an object. The contact law then models the lateral
    compliance."""
    motions = ("wander_mm", "vibration_mm", "sway_mm", "shift_mm", "rock_rad")
    reduced = {name: settings.holding_share * getattr(settings, name) for name in motions}
    return msgspec.structs.replace(settings, **reduced, lateral_npmm=0.0)


# One fingertip pressed on a fixed surface


class FixedSurface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Fixed surface under a pressed fingertip. A radius of 0 means straight along that axis."""

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
    off_apex_x_m: Offset = 0.0  # start position from the apex, tool x
    off_apex_y_m: Offset = 0.0
    slope_x: Slope = 0.0  # of the surface along tool x, -0.02-0.02
    slope_y: Slope = 0.0
    axis_x_m: Offset = 0.0  # contact from the rotation axis, tool x, 0-0.01
    axis_y_m: Offset = 0.0


# Disturbances of a scene


class Impact(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One tap of a mallet: a half-sine pulse, then a longer one while the hand follows through.

    ``top`` strikes downwards, ``side`` across the closing axis, ``closing`` along it, onto the
    thumb; ``delay_s`` from now. ``offset_m`` is the distance from the grip's centre: beside it for
    ``top``, above it for ``side``.
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
            raise ValueError(
                f"follow_n_s: {self.follow_n_s:g} N s within follow_s = 0 s; set follow_s above 0"
            )


class PullSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A downward force on the object once the arm is at rest with it in the air."""

    force_n: Annotated[float, within(0.0, 200.0, "N, pull added to the weight; 0: none")] = 0.0
    # for a pull at the top only: more than the height at which the arm pauses to respond to slip
    above_m: Annotated[float, within(0.0, 1.0, "m, least height of the object for the pull")] = (
        0.005
    )


class DamageSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Damage of every fingertip from the beginning of a trial."""

    taxels_lost: Annotated[
        float, within(0.0, 1.0, "share of each fingertip's taxels that keep their first value")
    ] = 0.0
    gain_lost: Annotated[
        float, within(0.0, 1.0, "share of every change from rest that is lost; not of the noise")
    ] = 0.0
