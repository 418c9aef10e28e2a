"""A scene in MuJoCo, as an independent reference. MuJoCo is in the extra `dev`.

``pads``: three spheres press with the scene's normal forces. Contacts have elliptic cones and one
friction coefficient (the kinetic one), with spin friction if needed. The object moves in the plane
of the lift and along the closing axis. ``one_axis``: the object moves along the lift only, and a
joint with dry friction replaces the contacts.

Both use settings that suit a firm grip: light pads, contacts that are stiff at the step
(``solref``), ``implicitfast``, and either a high ``impratio`` or ``noslip_iterations``.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from scenarios.world.contact import FINGER_PLACES_M, GRAVITY_MPS2, SQUARE_SPIN, Floats
from scenarios.world.settings import PAD_HALF_LENGTH_M
from studies.contact.reference import grip_forces
from studies.contact.scene import Scene, hand_height, hand_speed, mark_of, wrenches

HAND_KG = 1e6  # follows its commanded motion, whatever the object does
PAD_RADIUS_M, PAD_KG = 0.01, 0.05
HEIGHT_M = 0.15  # half of the object's
SETTLE_S = 0.2  # a held object first settles in its grip; the scene starts after that
SOLREF_STEPS = 2.0  # time constant of a contact, in steps: the least that MuJoCo recommends
SOLIMP = ".9999 .9999 .001"  # of the joint: the softer default lets a stuck joint creep
TOLERANCE = 1e-15  # the heavy hand scales it up: with MuJoCo's default the solver stops too early
Forces = tuple[Floats, Floats, Floats]  # (steps, 3) normal; (steps,) of the hand; (steps, 3) load


def _xml(scene: Scene, step_s: float, option: str, bodies: str) -> str:
    table = '<geom type="plane" size="1 1 .1"/>' if scene.on_table else ""
    spin = SQUARE_SPIN * PAD_HALF_LENGTH_M
    solref = f"{SOLREF_STEPS * step_s} 1"
    return f"""<mujoco><option timestep="{step_s}" integrator="implicitfast" cone="elliptic"
    gravity="0 0 {-GRAVITY_MPS2}" tolerance="{TOLERANCE}" {option}/>
    <default><geom condim="4" friction="{scene.body.friction_kinetic} {spin} 0" solref="{solref}"/>
    <joint solreffriction="{solref}" solimpfriction="{SOLIMP}"/></default>
    <worldbody>{table}{bodies}</worldbody></mujoco>"""


def _pads(scene: Scene) -> str:
    half, i = scene.body.half_width_m, scene.body.inertia_kgm2
    pads = "".join(
        f'<body pos="{side * (half + PAD_RADIUS_M)} {y} {HEIGHT_M}">'
        f'<joint type="slide" axis="{-side} 0 0"/>'
        f'<geom type="sphere" size="{PAD_RADIUS_M}" mass="{PAD_KG}" contype="2" conaffinity="2"/>'
        "</body>"
        for side, (y, _) in zip((1, -1, -1), FINGER_PLACES_M, strict=True)
    )
    return f"""<body><joint type="slide" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="{HAND_KG}" diaginertia="1 1 1"/>{pads}</body>
    <body pos="0 0 {HEIGHT_M}"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
    <joint type="slide" axis="0 0 1"/><joint type="hinge" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{scene.body.total_kg}" diaginertia="{i} {i} {i}"/>
    <geom type="box" size="{half} .1 {HEIGHT_M}" contype="3" conaffinity="3"/></body>"""


def _slider(scene: Scene) -> str:
    half, mass = scene.body.half_width_m, scene.body.total_kg
    return f"""<body><joint type="slide" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="{HAND_KG}" diaginertia="1 1 1"/>
    <body pos="0 0 {HEIGHT_M}"><joint type="slide" axis="0 0 1" frictionloss="1"/>
    <geom type="box" size="{half} .1 {HEIGHT_M}" mass="{mass}"/></body></body>"""


@cache
def _compiled(xml: str) -> Any:
    """The model; a throughput comparison does not time its compilation."""
    import mujoco

    return mujoco.MjModel.from_xml_string(xml)


def _steps(scene: Scene, step_s: float) -> tuple[int, float]:
    steps = max(1, math.ceil(scene.duration_s / step_s - 1e-9))
    return steps, scene.duration_s / steps


def _forces(scene: Scene, steps: int, h: float, moved_kg: float) -> Forces:
    """Forces that press the pads, move the hand on its path (against gravity) and tap the object
    across, along the lift and in rotation; means of each step."""
    ends_s = np.linspace(0.0, scene.duration_s, steps + 1)
    knots_s, forces_n = grip_forces(scene)
    normal = np.array([np.interp(ends_s[:-1] + 0.5 * h, knots_s, f) for f in forces_n.T]).T
    start_mps = hand_speed(scene, np.zeros(1))[0]
    acceleration = np.diff(np.diff(hand_height(scene, ends_s)) / h, prepend=start_mps) / h
    hand: Floats = moved_kg * (GRAVITY_MPS2 + acceleration)
    return normal, hand, wrenches(scene, ends_s)[:, [0, 1, 3]]


def pads(scene: Scene, step_s: float, option: str) -> Floats:
    """Displacement of the tape mark against the hand, (2,), m. ``option``: of the solver."""
    import mujoco
    from mujoco import rollout

    steps, h = _steps(scene, step_s)
    model = _compiled(_xml(scene, h, option, _pads(scene)))
    data = mujoco.MjData(model)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, state, full)
    applied = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value

    def run(state: Floats, force: Floats) -> Floats:
        states, _ = rollout.rollout(model, data, state, control=force, control_spec=applied)
        out: Floats = states[0, -1]
        return out

    force, moved_kg = np.zeros((steps, model.nv)), HAND_KG + 3 * PAD_KG
    force[:, 1:4], force[:, 0], force[:, 5:8] = _forces(scene, steps, h, moved_kg)
    if not scene.on_table:
        settle = np.tile(force[0], (round(SETTLE_S / h), 1))
        settle[:, 0], settle[:, 5:8] = moved_kg * GRAVITY_MPS2, 0.0
        state = run(state, settle)
    positions, speeds = slice(1, 1 + model.nq), state[1 + model.nq :]
    start, speeds[:4] = state[positions].copy(), 0.0
    speeds[[0, 6]] += hand_speed(scene, np.zeros(1))[0]
    moved = run(state, force)[positions] - start
    return mark_of(moved[7], moved[5], moved[6] - moved[0])


def one_axis(scene: Scene, step_s: float) -> Floats:
    """The same of a slider whose friction is that of all pads; for scenes without rotation."""
    import mujoco

    steps, h = _steps(scene, step_s)
    model = _compiled(_xml(scene, h, "", _slider(scene)))
    data = mujoco.MjData(model)
    normal, hand, _ = _forces(scene, steps, h, HAND_KG + scene.body.total_kg)
    friction = scene.body.friction_kinetic * normal.sum(axis=1)
    data.qvel[0] = hand_speed(scene, np.zeros(1))[0]
    for j in range(steps):
        model.dof_frictionloss[1], data.qfrc_applied[0] = friction[j], hand[j]
        mujoco.mj_step(model, data)
    return np.array([0.0, data.qpos[1]])
