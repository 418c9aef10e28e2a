"""The object of a trial: what it weighs, how it is shaped where it is held, how it feels.

The paper names six objects and describes their surfaces in words only; every number is an
assumption with a range.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

# A name that becomes a path or part of one: no folder, no ``..``, nothing hidden or unprintable
Name = Annotated[
    str,
    Meta(
        pattern=r"\A(?!.*\.\.)[A-Za-z0-9][A-Za-z0-9._-]*\Z", max_length=80,
        description="at most 80 letters, digits, . _ -, a letter or digit first, no two dots",
    ),
]  # fmt: skip
Counts = Annotated[int, Meta(ge=0, le=255)]  # of a finger's motor


class GraspObject(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One object of the experiments (paper, section V and figure 6). All figures are assumed."""

    name: Name
    description: str = ""
    long_body: bool = False  # judged by the 6 and 12 cm marks (paper, table IV)
    grip_counts: Annotated[
        tuple[Counts, Counts, Counts],
        Meta(description="motor counts A, B, C of the first, too weak grasp; 0-255, assumed"),
    ]
    mass_kg: Annotated[float, Meta(ge=1e-4, le=3.0, description="of the object alone; assumed")]
    added_mass_kg: Annotated[
        float, Meta(ge=0.0, le=3.0, description="weights added for the lift (paper); assumed")
    ] = 0.0
    friction_static: Annotated[
        float, Meta(gt=0.0, le=2.0, description="rubber on this surface; assumed, 0.5-1.2")
    ]
    friction_kinetic: Annotated[
        float, Meta(gt=0.0, le=2.0, description="sliding; assumed, 0.6-0.95 of static")
    ]
    wall_stiffness_npm: Annotated[
        float, Meta(ge=200.0, le=1e7, description="of one side, N/m; assumed")
    ]
    contact_stiffness_npm: (
        Annotated[
            float,
            Meta(
                ge=100.0, le=1e5,
                description="force rise a metre of thumb travel, to be measured with this hand; "
                "without one, guard.contact_stiffness_npm",
            ),
        ]
        | None
    ) = None  # fmt: skip
    shape: Literal["straight", "ellipsoid"] = "straight"
    half_width_m: Annotated[
        float,
        Meta(gt=0.005, le=0.07, description="half of the widest width, closing axis; assumed"),
    ]
    half_height_m: Annotated[
        float, Meta(gt=0.005, le=0.3, description="vertical semi-axis of an ellipsoid; assumed")
    ] = 0.1
    grip_height_m: Annotated[
        float,
        Meta(ge=-0.1, le=0.1, description="grip above the widest point of an ellipsoid; assumed"),
    ] = 0.0
    body_above_grip_m: Annotated[
        float, Meta(gt=0.0, le=0.5, description="straight body above the pads' centre; assumed")
    ] = 0.15
    radius_of_gyration_m: Annotated[
        float,
        Meta(gt=0.005, le=0.3, description="about the closing axis; assumed, 0.04-0.12: 0.09 is "
             "an object 0.3 m tall"),
    ] = 0.09  # fmt: skip
    centre_aside_m: Annotated[
        float, Meta(ge=-0.1, le=0.1, description="centre of mass beside the grip's middle; assumed")
    ] = 0.0
    centre_above_m: Annotated[float, Meta(ge=-0.2, le=0.2, description="and above it; assumed")] = (
        0.0
    )
    texture_rms_m: Annotated[
        float,
        Meta(ge=0.0, le=1e-3, description="surface irregularity; assumed, 0.01-0.45 mm"),
    ] = 0.1e-3
    texture_length_m: Annotated[
        float, Meta(ge=0.2e-3, le=10e-3, description="its correlation length; assumed, 1-2 mm")
    ] = 1.5e-3

    def __post_init__(self) -> None:
        if self.friction_kinetic > self.friction_static:
            raise ValueError(
                f"friction_kinetic: {self.friction_kinetic:g} is more than friction_static, "
                f"{self.friction_static:g}: nothing slides harder than it begins to"
            )

    @property
    def total_kg(self) -> float:
        """With the weights that were added."""
        return self.mass_kg + self.added_mass_kg

    @property
    def inertia_kgm2(self) -> float:
        """About the closing axis, through the centre of mass."""
        return self.total_kg * self.radius_of_gyration_m**2
