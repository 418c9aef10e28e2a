"""One interface to the five levels: a scene and a step go in, the same outcome comes out."""

import msgspec
import numpy as np

from scenarios.world import laws
from scenarios.world.contact import (
    BRUSH_POINTS,
    FINGERS,
    Floats,
    elements,
    initial_state,
    let_along,
    parameters,
)
from scenarios.world.ladder import rigid
from scenarios.world.ladder.drive import Drive, drive
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level


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
    """The exact solution of L0 knows straight bodies, elastic pads, a single pulse and no pull."""
    elastic = scene.contact.relaxation_fraction == 0.0
    pulse = scene.tap is None or (scene.tap.follow_n_s == 0.0 and scene.tap.direction != "closing")
    return scene.body.shape == "straight" and elastic and pulse and scene.pull is None


def _rigid(scene: Scene) -> SceneOutcome:
    if not admits_rigid(scene):
        raise ValueError("L0 knows neither flanks, relaxation, a follow-through nor a pull; use L1")
    slip, u, forces = rigid.run(scene)
    lost = slip >= scene.body.body_above_grip_m
    end = [np.interp(scene.duration_s, forces.t_s, n) for n in forces.force_n.T]
    normal = np.zeros(FINGERS) if lost else np.array(end)
    peak = float(forces.force_n.max())
    pose, speed = np.array([0.0, -slip, 0.0]), np.array([0.0, -u, 0.0])
    return outcome(scene, Level.RIGID, 0.0, pose, speed, normal, peak)


def begin(scene: Scene, first_mps: float) -> Floats:
    """State (50,) of a scene at its start, the object as fast as the hand."""
    s = initial_state()
    s[laws.HEIGHT] = 0.0 if scene.on_table else laws.IN_THE_AIR_M
    s[laws.SPEED] = first_mps
    return s


def _compliant(scene: Scene, d: Drive, level: Level, brush_points: int) -> SceneOutcome:
    p = parameters(scene.contact, scene.body, level)
    s, e = begin(scene, d.first_mps), elements(scene.contact, level, brush_points)
    travel, normal = np.array(scene.grip.travel_m), np.zeros(FINGERS)
    laws.normal_forces(p, laws.width_and_slope(p, 0.0)[0], travel, s, normal)
    if scene.tap is not None and scene.tap.direction == "closing":
        let_along(p, s, normal)
    stretch = scene.initial_stretch(normal)
    e[:, laws.E_STRETCH_Z] = stretch[e[:, laws.E_FINGER].astype(int)]
    laws.follow(p, s, e, d.steps, d.step_s, d.hand_mps, d.load, scene.closing_vector(), travel)
    pose = s[[laws.COM_ACROSS, laws.COM_RISE, laws.TURN]]
    speed = s[[laws.ACROSS_SPEED, laws.SPEED, laws.TURN_RATE]] - [0.0, d.hand_mps[-1], 0.0]
    normal = s[laws.NORMAL : laws.NORMAL + FINGERS]
    peak = float(s[laws.PEAK : laws.PEAK + FINGERS].max())
    return outcome(scene, level, d.step_s, pose, speed, normal, peak)


def outcome(
    scene: Scene, level: Level, step_s: float, pose: Floats, speed: Floats, normal: Floats,
    peak_n: float,
) -> SceneOutcome:  # fmt: skip
    """SceneOutcome of an object at ``pose`` (3,) with ``speed`` (3,), both relative to the hand."""
    y, z, turn = pose.tolist()
    arm_y = -scene.body.centre_aside_m
    arm_z = scene.mark_height_m - scene.body.centre_above_m
    cos, sin = np.cos(turn), np.sin(turn)
    mark = (y + cos * arm_y - sin * arm_z - arm_y, z + sin * arm_y + cos * arm_z - arm_z)
    v_y, v_z, v_turn = speed.tolist()
    n_a, n_b, n_c = normal.tolist()
    return SceneOutcome(
        level=level, step_s=step_s, y_m=y, z_m=z, turn_rad=turn, speed=(v_y, v_z, v_turn),
        normal_n=(n_a, n_b, n_c), peak_force_n=peak_n, mark_m=(float(mark[0]), float(mark[1])),
    )  # fmt: skip
