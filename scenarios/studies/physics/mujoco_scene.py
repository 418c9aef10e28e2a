"""A scene of the contact ladder in MuJoCo, as an outside yardstick. MuJoCo is in the extra `dev`.

Three spheres as pads, pressed by the scene's normal forces; a hand so heavy that it moves as told;
an object that is free in the plane of the lift and along the closing axis. One friction coefficient
(the kinetic one), elliptic cones, and spin friction of the pads' size where something turns.
"""

import numpy as np

from scenarios.world.contact import SQUARE_SPIN, Floats, finger_places
from scenarios.world.ladder import rigid
from scenarios.world.ladder.drive import drive
from scenarios.world.ladder.scene import Scene

HAND_KG = 1e6
PAD_RADIUS_M, PAD_KG = 0.01, 1.0  # lighter pads creep more: 0.05 kg three times as fast
HEIGHT_M = 0.15  # half of the object's
SETTLE_S = 0.2  # a held object first sinks into its grip; the scene begins after that


def xml(scene: Scene, step_s: float, impratio: float) -> str:
    """The model; x is the closing axis."""
    half = scene.body.half_width_m
    spin = SQUARE_SPIN * scene.contact.pad_half_length_m
    table = '<geom type="plane" size="1 1 .1"/>' if scene.on_table else ""
    pads = "".join(
        f'<body pos="{side * (half + PAD_RADIUS_M)} {y} {HEIGHT_M}">'
        f'<joint type="slide" axis="{-side} 0 0"/>'
        f'<geom type="sphere" size="{PAD_RADIUS_M}" mass="{PAD_KG}" contype="2" conaffinity="2"/>'
        "</body>"
        for side, (y, _) in zip((1, -1, -1), finger_places(scene.contact), strict=True)
    )
    i = scene.body.inertia_kgm2
    return f"""<mujoco><option timestep="{step_s}" cone="elliptic" impratio="{impratio}"/>
    <default><geom condim="4" friction="{scene.body.friction_kinetic} {spin} 0"/></default>
    <worldbody>{table}<body><joint type="slide" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="{HAND_KG}" diaginertia="1 1 1"/>{pads}</body>
    <body pos="0 0 {HEIGHT_M}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
    <joint type="slide" axis="0 0 1"/><joint type="hinge" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{scene.mass_kg}" diaginertia="{i} {i} {i}"/>
    <geom type="box" size="{half} .1 {HEIGHT_M}" contype="3" conaffinity="3"/></body>
    </worldbody></mujoco>"""


def run(scene: Scene, step_s: float, impratio: float) -> Floats:
    """Displacement of the tape mark against the hand, (2,), m."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(xml(scene, step_s, impratio))
    data = mujoco.MjData(model)
    d, forces = drive(scene, step_s), rigid.grip_forces(scene)
    model.opt.timestep = d.step_s
    times = (np.arange(d.steps) + 0.5) * d.step_s
    normal = np.array([np.interp(times, forces.t_s, f) for f in forces.force_n.T]).T
    hand = np.broadcast_to(d.hand_mps, d.steps)
    acceleration = np.diff(hand, append=hand[-1]) / d.step_s
    torque_free = scene.body.centre_aside_m == 0.0 and scene.body.centre_above_m == 0.0
    if not torque_free:
        raise ValueError("the comparison knows centred objects only")
    load = np.broadcast_to(d.load, (d.steps, 4))[:, [0, 1, 3]]
    holding_n = (HAND_KG + 3 * PAD_KG) * 9.81
    data.qfrc_applied[0], data.qfrc_applied[1:4] = holding_n, normal[0]
    if not scene.on_table:
        for _ in range(round(SETTLE_S / d.step_s)):
            mujoco.mj_step(model, data)
    start = data.qpos.copy()
    data.qvel[[0, 1, 2, 3]] = 0.0
    data.qvel[6] += d.first_mps
    position, moved = data.qpos[0], 0.0
    for j in range(d.steps):
        data.qpos[0], data.qvel[0] = position + moved, hand[j]
        data.qfrc_applied[0] = holding_n + (HAND_KG + 3 * PAD_KG) * acceleration[j]
        data.qfrc_applied[1:4] = normal[j]
        data.qfrc_applied[5:8] = load[j]
        mujoco.mj_step(model, data)
        moved += hand[j] * d.step_s
    y, z, turn = data.qpos[5:8] - start[5:8]
    arm = scene.mark_height_m
    return np.array([y - np.sin(turn) * arm, z - moved + (np.cos(turn) - 1.0) * arm])
