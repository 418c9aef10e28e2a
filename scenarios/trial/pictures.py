"""What a recording holds for viewers that draw by themselves, ten times a second beside our own
messages: a log, where arm, fingers and object stand, their forces, and the taxels as grids.

Frames: ``world`` is the arm's base, z up; ``hand`` the middle between the pads, its x the closing
axis with the thumb at negative x, which is drawn along the world's x whatever the arm's own turn
is; ``finger_A`` and its like the faces of the pads, ``object`` where the object was grasped.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import in_words
from drivers.interfaces import FINGER_NAMES, Vector3
from grasp.fault import Fault
from grasp.foxglove import (
    ERROR,
    INFO,
    INT16,
    STRAIGHT,
    WARNING,
    Arrow,
    Color,
    Cube,
    FrameTransform,
    FrameTransforms,
    Grid,
    Log,
    PackedElementField,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    Size2,
    Sphere,
    Time,
    Vector,
)
from grasp.loop import Tick
from grasp.messages import Write
from grasp.states import PhaseChange, State
from scenarios.trial.config import TrialConfig
from scenarios.world.truth import Truth

LOG, TRANSFORMS, SCENE, FORCES, TAXELS = "/log", "/tf", "/scene", "/forces", "/taxels"
CHANNELS: dict[str, type[msgspec.Struct]] = {
    LOG: Log, TRANSFORMS: FrameTransforms, SCENE: SceneUpdate, FORCES: SceneUpdate, TAXELS: Grid,
}  # fmt: skip

EVERY = 10  # ticks
SIDES = ((-1.0, 0.0), (1.0, -0.03), (1.0, 0.03))  # of the thumb, B and C: of x, and y in metres
FORCE_M = 0.005  # of an arrow, a newton
PAD_M, PAD_WIDTH_M, CELL_M = 0.008, 0.02, 0.006  # as drawn
PALM_M, ARM_M, GRID_X_M = 0.105, 0.12, -0.15
LEAST_M, HEAD_M = 0.0005, 0.01  # of an arrow
TABLE_M = (0.6, 0.6, 0.01)
DOWN_M = 0.08  # of a straight object, drawn below the grip at most
COLOURS = (Color(0.12, 0.37, 0.6), Color(0.76, 0.34, 0.1), Color(0.23, 0.49, 0.27))
METAL, WOOD, GROUND = Color(0.55, 0.58, 0.62), Color(0.85, 0.79, 0.66), Color(0.35, 0.39, 0.43, 0.5)
UPWARDS = Quaternion(math.sqrt(0.5), y=-math.sqrt(0.5))  # x to z
INWARDS = Quaternion(0.0, z=1.0)  # of fingers B and C: x to -x
UPRIGHT = Quaternion(0.5, 0.5, 0.5, 0.5)  # x to y, y to z
PRESSED = [PackedElementField("pressed", 0, INT16)]
WRONG = {State.FAULT: ERROR, State.STOPPED: WARNING, State.LOST: WARNING}


def taxel_places(told: Sequence[tuple[float, float]], taxels: int) -> list[tuple[int, int]]:
    """Column and row of each taxel of a fingertip, from 0: where settings say, or in the two rows
    of the kit, 0 1 2 below and 5 4 3 above."""
    if len(told) != taxels:
        half = (taxels + 1) // 2
        told = [(i, 0.0) if i < half else (2 * half - 1 - i, 1.0) for i in range(taxels)]
    columns, rows = (sorted({place[axis] for place in told}) for axis in (0, 1))
    return [(columns.index(x), rows.index(y)) for x, y in told]


class Pictures:
    """Of one trial; ``write`` each tick into a recording."""

    def __init__(self, config: TrialConfig, unix_ns: int) -> None:
        """``unix_ns``: when the trial's clock stood at nought."""
        self._config = config
        self._unix_ns = unix_ns
        self._ticks = 0
        self._home: Vector3 | None = None
        self._arrows_before: tuple[Arrow, ...] | None = None
        self._failed: tuple[Fault, ...] = ()
        self._ended = False

    def end(self, write: Write, t_ns: int, error: BaseException) -> None:
        """A bug of ours: nothing more is drawn, and the log says why."""
        self._ended = True
        text = f"no more pictures: {in_words(error)}"
        write(LOG, t_ns, Log(self._time(t_ns), ERROR, text, "pictures"))

    def write(
        self, write: Write, tick: Tick, truth: Truth | None, changes: Sequence[PhaseChange]
    ) -> None:
        """Lines when something happens; the rest at every tenth tick, and at a change of phase."""
        if self._ended:
            return
        for log in self._lines(tick, changes):
            write(LOG, tick.t_ns, log)
        due = self._ticks % EVERY == 0 or changes
        self._ticks += 1
        if not due or not all(map(math.isfinite, tick.arm.position_m)):
            return
        if self._home is None:
            self._home = tick.arm.position_m
            write(SCENE, tick.t_ns, self._scene(tick, truth))
        now, taxels_mm = self._time(tick.t_ns), self._config.fingertip.taxels_mm
        write(TRANSFORMS, tick.t_ns, self._transforms(tick, truth))
        arrows = self._arrows(tick, truth)
        if arrows != self._arrows_before:
            self._arrows_before = arrows
            forces = SceneEntity(now, "hand", "forces", True, arrows)
            write(FORCES, tick.t_ns, SceneUpdate([forces]))
        if tick.frame is not None:
            write(TAXELS, tick.t_ns, grid(now, tick.frame.counts, taxels_mm))

    def _time(self, t_ns: int) -> Time:
        return Time.of(self._unix_ns + t_ns)

    def _lines(self, tick: Tick, changes: Sequence[PhaseChange]) -> list[Log]:
        now, lines = self._time(tick.t_ns), []
        for c in changes:
            level, text = WRONG.get(State(c.phase), INFO), f"{c.phase}: {c.cause}"
            lines.append(Log(self._time(c.t_ns), level, text, "phase"))
        if tick.decision.slip.event:
            lines.append(Log(now, INFO, "slip registered", "slip"))
        failed = (*tick.observation.faults, *tick.observation.reported)
        known = {fault.code for fault in self._failed}
        new = [fault for fault in failed if fault.code not in known]
        lines += [Log(now, WARNING, fault.line, "check") for fault in new]
        self._failed = failed
        return lines + [
            Log(self._time(each.sent_ns), WARNING, each.refused, "refused")
            for each in tick.issued
            if each.refused
        ]

    def _reach_m(self, tick: Tick, finger: int) -> float:
        """From the middle to the face of a pad."""
        calibration, contact = self._config.calibration, self._config.contact
        per_count = 0.0 if calibration is None else calibration.m_per_count
        return contact.half_aperture_m - tick.gripper.positions[finger] * per_count

    def _transforms(self, tick: Tick, truth: Truth | None) -> FrameTransforms:
        now = self._time(tick.t_ns)
        found = [FrameTransform(now, "world", "hand", point(*tick.arm.position_m))]
        for i, (side, y) in enumerate(SIDES):
            place = point(side * self._reach_m(tick, i), y)
            found.append(FrameTransform(now, "hand", f"finger_{FINGER_NAMES[i]}", place))
        if truth is not None and self._home is not None:
            x, y, z = self._home
            half = truth.turn_rad / 2.0  # about the closing axis
            turned = Quaternion(_rounded(math.cos(half)), _rounded(math.sin(half)))
            place = point(x, y + truth.across_m, z + truth.height_m)
            found.append(FrameTransform(now, "world", "object", place, turned))
        return FrameTransforms(found)

    def _scene(self, tick: Tick, truth: Truth | None) -> SceneUpdate:
        """What keeps its shape; frames move it."""
        now, contact = self._time(tick.t_ns), self._config.contact
        body, below_m = self._body(now)
        pad = Vector(PAD_M, PAD_WIDTH_M, 2.0 * contact.pad_half_length_m)
        palm = Cube(_at(z=PALM_M), Vector(0.11, 0.09, 0.03), METAL)
        arm = Cube(_at(z=PALM_M + ARM_M / 2.0), Vector(0.05, 0.05, ARM_M), METAL)
        entities = [SceneEntity(now, "hand", "hand", True, cubes=(palm, arm))]
        for name, colour, (side, _) in zip(FINGER_NAMES, COLOURS, SIDES, strict=True):
            cube = Cube(_at(x=side * PAD_M / 2.0), pad, colour)
            entities.append(SceneEntity(now, f"finger_{name}", f"pad_{name}", True, cubes=(cube,)))
        if truth is not None and self._home is not None:
            entities.append(body)
            x, y, z = self._home
            ground = Cube(_at(x, y, z - below_m - TABLE_M[2] / 2.0), Vector(*TABLE_M), GROUND)
            entities.append(SceneEntity(now, "world", "table", True, cubes=(ground,)))
        return SceneUpdate(entities)

    def _body(self, now: Time) -> tuple[SceneEntity, float]:
        """The object, and how far it reaches below the grip."""
        told = self._config.object
        wide, above_m = 2.0 * told.half_width_m, told.body_above_grip_m
        if told.shape == "ellipsoid":
            size = Vector(wide, wide, 2.0 * told.half_height_m)
            sphere = Sphere(_at(z=-told.grip_height_m), size, WOOD)
            below_m = told.half_height_m + told.grip_height_m
            return SceneEntity(now, "object", "object", True, spheres=(sphere,)), below_m
        below_m = min(DOWN_M, above_m)
        cube = Cube(_at(z=(above_m - below_m) / 2.0), Vector(wide, wide, above_m + below_m), WOOD)
        return SceneEntity(now, "object", "object", True, cubes=(cube,)), below_m

    def _arrows(self, tick: Tick, truth: Truth | None) -> tuple[Arrow, ...]:
        """Arrows onto the pads, true where that is known, else as felt; what a pad carries,
        upwards."""
        normal = tick.measured_n if truth is None else truth.normal_n
        shear = (0.0, 0.0, 0.0) if truth is None else truth.shear_n
        arrows: list[Arrow] = []
        for i, (side, y) in enumerate(SIDES):
            face_m, length_m = side * self._reach_m(tick, i), FORCE_M * normal[i]
            begin = point(face_m + side * (PAD_M + length_m), y)
            pressing = Pose(begin, STRAIGHT if side < 0.0 else INWARDS)
            arrows += _arrow(pressing, length_m, COLOURS[i])
            carrying = Pose(point(face_m, y), UPWARDS)
            arrows += _arrow(carrying, FORCE_M * abs(shear[i]), COLOURS[i])
        return tuple(arrows)


