"""A scene of the contact ladder in MuJoCo, where the object may also do what the ladder leaves out:
move along the closing axis x with its own inertia, and tilt about y and z.

Every finger is held in place by a motor that locks itself: a mass on the mount's spring, and on it
a brush of pad points, each on springs of its own along and across the closing axis. So compliances
are those of ``ContactSettings``, and MuJoCo's contacts need only be hard: their time constant is
two steps, and an ``impratio`` of 1000 leaves next to nothing of MuJoCo's creep. (An impedance next
to 1 does that as well, but such contacts are nanometres deep, chatter, and never converge.)

The frame is the hand's. An arm that rises is gravity plus its acceleration and a table that sinks.
"""

import math
from enum import Enum
from typing import Any

import msgspec
import numpy as np

from scenarios.world import contact
from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats
from scenarios.world.ladder.drive import drive
from scenarios.world.ladder.rigid import press
from scenarios.world.ladder.scene import Scene

SIDES = (1, -1, -1)  # of thumb, B and C along x; the thumb pushes towards -x
TIP_M = 1e-3  # radius of a pad point
TABLE_KG = 1e6
SETTLE_S, RAMP_S, SETTLE_RATE = 0.45, 0.12, 40.0
BALANCE_S = 2e-3  # within which x follows its balance where it has no inertia
LOST_MPS = 0.05
SEEN_EVERY = 10  # steps between two looks at x and tilt
BELOW_M = 0.15  # foot of a straight body below the grip


class Freedom(Enum):
    """Joints of the object."""

    PLANE = "y z turn"  # x follows the balance of the normal forces, as in the ladder
    CLOSING = "x y z turn"
    ALL = "x y z turn pitch yaw"


class Solver(msgspec.Struct, frozen=True, kw_only=True):
    """What MuJoCo's answer must not depend on."""

    step_s: float = 2e-4
    impratio: float = 1000.0
    impedance: float = 0.9


class Assumed(msgspec.Struct, frozen=True, kw_only=True):
    """What a fuller model has to assume besides. Nothing here is measured."""

    finger_kg: float = 0.05  # moving with the fingertip; assumed, 0.02-0.1
    pad_kg: float = 4.5e-3  # 20 x 20 x 10 mm of urethane
    loss_s: float = 1.5e-3  # damping over stiffness along x; as the pad's shear, assumed, 0.5-3 ms
    table_friction: float = 0.3  # assumed, 0.2-0.5
    points: int = 3  # a side of a pad


class Beyond(msgspec.Struct, frozen=True, kw_only=True):
    """What a scene of the ladder cannot say."""

    blow_x_m: float = 0.0  # a blow on top or side strikes this far from the middle, towards thumb
    weight_x_m: float = 0.0
    blow_z_m: float = 0.0  # a blow along the closing axis strikes this far above it


TUNED, USUAL, NOTHING = Solver(), Assumed(), Beyond()


class Motion(msgspec.Struct, frozen=True):
    """What became of the object, in the hand's frame."""

    mark_m: tuple[float, float]  # displacement of the tape mark along y and z
    turn_rad: float
    closing_m: float  # largest displacement along x
    tilt_rad: float  # largest tilt out of the plane
    peak_force_n: float
    held: bool

    @property
    def slip_m(self) -> float:
        return math.hypot(*self.mark_m)


