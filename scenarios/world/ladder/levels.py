"""One interface to the five levels: a scene and a step go in, the same outcome comes out."""

from enum import IntEnum

import msgspec
import numpy as np

from scenarios.world import contact
from scenarios.world.contact import FINGERS, Floats
from scenarios.world.ladder import compliant, rigid
from scenarios.world.ladder.drive import Drive, drive
from scenarios.world.ladder.scene import Scene

BRUSH_POINTS = 6  # a side of a pad
# Mean distance from the middle of a square of half side 1: torque at which a uniform patch spins.
SQUARE_SPIN = (np.sqrt(2.0) + np.log(1.0 + np.sqrt(2.0))) / 3.0


class Level(IntEnum):
    """The rungs, from the cheapest to the reference."""

    RIGID = 0
    SLIDER = 1
    POINTS = 2
    SPIN = 3
    BRUSH = 4


class SceneOutcome(msgspec.Struct, frozen=True):
    """Object at the end of a scene, relative to the hand. Levels below L2 leave y and turn at 0."""

    level: Level
    step_s: float
    y_m: float
    z_m: float  # negative: the object lags behind a rising hand
    turn_rad: float
    speed: tuple[float, float, float]  # y and z, m/s; turn, rad/s
    normal_n: tuple[float, float, float]
    peak_force_n: float  # largest normal force of any finger at any time
    mark_m: tuple[float, float]  # displacement of the tape mark, y and z

    @property
    def slip_m(self) -> float:
        """Slip distance read at the tape mark."""
        return float(np.hypot(*self.mark_m))

    @property
    def held(self) -> bool:
        """True when at least two sides still press."""
        return self.normal_n[0] > 0.0


def simulate(
    scene: Scene, level: Level, step_s: float, brush_points: int = BRUSH_POINTS
) -> SceneOutcome:
    """Run a scene at one level. L0 has no step; it raises ValueError where a term is beyond it."""
    if level is Level.RIGID:
        return _rigid(scene)
    return _compliant(scene, drive(scene, step_s), level, brush_points)


def admits_rigid(scene: Scene) -> bool:
    """L0 knows straight bodies and elastic pads only."""
    return scene.body.shape == "straight" and scene.contact.relaxation_fraction == 0.0


def _rigid(scene: Scene) -> SceneOutcome:
    if not admits_rigid(scene):
        raise ValueError("L0 knows neither flanks nor relaxation; use L1")
    slip, u, forces = rigid.run(scene)
    lost = slip >= scene.body.body_above_grip_m
    end = [np.interp(scene.duration_s, forces.t_s, n) for n in forces.force_n.T]
    normal = np.zeros(FINGERS) if lost else np.array(end)
    peak = float(forces.force_n.max())
    pose, speed = np.array([0.0, -slip, 0.0]), np.array([0.0, -u, 0.0])
    return outcome(scene, Level.RIGID, 0.0, pose, speed, normal, peak)


def elements(scene: Scene, level: Level, brush_points: int) -> tuple[Floats, Floats]:
    """Finger (E,) of each element, and elements (E, 4) as compliant.follow takes them."""
    half = scene.contact.pad_half_length_m
    if level is Level.BRUSH:
        line = (2 * np.arange(brush_points) + 1 - brush_points) / brush_points * half
        grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    else:
        grid = np.zeros((1, 2))
    fingers = np.repeat(np.arange(FINGERS), len(grid))
    table = np.empty((len(fingers), 4))
    table[:, :2] = scene.finger_places()[fingers] + np.tile(grid, (FINGERS, 1))
    table[:, compliant.E_SPIN] = SQUARE_SPIN * half if level is Level.SPIN else 0.0
    table[:, compliant.E_SHARE] = 1.0 / len(grid)
    return fingers.astype(np.float64), table


def compliant_parameters(scene: Scene) -> Floats:
    """Parameter vector (22,) of levels L1 to L4."""
    tail = scene.plane.inertia_kgm2, scene.plane.centre_of_mass_y_m, scene.plane.centre_of_mass_z_m
    return np.concatenate((contact.parameters(scene.contact, scene.body), tail))


def _compliant(scene: Scene, d: Drive, level: Level, brush_points: int) -> SceneOutcome:
    p, s = compliant_parameters(scene), np.zeros(compliant.STATE_SIZE)
    finger, places = elements(scene, level, brush_points)
    s[compliant.TRAVEL : compliant.TRAVEL + FINGERS] = scene.grip.travel_m
    s[compliant.SPEED + 1] = d.first_mps
    normal = s[compliant.NORMAL : compliant.NORMAL + FINGERS]
    compliant.normal_forces(p, s, compliant.width_and_slope(p, 0.0)[0])
    stretch, sliding = np.zeros((len(finger), 3)), np.zeros(len(finger))
    stretch[:, 1] = scene.initial_stretch(normal)[finger.astype(int)]
    closing, on_table = scene.closing_vector(), scene.on_table
    tables = p, s, d.steps, d.step_s, d.hand_mps, d.load, closing, on_table
    if level is Level.SLIDER:
        compliant.follow_line(*tables, stretch, sliding)
    else:
        compliant.follow(*tables, finger, places, stretch, sliding)
    pose = s[compliant.POSE : compliant.POSE + 3].copy()
    speed = s[compliant.SPEED : compliant.SPEED + 3].copy()
    pose[1] -= s[compliant.HAND]
    speed[1] -= d.hand_mps[-1]
    return outcome(scene, level, d.step_s, pose, speed, normal, float(s[compliant.PEAK]))


def outcome(
    scene: Scene, level: Level, step_s: float, pose: Floats, speed: Floats, normal: Floats,
    peak_n: float,
) -> SceneOutcome:  # fmt: skip
    """SceneOutcome of an object at ``pose`` (3,) with ``speed`` (3,), both relative to the hand."""
    y, z, turn = pose.tolist()
    arm_y = -scene.plane.centre_of_mass_y_m
    arm_z = scene.plane.mark_height_m - scene.plane.centre_of_mass_z_m
    cos, sin = np.cos(turn), np.sin(turn)
    mark = (y + cos * arm_y - sin * arm_z - arm_y, z + sin * arm_y + cos * arm_z - arm_z)
    v_y, v_z, v_turn = speed.tolist()
    n_a, n_b, n_c = normal.tolist()
    return SceneOutcome(
        level=level, step_s=step_s, y_m=y, z_m=z, turn_rad=turn, speed=(v_y, v_z, v_turn),
        normal_n=(n_a, n_b, n_c), peak_force_n=peak_n, mark_m=(float(mark[0]), float(mark[1])),
    )  # fmt: skip
