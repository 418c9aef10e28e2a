"""Messages that Foxglove and Lichtblick draw by themselves, by their published schemas.

https://docs.foxglove.dev/docs/sdk/schemas, as JSON: a time is seconds and nanoseconds since 1970,
bytes are base64. Lengths in metres, colours from 0 to 1. Empty lists and zeros are left out, as the
viewers allow.
"""

from typing import ClassVar

import msgspec

INFO, WARNING, ERROR = 2, 3, 4  # of Log.level
INT16 = 4  # of PackedElementField.type
BILLION = 1_000_000_000


class Time(msgspec.Struct, frozen=True):
    """Since 1970."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, unix_ns: int) -> "Time":
        """Of nanoseconds since 1970."""
        return cls(*divmod(unix_ns, BILLION))


class Vector(msgspec.Struct, frozen=True, omit_defaults=True):
    """Or a size, or a point."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Size2(msgspec.Struct, frozen=True):
    """Of a cell."""

    x: float
    y: float


class Quaternion(msgspec.Struct, frozen=True, omit_defaults=True):
    """A turn."""

    w: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


STRAIGHT = Quaternion(1.0)


class Pose(msgspec.Struct, frozen=True):
    """Where something stands in its frame."""

    position: Vector
    orientation: Quaternion = STRAIGHT


class Color(msgspec.Struct, frozen=True):
    """With its opacity."""

    r: float
    g: float
    b: float
    a: float = 1.0


class Log(msgspec.Struct, frozen=True):
    """One line, on a level."""

    schema_name: ClassVar[str] = "foxglove.Log"
    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


class FrameTransform(msgspec.Struct, frozen=True):
    """Where one frame stands in another."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector
    rotation: Quaternion = STRAIGHT


class FrameTransforms(msgspec.Struct, frozen=True):
    """Where frames stand in others."""

    schema_name: ClassVar[str] = "foxglove.FrameTransforms"
    transforms: list[FrameTransform]


class Cube(msgspec.Struct, frozen=True):
    """A box around its pose."""

    pose: Pose
    size: Vector
    color: Color


class Sphere(msgspec.Struct, frozen=True):
    """Or an ellipsoid."""

    pose: Pose
    size: Vector
    color: Color


class Arrow(msgspec.Struct, frozen=True):
    """Along the x of its pose."""

    pose: Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


class SceneEntity(msgspec.Struct, frozen=True, omit_defaults=True):
    """Bodies in one frame, with which they move if they are locked to it; for good, or until one of
    the same name takes their place."""

    timestamp: Time
    frame_id: str
    id: str
    frame_locked: bool
    arrows: tuple[Arrow, ...] = ()
    cubes: tuple[Cube, ...] = ()
    spheres: tuple[Sphere, ...] = ()


class SceneUpdate(msgspec.Struct, frozen=True):
    """What stands in a scene from now on."""

    schema_name: ClassVar[str] = "foxglove.SceneUpdate"
    entities: list[SceneEntity]


class PackedElementField(msgspec.Struct, frozen=True):
    """What is where in the bytes of a cell."""

    name: str
    offset: int
    type: int


class Grid(msgspec.Struct, frozen=True):
    """Cells in the x-y plane of its pose, row by row from its origin."""

    schema_name: ClassVar[str] = "foxglove.Grid"
    timestamp: Time
    frame_id: str
    pose: Pose
    column_count: int
    cell_size: Size2
    row_stride: int  # bytes
    cell_stride: int
    fields: list[PackedElementField]
    data: bytes
