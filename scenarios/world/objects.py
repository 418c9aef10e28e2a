"""The object of a trial: mass, shape at the grip, surface.

The paper names six objects and describes their surfaces in words only; every number is an
assumption with a range.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

# A name used as a path or part of one: no folder, no ``..``, not hidden, printable
Name = Annotated[
    str,
    Meta(
        pattern=r"\A(?!.*\.\.)[A-Za-z0-9][A-Za-z0-9._-]*\Z", max_length=80,
        description="at most 80 letters, digits, . _ -, a letter or digit first, no two dots",
    ),
]  # fmt: skip


def within(low: float, high: float, text: str = "") -> Meta:
    """Inclusive bounds of a setting, with its description."""
    return Meta(ge=low, le=high, description=text or None)


Counts = Annotated[int, within(0, 255)]  # of a finger's motor
Friction = Annotated[float, Meta(gt=0.0, le=2.0)]  # of rubber; assumed
Aside = Annotated[float, within(-0.2, 0.2)]
TextureRms = Annotated[float, within(0.0, 1e-3)]
TextureLength = Annotated[float, within(0.2e-3, 10e-3)]


class GraspObject(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One object of the experiments (paper, section V and figure 6). All figures are assumed."""

    name: Name
    description: str = ""
    long_body: bool = False  # scored by the 6 and 12 cm marks (paper, table IV)
    grip_counts: tuple[Counts, Counts, Counts]  # motor positions of the first, weak grasp
    mass_kg: Annotated[float, within(1e-4, 3.0)]  # of the object alone
    added_mass_kg: Annotated[float, within(0.0, 3.0)] = 0.0  # weights added for the lift (paper)
    friction_static: Friction  # 0.5-1.2
    friction_kinetic: Friction  # sliding; 0.6-0.95 of static
    wall_stiffness_npm: Annotated[float, within(200.0, 1e7)]  # of one side
    # force rise per metre of thumb travel, measured with this hand; none:
    # guard.contact_stiffness_npm
    contact_stiffness_npm: Annotated[float, within(100.0, 1e5)] | None = None
    shape: Literal["straight", "ellipsoid"] = "straight"
    half_width_m: Annotated[float, within(0.005, 0.07)]  # at the widest point, closing axis
    half_height_m: Annotated[float, within(0.005, 0.3)] = 0.1  # vertical, of an ellipsoid
    grip_height_m: Aside = 0.0  # grip above the widest point of an ellipsoid
    body_above_grip_m: Annotated[float, within(0.0, 0.5)] = 0.15  # straight, above the pads' centre
    # about the closing axis, 0.04-0.12; 0.09 for a 0.3 m tall object
    radius_of_gyration_m: Annotated[float, within(0.005, 0.3)] = 0.09
    centre_aside_m: Aside = 0.0  # centre of mass beside the grip's centre
    centre_above_m: Aside = 0.0  # centre of mass above the grip's centre
    texture_rms_m: TextureRms = 0.1e-3  # irregularity, 0.01-0.45 mm
    texture_length_m: TextureLength = 1.5e-3  # its correlation length, 1-2 mm

    def __post_init__(self) -> None:
        if self.friction_kinetic > self.friction_static:
            raise ValueError(
                f"friction_kinetic: {self.friction_kinetic:g} is more than friction_static, "
                f"{self.friction_static:g}; allowed: at most friction_static"
            )

    @property
    def total_kg(self) -> float:
        """Mass with the added weights."""
        return self.mass_kg + self.added_mass_kg

    @property
    def inertia_kgm2(self) -> float:
        """Moment of inertia about the closing axis through the centre of mass."""
        return self.total_kg * self.radius_of_gyration_m**2
