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
TextureRms = Annotated[float, within(0.0, 1e-3)]
TextureLength = Annotated[float, within(0.2e-3, 10e-3)]


class GraspObject(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One object of the experiments (paper, section V and figure 6). All figures are assumed."""

    name: Name
    description: str = ""
    long_body: Annotated[bool, Meta(description="scored by marks at 6 and 12 cm (paper, IV)")] = (
        False
    )
    grip_counts: Annotated[
        tuple[Counts, Counts, Counts],
        Meta(description="motor counts A, B, C of a first grasp at given counts"),
    ] = (0, 0, 0)
    mass_kg: Annotated[float, within(1e-4, 3.0, "of the object alone")]
    added_mass_kg: Annotated[float, within(0.0, 3.0, "weights added for the lift (paper)")] = 0.0
    friction_static: Annotated[float, Meta(gt=0.0, le=2.0, description="rubber on it; 0.5-1.2")]
    friction_kinetic: Annotated[
        float, Meta(gt=0.0, le=2.0, description="rubber sliding on it; 0.6-0.95 of static")
    ]
    wall_stiffness_npm: Annotated[float, within(200.0, 1e7, "of one side of the object")]
    # force rise per metre of thumb travel, measured with this hand; null:
    # guard.contact_stiffness_npm
    contact_stiffness_npm: Annotated[float, within(100.0, 1e5)] | None = None
    crush_n: Annotated[float, within(0.1, 1e3, "of a finger, that breaks it")] | None = None
    shape: Literal["straight", "ellipsoid"] = "straight"
    half_width_m: Annotated[float, within(0.005, 0.07, "along the closing axis, at the widest")]
    half_height_m: Annotated[float, within(0.005, 0.3, "vertical, of an ellipsoid")] = 0.1
    grip_height_m: Annotated[
        float, within(-0.2, 0.2, "grip above the widest point of an ellipsoid")
    ] = 0.0
    body_above_grip_m: Annotated[
        float, within(0.0, 0.5, "length of a straight object above the pads' centre")
    ] = 0.15
    # 0.04-0.12; 0.09 for a 0.3 m tall object
    radius_of_gyration_m: Annotated[float, within(0.005, 0.3, "about the closing axis")] = 0.09
    centre_aside_m: Annotated[float, within(-0.2, 0.2, "centre of mass beside the grip")] = 0.0
    centre_above_m: Annotated[float, within(-0.2, 0.2, "centre of mass above the grip")] = 0.0
    texture_rms_m: Annotated[float, within(0.0, 1e-3, "of the surface, 0.01-0.45 mm")] = 0.1e-3
    texture_length_m: Annotated[
        float, within(0.2e-3, 10e-3, "correlation length of the texture, 1-2 mm")
    ] = 1.5e-3

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

    def least_holding_n(self, acceleration_mps2: float) -> float:
        """Least force of the thumb that carries it, N, at gravity plus the arm's acceleration."""
        return self.total_kg * acceleration_mps2 / (2.0 * self.friction_kinetic)

    @property
    def inertia_kgm2(self) -> float:
        """Moment of inertia about the closing axis through the centre of mass."""
        return self.total_kg * self.radius_of_gyration_m**2
