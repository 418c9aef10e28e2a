"""A scene in MuJoCo, as an independent reference. MuJoCo is in the extra `dev`.

Three spheres are the pads, with the scene's normal forces. The hand is heavy enough to follow its
commanded motion. The object moves in the plane of the lift and along the closing axis. Contacts
have elliptic cones and one friction coefficient (the kinetic one), with spin friction if needed.
"""

import math

import numpy as np

from scenarios.world.contact import FINGER_PLACES_M, SQUARE_SPIN, Floats
from scenarios.world.settings import PAD_HALF_LENGTH_M
from studies.contact.reference import grip_forces
from studies.contact.scene import Scene, hand_height, hand_speed, mark_of, wrenches

HAND_KG = 1e6
PAD_RADIUS_M, PAD_KG = 0.01, 1.0  # lighter pads creep more: at 0.05 kg three times as fast
HEIGHT_M = 0.15  # half of the object's
SETTLE_S = 0.2  # a held object first settles in its grip; the scene starts after that


def xml(scene: Scene, step_s: float, impratio: float) -> str:
    """The model; x is the closing axis."""
    half = scene.body.half_width_m
    spin = SQUARE_SPIN * PAD_HALF_LENGTH_M
    table = '<geom type="plane" size="1 1 .1"/>' if scene.on_table else ""
    pads = "".join(
        f'<body pos="{side * (half + PAD_RADIUS_M)} {y} {HEIGHT_M}">'
        f'<joint type="slide" axis="{-side} 0 0"/>'
        f'<geom type="sphere" size="{PAD_RADIUS_M}" mass="{PAD_KG}" contype="2" conaffinity="2"/>'
        "</body>"
        for side, (y, _) in zip((1, -1, -1), FINGER_PLACES_M, strict=True)
    )
    i = scene.body.inertia_kgm2
    return f"""<mujoco><option timestep="{step_s}" cone="elliptic" impratio="{impratio}"/>
    <default><geom condim="4" friction="{scene.body.friction_kinetic} {spin} 0"/></default>
    <worldbody>{table}<body><joint type="slide" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="{HAND_KG}" diaginertia="1 1 1"/>{pads}</body>
    <body pos="0 0 {HEIGHT_M}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
    <joint type="slide" axis="0 0 1"/><joint type="hinge" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{scene.body.total_kg}" diaginertia="{i} {i} {i}"/>
    <geom type="box" size="{half} .1 {HEIGHT_M}" contype="3" conaffinity="3"/></body>
    </worldbody></mujoco>"""


def run(scene: Scene, step_s: float, impratio: float) -> Floats:
    """Displacement of the tape mark against the hand, (2,), m."""
    import mujoco

    steps = max(1, math.ceil(scene.duration_s / step_s - 1e-9))
    h = scene.duration_s / steps
    model = mujoco.MjModel.from_xml_string(xml(scene, h, impratio))
    data = mujoco.MjData(model)
    ends_s = np.linspace(0.0, scene.duration_s, steps + 1)
    knots_s, forces_n = grip_forces(scene)
    normal = np.array([np.interp(ends_s[:-1] + 0.5 * h, knots_s, f) for f in forces_n.T]).T
    hand = np.diff(hand_height(scene, ends_s)) / h
    acceleration, load = np.diff(hand, append=hand[-1]) / h, wrenches(scene, ends_s)[:, [0, 1, 3]]
    holding_n = (HAND_KG + 3 * PAD_KG) * 9.81
    data.qfrc_applied[0], data.qfrc_applied[1:4] = holding_n, normal[0]
    if not scene.on_table:
        for _ in range(round(SETTLE_S / h)):
            mujoco.mj_step(model, data)
    start = data.qpos.copy()
    data.qvel[[0, 1, 2, 3]] = 0.0
    data.qvel[6] += hand_speed(scene, np.zeros(1))[0]
    position, moved = data.qpos[0], 0.0
    for j in range(steps):
        data.qpos[0], data.qvel[0] = position + moved, hand[j]
        data.qfrc_applied[0] = holding_n + (HAND_KG + 3 * PAD_KG) * acceleration[j]
        data.qfrc_applied[1:4], data.qfrc_applied[5:8] = normal[j], load[j]
        mujoco.mj_step(model, data)
        moved += hand[j] * h
    y, z, turn = data.qpos[5:8] - start[5:8]
    return mark_of(turn, y, z - moved)
