"""A stated scene, and the contact levels of a run applied to it.

Plane of motion: y across the closing axis, z up, rotation from y to z. The origin is the middle of
the grip at the start. The hand moves along z only.
"""

import math

import msgspec
import numpy as np
from numba import njit

from scenarios.world import laws
from scenarios.world.contact import (
    BRUSH_POINTS,
    FINGERS,
    GRAVITY_MPS2,
    Floats,
    elements,
    finger_stiffness,
    initial_state,
    parameters,
)
from scenarios.world.objects import GraspObject
from scenarios.world.settings import (
    HALF_APERTURE_M,
    ContactSettings,
    Impact,
    Level,
)

MARK_M = 0.05  # tape mark above the grip, where slip is read
Three = tuple[float, float, float]

PADS = ContactSettings(shear_stiffness_npm=7000.0, relaxation_fraction=0.0)
BODY = GraspObject(
    name="reference", grip_counts=(55, 55, 55), mass_kg=0.3, friction_static=0.5,
    friction_kinetic=0.4, wall_stiffness_npm=2e5, half_width_m=0.0356,
)  # fmt: skip


class Closing(msgspec.Struct, frozen=True):
    """A thumb that closes until its force stop."""

    start_s: float
    speed_mps: float
    force_stop_n: float


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """Loads and motions of one object between three fingers. None: the scene has no such term."""

    name: str
    duration_s: float
    body: GraspObject = BODY
    contact: ContactSettings = PADS
    travel_m: Three  # of the fingers
    closing: Closing | None = None
    on_table: bool = False  # False: the hand holds the object from the start
    arm_mps: float = 0.0  # rising speed of the arm
    arm_mps2: float = 0.5
    tap: Impact | None = None  # from the top or the side, without a follow-through
    shake_mps2: float = 0.0  # peak acceleration of a hand that vibrates along z
    shake_hz: float = 20.0

    @property
    def shake_radps(self) -> float:
        """Angular frequency of the vibration."""
        return 2 * math.pi * self.shake_hz

    def initial_stretch(self, normal_n: Floats) -> Floats:
        """Shear of each pad (3,), m, that carries the weight at the start; zeros on a table."""
        if self.on_table or normal_n.sum() == 0.0:
            return np.zeros(FINGERS)
        weight_n = self.body.total_kg * GRAVITY_MPS2
        stretch: Floats = weight_n * normal_n / normal_n.sum() / self.contact.shear_stiffness_npm
        return stretch


def grip_travel(body: GraspObject, b_n: float, c_n: float) -> Three:
    """Finger travel, m, at which B and C press with b_n and c_n and the thumb with their sum."""
    k = finger_stiffness(body)
    touch = HALF_APERTURE_M - body.half_width_m
    return touch + (b_n + c_n) / k, touch + b_n / k, touch + c_n / k


def lift(pads: ContactSettings = PADS, duration_s: float = 1.6) -> Scene:
    """Thumb 2 to 10 N at 110 N/s from 0.3 s on; arm 0.5 m/s2 to 0.1 m/s."""
    rise_npm = finger_stiffness(BODY) * 2 / 3
    return Scene(
        name="lift", duration_s=duration_s, contact=pads, on_table=True, arm_mps=0.1,
        travel_m=grip_travel(BODY, 1.0, 1.0),
        closing=Closing(start_s=0.3, speed_mps=110.0 / rise_npm, force_stop_n=10.0),
    )  # fmt: skip


def tap() -> Scene:
    """A tap of 0.2 N s within 8 ms on the top, 20 mm beside the middle of a 10 N grip."""
    impact = Impact(impulse_n_s=0.2, duration_s=8e-3, offset_m=0.02)
    return Scene(name="tap", duration_s=0.4, travel_m=grip_travel(BODY, 5.0, 5.0), tap=impact)


def vibration() -> Scene:
    """A 10 N grip shaken at 20 Hz: the peak load is 0.82 of the kinetic cone, nothing may slip."""
    travel_m = grip_travel(BODY, 5.0, 5.0)
    return Scene(name="vibration", duration_s=1.0, travel_m=travel_m, shake_mps2=12.0)


def hand_height(scene: Scene, t_s: Floats) -> Floats:
    """Height of the hand, m, at times t_s (n,); a vibration's acceleration is +a sin(w t)."""
    within = np.minimum(t_s, scene.arm_mps / scene.arm_mps2)
    height: Floats = 0.5 * scene.arm_mps2 * within**2 + scene.arm_mps * (t_s - within)
    return height - scene.shake_mps2 / scene.shake_radps**2 * np.sin(scene.shake_radps * t_s)