def grid(now: Time, counts: NDArray[np.int16], told: Sequence[tuple[float, float]]) -> Grid:
    """How hard each taxel is pressed, in counts (fingers, taxels): one fingertip beside the other,
    an empty column between them, upright before the hand. ``told``: `fingertip.taxels_mm`."""
    places = taxel_places(told, counts.shape[1])
    columns, rows = (1 + max(place[axis] for place in places) for axis in (0, 1))
    cells = np.zeros((rows, len(counts) * (columns + 1) - 1), "<i2")
    for finger, pressed in enumerate(counts):
        for (column, row), count in zip(places, pressed, strict=True):
            cells[row, finger * (columns + 1) + column] = -count
    corner = point(GRID_X_M, -CELL_M * cells.shape[1] / 2.0)
    return Grid(
        now, "hand", Pose(corner, UPRIGHT), cells.shape[1], Size2(CELL_M, CELL_M),
        2 * cells.shape[1], 2, PRESSED, cells.tobytes(),
    )  # fmt: skip


def _rounded(value: float) -> float:
    """To a tenth of a millimetre: a picture needs no more, and a recording stays small."""
    return round(value, 4)


def point(x: float, y: float = 0.0, z: float = 0.0) -> Vector:
    """In metres, rounded."""
    return Vector(_rounded(x), _rounded(y), _rounded(z))


def _at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose(Vector(x, y, z))


def _arrow(pose: Pose, length_m: float, colour: Color) -> list[Arrow]:
    """None of nothing."""
    if length_m < LEAST_M:
        return []
    head_m = min(HEAD_M, length_m)
    shaft_m = _rounded(length_m - head_m)
    return [Arrow(pose, shaft_m, 0.003, _rounded(head_m), 0.007, colour)]