def xml(
    scene: Scene, freedom: Freedom, solver: Solver, beyond: Beyond, assumed: Assumed,
) -> str:  # fmt: skip
    """The model: object first, then the table, then the fingers."""
    body, free = scene.body, freedom.value.split()
    half, mass = body.half_width_m, scene.mass_kg
    low = BELOW_M if body.shape == "straight" else body.half_height_m + body.grip_height_m
    joints = "".join(
        f'<joint type="{kind}" axis="{axis}"/>'
        for name, kind, axis in (
            ("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("z", "slide", "0 0 1"),
            ("turn", "hinge", "1 0 0"), ("pitch", "hinge", "0 1 0"), ("yaw", "hinge", "0 0 1"),
        ) if name in free
    )  # fmt: skip
    inertia = f"{body.inertia_kgm2} {body.inertia_kgm2} {0.5 * mass * half**2}"
    com = f"{beyond.weight_x_m} {body.centre_aside_m} {body.centre_above_m}"
    asset, shape = _shape(scene, low)
    fingers = "".join(_finger(scene, assumed, i) for i in range(FINGERS))
    table = f'<geom type="box" size="1 1 .05" pos="0 0 {-low - 0.05}" conaffinity="2"/>'
    return f"""<mujoco><option timestep="{solver.step_s}" cone="elliptic"
     impratio="{solver.impratio}" integrator="implicitfast" iterations="100" tolerance="1e-12"/>
    <default><geom condim="3" contype="0" conaffinity="0" friction="{assumed.table_friction} 0 0"
     solref="{2 * solver.step_s} 1" solimp="{solver.impedance} {solver.impedance} .001"/></default>
    <asset>{asset}</asset><worldbody>
    <body>{joints}<inertial pos="{com}" mass="{mass}" diaginertia="{inertia}"/>
    <site name="mark" pos="0 0 {scene.mark_height_m}"/>
    <geom {shape} friction="{body.friction_kinetic} 0 0" conaffinity="1"/>
    <geom type="box" size="{0.7 * half} {0.7 * half} .002" pos="0 0 {0.002 - low}" contype="2"/>
    </body><body gravcomp="1"><joint type="slide" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="{TABLE_KG}" diaginertia="1 1 1"/>{table if scene.on_table else ""}
    </body>{fingers}</worldbody></mujoco>"""


def _shape(scene: Scene, low: float) -> tuple[str, str]:
    """Mesh and geom of what the pads touch: wide along y, as the ladder sees it."""
    body = scene.body
    if body.shape == "straight":
        middle, tall = 0.5 * (body.body_above_grip_m - low), 0.5 * (body.body_above_grip_m + low)
        return "", f'type="box" size="{body.half_width_m} .2 {tall}" pos="0 0 {middle}"'
    angles = np.linspace(0.0, 2 * math.pi, 720, endpoint=False)
    corners = " ".join(
        f"{body.half_width_m * math.cos(a):.9f} {y} {body.half_height_m * math.sin(a):.9f}"
        for a in angles for y in (-0.2, 0.2)
    )  # fmt: skip
    place = f'pos="0 0 {-body.grip_height_m}"'
    if body.half_width_m == body.half_height_m:
        across = f'type="cylinder" size="{body.half_width_m} .2" euler="90 0 0"'
        return "", f"{across} {place}"
    return f'<mesh name="hull" vertex="{corners}"/>', f'type="mesh" mesh="hull" {place}'


def _finger(scene: Scene, assumed: Assumed, i: int) -> str:
    pads, count = scene.contact, assumed.points**2
    normal = 1 / (count * (1 / pads.pad_stiffness_npm + 1 / scene.body.wall_stiffness_npm))
    shear, damping = pads.shear_stiffness_npm / count, pads.shear_damping_nspm / count
    line = (2 * np.arange(assumed.points) + 1 - assumed.points) / assumed.points
    slide = '<joint type="slide" axis="{}" stiffness="{}" damping="{}"/>'
    inward = f"{-SIDES[i]} 0 0"
    across = "".join(slide.format(axis, shear, damping) for axis in ("0 1 0", "0 0 1"))
    tip = (
        slide.format(inward, normal, normal * assumed.loss_s) + across
        + f'<geom type="sphere" size="{TIP_M}" mass="{assumed.pad_kg / count}" contype="1" '
        f'friction="{scene.body.friction_kinetic} 0 0"/>'
    )  # fmt: skip
    tips = "".join(
        f'<body pos="0 {y} {z}">{tip}</body>'
        for y in line * pads.pad_half_length_m for z in line * pads.pad_half_length_m
    )  # fmt: skip
    mount = pads.mount_stiffness_npm
    (y, z), x = contact.finger_places(pads)[i], SIDES[i] * (scene.body.half_width_m + TIP_M)
    return (
        f'<body pos="{x} {y} {z}">{slide.format(inward, mount, mount * assumed.loss_s)}'
        f'<inertial pos="0 0 0" mass="{assumed.finger_kg}" diaginertia="1e-5 1e-5 1e-5"/>'
        f"{tips}</body>"
    )


class _Run:
    """One model on its way through one scene."""

    def __init__(
        self, scene: Scene, freedom: Freedom, solver: Solver, beyond: Beyond, assumed: Assumed
    ) -> None:
        import mujoco

        text = xml(scene, freedom, solver, beyond, assumed)
        self._step: Any = mujoco.mj_step
        self.model: Any = mujoco.MjModel.from_xml_string(text)
        self.data: Any = mujoco.MjData(self.model)
        joints = self.model.njnt - 1 - FINGERS * (1 + 3 * assumed.points**2)  # of the object
        self.table = joints
        self.fingers = joints + 1 + (1 + 3 * assumed.points**2) * np.arange(FINGERS)
        self.names = freedom.value.split()
        self.mount_npm = scene.contact.mount_stiffness_npm
        self.stiffness_npm = contact.finger_stiffness(scene.contact, scene.body)
        self.step_s = solver.step_s
        self.travel = np.zeros(FINGERS)  # of the motors
        self.sides = np.array(SIDES)
        self.lateral = 0.0  # of an object without inertia along x

    def step(self, gravity: float, wrench: Floats) -> Floats:
        """One step under a force (3,) and torque about the centre of mass (3,); returns the
        normal force of each finger (3,), N."""
        reference = self.travel + self.lateral * self.sides
        self.model.qpos_spring[self.fingers] = reference
        self.model.opt.gravity[2] = -gravity
        self.data.xfrc_applied[1] = wrench
        self._step(self.model, self.data)
        force: Floats = self.mount_npm * (reference - self.data.qpos[self.fingers])
        if "x" not in self.names:
            net_n = force[1] + force[2] - force[0] + wrench[0]
            rate = self.step_s / (BALANCE_S * FINGERS * self.stiffness_npm)
            self.lateral += rate * net_n
        return force

    def settle(self, target_n: Floats, on_table: bool) -> None:
        """Close until the fingers press with target_n (3,); then the weight comes."""
        force = np.zeros(FINGERS)
        for j in range(round(SETTLE_S / self.step_s)):
            t = j * self.step_s
            wanted = target_n * min(1.0, t / RAMP_S)
            self.travel += self.step_s * SETTLE_RATE * (wanted - force) / self.stiffness_npm
            weight = 1.0 if on_table else min(max(t / RAMP_S - 1.0, 0.0), 1.0)
            force = self.step(weight * GRAVITY_MPS2, np.zeros(6))
            self.lateral = 0.0

    def held(self, force: Floats) -> bool:
        """True when both sides press and the object keeps up with the hand."""
        pressed = force[0] > 0.1 and force[1] + force[2] > 0.1
        return bool(pressed and abs(self.data.qvel[self.names.index("z")]) < LOST_MPS)

    def pose(self) -> Floats:
        """Mark (3,), turn, x and tilt (the last two 0 where there is no such joint)."""
        q = self.data.qpos
        x = q[0] if "x" in self.names else self.lateral
        tilt = math.hypot(*q[self.table - 2 : self.table]) if "yaw" in self.names else 0.0
        return np.array([*self.data.site("mark").xpos, q[self.names.index("turn")], x, tilt])


def run(
    scene: Scene, freedom: Freedom, solver: Solver = TUNED, beyond: Beyond = NOTHING,
    assumed: Assumed = USUAL,
) -> Motion:  # fmt: skip
    """A scene of the ladder without vibration, pads elastic, friction the kinetic one throughout.

    Raises ValueError for a scene that relaxes or vibrates.
    """
    if scene.contact.relaxation_fraction or scene.vibration is not None:
        raise ValueError("the comparison knows neither relaxation nor vibration")
    hand = _Run(scene, freedom, solver, beyond, assumed)
    target_n = press(contact.parameters(scene.contact, scene.body), np.array(scene.grip.travel_m))
    hand.settle(target_n, scene.on_table)
    start, d = hand.pose(), drive(scene, solver.step_s)
    speeds = np.broadcast_to(d.hand_mps, d.steps)
    gains = np.diff(speeds, prepend=0.0) / d.step_s
    loads = _wrenches(scene, beyond, np.broadcast_to(d.load, (d.steps, 4)))
    heights, closing = np.cumsum(speeds) * d.step_s, scene.grip.closing
    peak, most, stopped, force = 0.0, np.zeros(2), closing is None, target_n
    for j in range(d.steps):
        if closing is not None and not stopped and (j + 1) * d.step_s > closing.start_s:
            stopped = force[0] >= closing.force_stop_n
            hand.travel[0] += 0.0 if stopped else closing.speed_mps * d.step_s
        hand.data.qpos[hand.table] = speeds[j] * d.step_s - heights[j]
        hand.data.qvel[hand.table] = gains[j] * d.step_s - speeds[j]
        hand.data.qfrc_applied[hand.table] = -TABLE_KG * gains[j]
        force = hand.step(GRAVITY_MPS2 + gains[j], loads[j])
        peak = max(peak, float(force.max()))
        if j % SEEN_EVERY == 0:
            most = np.maximum(most, np.abs(hand.pose() - start)[4:])
    moved = hand.pose() - start
    return Motion(
        mark_m=(float(moved[1]), float(moved[2])), turn_rad=float(moved[3]),
        closing_m=float(most[0]), tilt_rad=float(most[1]), peak_force_n=peak,
        held=hand.held(force),
    )  # fmt: skip


def _wrenches(scene: Scene, beyond: Beyond, load: Floats) -> Floats:
    """Force and torque about the centre of mass (steps, 6) from the ladder's forces along y, z and
    x and torque about x."""
    y, z, x, turn = load.T
    pitch, yaw = beyond.blow_z_m * x - beyond.blow_x_m * z, beyond.blow_x_m * y
    force, torque = np.stack([x, y, z], axis=1), np.stack([turn, pitch, yaw], axis=1)
    com = np.array([beyond.weight_x_m, scene.body.centre_aside_m, scene.body.centre_above_m])
    return np.hstack([force, torque - np.cross(com, force)])
