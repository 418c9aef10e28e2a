"""Messages for the viewers Foxglove and Lichtblick, ten times a second: a log, the poses of arm,
fingers and object, and the taxels as grids.

The messages follow https://docs.foxglove.dev/docs/sdk/schemas as JSON: a time is seconds and
nanoseconds since 1970, bytes are base64, lengths are metres, colours 0 to 1. Zeros and empty lists
are omitted, as the viewers allow.

Frames: ``world`` is the arm's base, z up. ``hand`` is the middle between the pads; its x is the
closing axis with the thumb at negative x, drawn along the world's x for any orientation of the
arm. ``finger_A`` to ``finger_C`` are the faces of the pads, ``object`` is the object's grasp point.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES, Vector3
from grasp.control.states import PhaseChange, State
from grasp.run.loop import Tick
from grasp.run.messages import Write
from scenarios.trial.config import TrialConfig
from scenarios.world.settings import HALF_APERTURE_M, PAD_HALF_LENGTH_M
from scenarios.world.truth import Truth

LOG, TRANSFORMS, SCENE, TAXELS = "/log", "/tf", "/scene", "/taxels"
INFO, WARNING, ERROR = 2, 3, 4  # Log.level
INT16 = 4  # PackedElementField.type

EVERY_TICKS = 10
PADS = ((-1.0, 0.0), (1.0, -0.03), (1.0, 0.03))  # of A, B, C: side along x, and y in metres
PAD_M, PAD_WIDTH_M, CELL_M, GRID_X_M = 0.008, 0.02, 0.006, -0.15  # as drawn
BELOW_M = 0.08  # the object is drawn at most this far below the grip
LEVELS = {State.FAULT: ERROR, State.STOPPED: WARNING, State.LOST: WARNING}


class Time(msgspec.Struct, frozen=True):
    """Time since 1970."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, unix_ns: int) -> "Time":
        return cls(*divmod(unix_ns, 1_000_000_000))


class Vector(msgspec.Struct, frozen=True, omit_defaults=True):
    """A point or a size."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True, omit_defaults=True):
    """A rotation."""

    w: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


STRAIGHT = Quaternion(1.0)
UPRIGHT = Quaternion(0.5, 0.5, 0.5, 0.5)  # x to y, y to z


class Pose(msgspec.Struct, frozen=True):
    """Position and orientation in a frame."""

    position: Vector
    orientation: Quaternion = STRAIGHT


class Color(msgspec.Struct, frozen=True):
    """A colour with opacity, 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


COLOURS = (Color(0.12, 0.37, 0.6), Color(0.76, 0.34, 0.1), Color(0.23, 0.49, 0.27))
WOOD = Color(0.85, 0.79, 0.66)


class Log(msgspec.Struct, frozen=True):
    """One log line with its severity level."""

    schema_name: ClassVar[str] = "foxglove.Log"
    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


