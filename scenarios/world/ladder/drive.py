"""What a scene imposes, as tables over the steps of a level. An absent term is one row."""

import math

import msgspec
import numpy as np

from scenarios.world.blow import Blow
from scenarios.world.contact import Floats
from scenarios.world.ladder.scene import ArmRise, Scene, Vibration
from scenarios.world.scene_terms import PullSettings

UP = np.array([0.0, 1.0, 0.0, 0.0])  # of a load: along y, z, the closing axis; torque


class Drive(msgspec.Struct, frozen=True):
    """Step means, so that the hand's path and the tap's impulse are exact at any step."""

    steps: int
    step_s: float
    hand_mps: Floats  # (steps,) or (1,), along z
    load: Floats  # (steps, 4) or (1, 4): of a blow, as laws._step takes it
    first_mps: float  # speed of hand and object when the scene begins


def drive(scene: Scene, step_s: float) -> Drive:
    """Tables of a scene for steps of at most step_s."""
    steps = max(1, math.ceil(scene.duration_s / step_s - 1e-9))
    h = scene.duration_s / steps
    ends_s = np.linspace(0.0, scene.duration_s, steps + 1)
    hand_mps = np.zeros(1)
    if scene.arm is not None:
        hand_mps = hand_mps + np.diff(arm_height(scene.arm, ends_s)) / h
    if scene.vibration is not None:
        hand_mps = hand_mps + np.diff(vibration_height(scene.vibration, ends_s)) / h
    load = np.zeros((1, 4))
    if scene.tap is not None:
        mean_n = np.diff(tap_impulse(scene.tap, ends_s)) / h
        load = mean_n[:, None] * tap_wrench(scene.tap)
    if scene.pull is not None:
        load = load - pull_force(scene.pull, ends_s[1:] - 0.5 * h)[:, None] * UP
    first = 0.0
    if scene.vibration is not None:
        first = -scene.vibration.acceleration_mps2 / scene.vibration.rate
    return Drive(steps, h, hand_mps, load, first)


def arm_height(arm: ArmRise, t_s: Floats) -> Floats:
    """Height risen, m, at times t_s (n,)."""
    ramp_s = arm.speed_mps / arm.acceleration_mps2
    within = np.minimum(t_s, ramp_s)
    height: Floats = 0.5 * arm.acceleration_mps2 * within**2 + arm.speed_mps * (t_s - within)
    return height


def vibration_height(vibration: Vibration, t_s: Floats) -> Floats:
    """Height of the hand, m, at times t_s (n,); its acceleration is +a sin(w t)."""
    height: Floats = -vibration.acceleration_mps2 / vibration.rate**2 * np.sin(vibration.rate * t_s)
    return height


def tap_impulse(tap: Blow, t_s: Floats) -> Floats:
    """Impulse delivered until t_s (n,), N s, that of the hand's following through included."""
    since_s = t_s - tap.delay_s
    impulse = _half_sine(since_s, tap.duration_s, tap.impulse_n_s)
    if tap.follow_n_s > 0.0:
        impulse = impulse + _half_sine(since_s - tap.duration_s, tap.follow_s, tap.follow_n_s)
    return impulse


def _half_sine(since_s: Floats, duration_s: float, impulse_n_s: float) -> Floats:
    phase = np.clip(since_s / duration_s, 0.0, 1.0)
    impulse: Floats = 0.5 * impulse_n_s * (1.0 - np.cos(math.pi * phase))
    return impulse


def pull_force(pull: PullSettings, t_s: Floats) -> Floats:
    """Force downwards, N, at times t_s (n,): a ramp, all of it, a ramp."""
    since_s = t_s - pull.after_s
    left_s = 2 * pull.ramp_s + pull.lasts_s - since_s
    force: Floats = pull.force_n * np.clip(np.minimum(since_s, left_s) / pull.ramp_s, 0.0, 1.0)
    return force


def tap_wrench(tap: Blow) -> Floats:
    """Force along y, z and the closing axis and torque about the middle of the grip, (4,), of a
    blow of 1 N."""
    if tap.direction == "closing":
        return np.array([0.0, 0.0, 1.0, 0.0])
    if tap.direction == "top":
        return np.array([0.0, -1.0, 0.0, -tap.offset_m])
    return np.array([1.0, 0.0, 0.0, -tap.offset_m])
