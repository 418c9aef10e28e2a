"""What one fingertip is pressed on, and what gives way between it and the arm."""

from typing import Annotated

import msgspec
from msgspec import Meta

from scenarios.world.objects import Name


class FixedSurface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is pressed on. A radius of 0 is straight along that axis of the fingertip."""

    name: Name
    description: str = ""
    radius_x_m: Annotated[float, Meta(ge=0.0, le=1.0, description="along the fingertip's x")] = 0.0
    radius_y_m: Annotated[float, Meta(ge=0.0, le=1.0, description="along its y")] = 0.0
    wall_stiffness_npm: Annotated[
        float, Meta(ge=1e3, le=1e7, description="printed ABS; assumed, next to rigid")
    ] = 1e6
    texture_rms_m: Annotated[
        float, Meta(ge=0.0, le=0.001, description="a sanded print; assumed, 0.05-0.3 mm")
    ] = 0.00015
    texture_length_m: Annotated[
        float, Meta(ge=0.0002, le=0.01, description="correlation length; assumed, 1-2 mm")
    ] = 0.0015
    friction_kinetic: Annotated[
        float, Meta(ge=0.0, le=3.0, description="urethane on ABS, sliding; assumed, 0.5-1.2")
    ] = 0.82
    friction_ratio: Annotated[
        float, Meta(ge=1.0, le=3.0, description="static over kinetic friction; assumed, 1.1-1.35")
    ] = 1.2


class PressSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Stiffness between arm and surface, and where the surface is."""

    finger_stiffness_npm: Annotated[
        float, Meta(ge=500.0, le=1e6, description="linkage of the finger; assumed, 3-10 N/mm")
    ] = 5000.0
    arm_stiffness_npm: Annotated[
        float, Meta(ge=1000.0, le=1e6, description="of the arm at the tool; assumed, 20-60 N/mm")
    ] = 40000.0
    gap_m: Annotated[
        float, Meta(ge=0.0, le=0.05, description="below the start, to the apex; assumed")
    ] = 0.006
    off_apex_x_m: Annotated[
        float, Meta(ge=-0.02, le=0.02, description="of the start from the apex, tool x; assumed")
    ] = 0.0
    off_apex_y_m: Annotated[
        float, Meta(ge=-0.02, le=0.02, description="likewise, tool y; assumed")
    ] = 0.0
    slope_x: Annotated[
        float, Meta(ge=-0.1, le=0.1, description="rise of the surface along tool x, m/m: it is not "
                    "quite level; assumed, -0.02-0.02")
    ] = 0.0  # fmt: skip
    slope_y: Annotated[float, Meta(ge=-0.1, le=0.1, description="likewise along tool y")] = 0.0
    axis_x_m: Annotated[
        float, Meta(ge=-0.03, le=0.03, description="of the contact from the axis that the tool "
                    "turns about, tool x; assumed, 0-0.01")
    ] = 0.0  # fmt: skip
    axis_y_m: Annotated[float, Meta(ge=-0.03, le=0.03, description="likewise, tool y")] = 0.0