class FrameTransform(msgspec.Struct, frozen=True):
    """Pose of a child frame in its parent."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector
    rotation: Quaternion = STRAIGHT


class FrameTransforms(msgspec.Struct, frozen=True):
    """Poses of several frames."""

    schema_name: ClassVar[str] = "foxglove.FrameTransforms"
    transforms: list[FrameTransform]


class Cube(msgspec.Struct, frozen=True):
    """A box around its pose."""

    pose: Pose
    size: Vector
    color: Color


class SceneEntity(msgspec.Struct, frozen=True):
    """Boxes that move with their frame."""

    timestamp: Time
    frame_id: str
    id: str
    frame_locked: bool
    cubes: list[Cube]


class SceneUpdate(msgspec.Struct, frozen=True):
    """New or changed entities of the scene."""

    schema_name: ClassVar[str] = "foxglove.SceneUpdate"
    entities: list[SceneEntity]


class PackedElementField(msgspec.Struct, frozen=True):
    """Name, offset and type of a value in the bytes of a grid cell."""

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
    cell_size: Vector
    row_stride: int  # bytes
    cell_stride: int
    fields: list[PackedElementField]
    data: bytes


CHANNELS: dict[str, type[msgspec.Struct]] = {
    LOG: Log, TRANSFORMS: FrameTransforms, SCENE: SceneUpdate, TAXELS: Grid,
}  # fmt: skip


def taxel_places(layout_mm: Sequence[tuple[float, float]], taxels: int) -> list[tuple[int, int]]:
    """Column and row of each taxel of a fingertip, from 0. Without a matching ``layout_mm``: the
    two rows of the kit, 0 1 2 below and 5 4 3 above."""
    if len(layout_mm) != taxels:
        half = (taxels + 1) // 2
        layout_mm = [(i, 0.0) if i < half else (2 * half - 1 - i, 1.0) for i in range(taxels)]
    columns, rows = (sorted({place[axis] for place in layout_mm}) for axis in (0, 1))
    return [(columns.index(x), rows.index(y)) for x, y in layout_mm]


class ViewerMessages:
    """Writes the viewers' messages of one trial; call ``write`` each control step."""

    def __init__(self, config: TrialConfig, unix_ns: int) -> None:
        """``unix_ns``: start of the trial's clock, ns since 1970."""
        self._config = config
        self._unix_ns = unix_ns
        self._ticks = 0
        self._home: Vector3 | None = None
        self._failed: set[str] = set()  # codes of the checks that failed at the last tick

    def write(
        self, write: Write, tick: Tick, truth: Truth | None, changes: Sequence[PhaseChange]
    ) -> None:
        """Write log lines of new events; all else every tenth step, and at a change of phase."""
        for log in self._lines(tick, changes):
            write(LOG, tick.t_ns, log)
        due = self._ticks % EVERY_TICKS == 0 or changes
        self._ticks += 1
        if not due or not all(map(math.isfinite, tick.arm.position_m)):
            return
        if self._home is None:
            self._home = tick.arm.position_m
            write(SCENE, tick.t_ns, self._scene(tick, truth))
        write(TRANSFORMS, tick.t_ns, self._transforms(tick, truth, self._home))
        if tick.frame is not None:
            now, taxels_mm = self._time(tick.t_ns), self._config.fingertip.taxels_mm
            write(TAXELS, tick.t_ns, grid(now, tick.frame.counts, taxels_mm))

    def _time(self, t_ns: int) -> Time:
        return Time.of(self._unix_ns + t_ns)

    def _lines(self, tick: Tick, changes: Sequence[PhaseChange]) -> list[Log]:
        """Log lines of new events; most steps have none."""
        lines = []
        for c in changes:
            level, text = LEVELS.get(State(c.phase), INFO), f"{c.phase}: {c.cause}"
            lines.append(Log(self._time(c.t_ns), level, text, "phase"))
        if tick.decision.slip.event:
            lines.append(Log(self._time(tick.t_ns), INFO, "slip registered", "slip"))
        failed = tick.observation.faults + tick.observation.reported
        if failed or self._failed:
            now = self._time(tick.t_ns)
            new = (fault for fault in failed if fault.code not in self._failed)
            lines += [Log(now, WARNING, fault.line, "check") for fault in new]
            self._failed = {fault.code for fault in failed}
        for each in tick.issued:
            if each.refused:
                lines.append(Log(self._time(each.sent_ns), WARNING, each.refused, "refused"))
        return lines

    def _transforms(self, tick: Tick, truth: Truth | None, home: Vector3) -> FrameTransforms:
        now = self._time(tick.t_ns)
        calibration = self._config.calibration
        per_count_m = 0.0 if calibration is None else calibration.m_per_count
        found = [FrameTransform(now, "world", "hand", point(*tick.arm.position_m))]
        for name, (side, y), counts in zip(FINGER_NAMES, PADS, tick.gripper.positions, strict=True):
            place = point(side * (HALF_APERTURE_M - counts * per_count_m), y)
            found.append(FrameTransform(now, "hand", f"finger_{name}", place))
        if truth is not None:
            x, y, z = home
            half = truth.turn_rad / 2.0  # about the closing axis
            turned = Quaternion(round(math.cos(half), 4), round(math.sin(half), 4))
            place = point(x, y + truth.across_m, z + truth.height_m)
            found.append(FrameTransform(now, "world", "object", place, turned))
        return FrameTransforms(found)

    def _scene(self, tick: Tick, truth: Truth | None) -> SceneUpdate:
        """Pads and object as boxes, which move with their frames."""
        now = self._time(tick.t_ns)
        pad = Vector(PAD_M, PAD_WIDTH_M, 2.0 * PAD_HALF_LENGTH_M)
        boxes = [
            (f"finger_{name}", Cube(Pose(point(x=side * PAD_M / 2.0)), pad, colour))
            for name, colour, (side, _) in zip(FINGER_NAMES, COLOURS, PADS, strict=True)
        ]
        if truth is not None:
            body = self._config.object
            wide_m, above_m = 2.0 * body.half_width_m, body.body_above_grip_m
            below_m = min(BELOW_M, above_m)
            size = Vector(wide_m, wide_m, above_m + below_m)
            middle = Pose(point(z=(above_m - below_m) / 2.0))
            boxes.append(("object", Cube(middle, size, WOOD)))
        return SceneUpdate([SceneEntity(now, name, name, True, [box]) for name, box in boxes])


def grid(now: Time, counts: NDArray[np.int16], layout_mm: Sequence[tuple[float, float]]) -> Grid:
    """Pressure of each taxel, from counts (fingers, taxels), as one upright grid before the hand.

    Fingertips are side by side with an empty column between. ``layout_mm``: `fingertip.taxels_mm`.
    """
    shape, cells_of_taxels = _grid_cells(tuple(layout_mm), *counts.shape)
    cells = np.zeros(shape, "<i2")
    cells.flat[cells_of_taxels] = -counts.ravel()
    corner = point(GRID_X_M, -CELL_M * cells.shape[1] / 2.0)
    return Grid(
        now, "hand", Pose(corner, UPRIGHT), cells.shape[1], Vector(CELL_M, CELL_M),
        2 * cells.shape[1], 2, [PackedElementField("pressed", 0, INT16)], cells.tobytes(),
    )  # fmt: skip


@cache
def _grid_cells(
    layout_mm: tuple[tuple[float, float], ...], fingers: int, taxels: int
) -> tuple[tuple[int, int], list[int]]:
    """Rows and columns of the grid, and the cell of each taxel, counted row by row."""
    places = taxel_places(layout_mm, taxels)
    columns, rows = (1 + max(place[axis] for place in places) for axis in (0, 1))
    width = fingers * (columns + 1) - 1
    cells = [
        row * width + finger * (columns + 1) + column
        for finger in range(fingers)
        for column, row in places
    ]
    return (rows, width), cells


def point(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Vector:
    """A point in metres, rounded to 0.1 mm to keep the recording small."""
    return Vector(round(x, 4), round(y, 4), round(z, 4))