def hand_speed(scene: Scene, t_s: Floats) -> Floats:
    """Speed of the hand, m/s."""
    rise: Floats = np.minimum(scene.arm_mps2 * t_s, scene.arm_mps)
    return rise - scene.shake_mps2 / scene.shake_radps * np.cos(scene.shake_radps * t_s)


def tap_wrench(impact: Impact) -> Floats:
    """Force along y and z and torque about the middle of the grip (3,), per newton of a tap."""
    force = [0.0, -1.0] if impact.direction == "top" else [1.0, 0.0]
    return np.array([*force, -impact.offset_m])


def wrenches(scene: Scene, ends_s: Floats) -> Floats:
    """Mean load of the tap between those times, (n - 1, 4), in the form of `laws.step`."""
    load = np.zeros((len(ends_s) - 1, 4))
    if scene.tap is not None:
        phase = np.clip((ends_s - scene.tap.delay_s) / scene.tap.duration_s, 0.0, 1.0)
        impulse = 0.5 * scene.tap.impulse_n_s * (1.0 - np.cos(math.pi * phase))
        mean_n = np.diff(impulse) / np.diff(ends_s)
        load[:, [0, 1, 3]] = mean_n[:, None] * tap_wrench(scene.tap)
    return load


def mark_of(turn: float, y: float, z: float) -> Floats:
    """Displacement of the tape mark (2,), m, relative to the hand, of a centred object."""
    return np.array([y - math.sin(turn) * MARK_M, z + (math.cos(turn) - 1.0) * MARK_M])


def simulate(scene: Scene, level: Level, step_s: float, points: int = BRUSH_POINTS) -> Floats:
    """Displacement of the tape mark (2,), m, at a contact level, by backward Euler.

    Step means keep the hand's path and the tap's impulse exact at any step.
    """
    steps = max(1, math.ceil(scene.duration_s / step_s - 1e-9))
    h = scene.duration_s / steps
    ends_s = np.linspace(0.0, scene.duration_s, steps + 1)
    hand_mps = np.diff(hand_height(scene, ends_s)) / h
    p, s = parameters(scene.contact, scene.body, level), initial_state()
    s[laws.HEIGHT] = 0.0 if scene.on_table else laws.IN_THE_AIR_M
    s[laws.SPEED] = hand_speed(scene, np.zeros(1))[0]
    e, normal = elements(level, points), press(p, np.array(scene.travel_m))
    e[:, laws.E_STRETCH_Z] = scene.initial_stretch(normal)[e[:, laws.E_FINGER].astype(int)]
    closing = scene.closing or Closing(math.inf, 0.0, 0.0)
    motion = np.array([closing.start_s, closing.speed_mps, closing.force_stop_n])
    follow(p, s, e, h, hand_mps, wrenches(scene, ends_s), motion, np.array(scene.travel_m))
    return mark_of(s[laws.TURN], s[laws.COM_ACROSS], s[laws.COM_RISE])


def press(p: Floats, travel: Floats) -> Floats:
    """Normal forces (3,), N, of fingers at ``travel`` (3,), m, before any slip."""
    out = np.zeros(FINGERS)
    laws.normal_forces(p, p[laws.P_HALF_WIDTH], travel, initial_state(), out)
    return out


# not cached: numba's cache sees no change in an imported kernel
@njit(cache=False)
def follow(
    p: Floats, s: Floats, e: Floats, h: float, hand_mps: Floats, load: Floats, closing: Floats,
    travel: Floats,
) -> None:  # fmt: skip
    """Steps of h seconds with tables over them; ``closing`` (3,): start, speed and force stop of
    the thumb. A thumb that would pass its stop is put where it just reaches it."""
    n, work, small = np.empty(FINGERS), np.empty((e.shape[0], 8)), np.empty((9, 3))
    stopped = False
    for j in range(hand_mps.shape[0]):
        moved_s = min(h, (j + 1) * h - closing[0])
        if moved_s > 0.0 and not stopped:
            before = travel[0]
            travel[0] = min(before + closing[1] * moved_s, p[laws.P_APERTURE])
            width, _ = laws.width_and_slope(p, s[laws.SLIP])
            laws.normal_forces(p, width, travel, s, n)
            if n[0] >= closing[2]:
                stopped = True
                laws.normal_stiffness(p, n, 0.0, s[laws.STIFFNESS :])
                back = (n[0] - closing[2]) / s[laws.STIFFNESS]
                travel[0] = max(before, travel[0] - back)
        laws.step(p, s, e, h, hand_mps[j], travel, load[j], n, work, small)
