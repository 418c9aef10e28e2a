"""Contact of one object with three fingers at one contact level: parameters, elements and state
of the compiled laws in ``laws``."""

import math
from typing import Self

import msgspec
import numpy as np

from scenarios.world import laws
from scenarios.world.laws import FINGERS, Floats
from scenarios.world.objects import GraspObject
from scenarios.world.settings import (
    GRAVITY_MPS2,
    GROSS_SLIP_MPS,
    GROSS_TURN_RADPS,
    HALF_APERTURE_M,
    PAD_HALF_LENGTH_M,
    ContactSettings,
    Impact,
    Level,
    PullSettings,
)

__all__ = ["FINGERS", "GRAVITY_MPS2", "Contact", "Floats", "parameters"]

# Linkage of one finger: assumed, 3-10 N/mm; with a rigid one a motor count would be 7-15 N and no
# insufficient grasp would exist. Normal stiffness of the 10 mm urethane pad: derived, 12-20 N/mm.
MOUNT_STIFFNESS_NPM, PAD_STIFFNESS_NPM = 5000.0, 15000.0
RELAXATION_TIME_S = 0.2  # of the fraction that relaxes; 0.1-0.3 s in the real recording
FORCE_RISE_N = 0.2  # true rise that counts as an increased grip force; several sigmas of noise
FINGER_SPACING_M = 0.06  # of B and C; assumed, 40-75 mm
PULL_RAMP_S, PULL_S = 0.1, 0.3  # each ramp of a pull, and its time at full force; assumed
RAMP_S, FOREVER_S = 1e-3, 1e6  # of a push, which starts at full force
BRUSH_POINTS = 6  # along each side of a pad
# Mean distance from the centre of a square of half side 1: lever arm of a uniform patch's spin.
SQUARE_SPIN = float((np.sqrt(2.0) + np.log(1.0 + np.sqrt(2.0))) / 3.0)
# After an impact the object is at rest once it has stayed below this share of gross slip for
# REST_S, more than half a period on the pads. At that speed it turns by 0.5 deg in ten seconds.
REST_SHARE, REST_S = 5e-3, 0.5
_DIRECTIONS = {"top": laws.TOP, "side": laws.SIDE, "closing": laws.CLOSING}


def finger_stiffness(body: GraspObject) -> float:
    """Normal stiffness of one finger on one wall, N/m: mount, pad and wall in series."""
    return 1 / (1 / MOUNT_STIFFNESS_NPM + 1 / PAD_STIFFNESS_NPM + 1 / body.wall_stiffness_npm)


def held_object_radps(body: GraspObject) -> float:
    """Natural frequency along the closing axis of an object that all fingers hold, rad/s."""
    return math.sqrt(FINGERS * finger_stiffness(body) / body.total_kg)


def parameters(contact: ContactSettings, body: GraspObject, level: Level = Level.SLIDER) -> Floats:
    """Parameter vector (28,) of the compiled laws (index constants P_*)."""
    out = np.empty(laws.PARAMETER_SIZE)
    out[: laws.P_STIFFNESS] = (
        body.total_kg, body.friction_static, body.friction_kinetic,
        contact.shear_stiffness_npm, contact.shear_damping_nspm,
        contact.relaxation_fraction, RELAXATION_TIME_S,
        HALF_APERTURE_M, PAD_HALF_LENGTH_M,
        0.0 if body.shape == "straight" else 1.0,
        body.half_width_m, body.half_height_m, body.grip_height_m, body.body_above_grip_m,
    )  # fmt: skip
    out[laws.P_STIFFNESS : laws.P_GROSS_SLIP] = finger_stiffness(body)
    out[laws.P_GROSS_SLIP :] = (
        GROSS_SLIP_MPS, FORCE_RISE_N, GROSS_TURN_RADPS,
        body.inertia_kgm2, body.centre_aside_m, body.centre_above_m,
        float(level), contact.impact_step_s, contact.normal_loss_s, contact.table_friction,
    )  # fmt: skip
    return out


def initial_state(present: bool = True) -> Floats:
    """State vector (50,): object at rest on the table and untouched, or no object."""
    state = np.zeros(laws.STATE_SIZE)
    state[laws.PRESENT] = 1.0 if present else 0.0
    for never in (laws.ONSET_S, laws.RISE_S, laws.MOVED_FROM_S, laws.MOVED_UNTIL_S):
        state[never] = laws.NOT_YET
    return state


def free_along_closing_axis(p: Floats, state: Floats, normal_n: Floats) -> None:
    """Give the object its inertia along the closing axis: parameters p (28,), state (50,), normal
    forces at rest (3,), N."""
    state[laws.HAS_INERTIA], state[laws.LATERAL_SPEED] = 1.0, 0.0
    stiffness = p[laws.P_STIFFNESS : laws.P_STIFFNESS + FINGERS]
    state[laws.COMPRESSION : laws.COMPRESSION + FINGERS] = normal_n / stiffness


# Centre of each pad, (3, 2), m: the thumb is opposite the midpoint of B and C.
FINGER_PLACES_M = FINGER_SPACING_M * np.array([[0.0, 0.0], [-0.5, 0.0], [0.5, 0.0]])


def elements(level: Level, brush_points: int = BRUSH_POINTS) -> Floats:
    """Elements (E, 9) of unstretched pads at that level."""
    half = PAD_HALF_LENGTH_M
    grid = np.zeros((1, 2))
    if level is Level.BRUSH:
        line = (2 * np.arange(brush_points) + 1 - brush_points) / brush_points * half
        grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    finger = np.repeat(np.arange(FINGERS), len(grid))
    out = np.zeros((len(finger), laws.ELEMENT_SIZE))
    out[:, : laws.E_SPIN] = FINGER_PLACES_M[finger] + np.tile(grid, (FINGERS, 1))
    out[:, laws.E_SPIN] = SQUARE_SPIN * half if level is Level.SPIN else 0.0
    out[:, laws.E_SHARE] = 1.0 / len(grid)
    out[:, laws.E_FINGER] = finger
    return out


class PadFrames(msgspec.Struct, frozen=True):
    """The scene's directions in the frame of each pad; the pads face each other."""

    angle_rad: float  # of upwards, from each pad's x
    up: Floats  # (3, 2)
    across: Floats  # (3, 2)
    turns: Floats  # (3,) of a rotation from across to upwards

    @classmethod
    def at(cls, angle_rad: float) -> Self:
        """Frames in which upwards is at that angle from each pad's x."""
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        opposed = np.array([1.0, -1.0, -1.0])
        up, across = np.tile([cos, sin], (FINGERS, 1)), np.outer(opposed, [-sin, cos])
        return cls(angle_rad, up, across, -opposed)


class Contact:
    """State of the object and the pads. Times count from the cell's start.

    ``state`` has the layout of ``laws``; it may be read and copied.
    """

    def __init__(
        self, settings: ContactSettings, body: GraspObject, level: Level = Level.SLIDER,
        impact_level: Level | None = None,
    ) -> None:  # fmt: skip
        """Without ``impact_level``, ``level`` holds during an impact too. Raises ValueError where
        it is below ``level``, which has no rotation."""
        self.level, self._base_level = level, level
        self._impact_level = level if impact_level is None else impact_level
        if self._impact_level < level:
            raise ValueError(
                f"impact level {self._impact_level.label} is below the contact level {level.label}"
            )
        self.state = initial_state(present=False)
        self._settings = settings
        self._parameters = parameters(settings, body, level)
        self._elements = elements(level)
        self._places_m = FINGER_PLACES_M[:, 0]
        self._in_impact = False  # until the object has come to rest
        self._last_motion_s = 0.0  # last time at which the object moved after an impact

    @property
    def normal_n(self) -> Floats:
        """(3,) normal force of each finger; a view of the state."""
        return self.state[laws.NORMAL : laws.NORMAL + FINGERS]

    def place(self, above_m: float = 0.0) -> None:
        """Put the object on the table, untouched, its grip mark above_m below the pads."""
        self.state[:] = initial_state()
        self.state[laws.SLIP], self.state[laws.COM_RISE] = above_m, -above_m
        self._switch_level(self._base_level)
        self._elements[:, laws.E_SLIDES :] = 0.0
        self._in_impact = False

    def _switch_level(self, level: Level) -> None:
        """Change the contact level; each new element takes its finger's mean stretch."""
        if level is self.level:
            return
        old, new = self._elements, elements(level)
        for finger in range(FINGERS):
            mean_stretch = old[old[:, laws.E_FINGER] == finger, laws.E_SLIDES :].mean(axis=0)
            new[new[:, laws.E_FINGER] == finger, laws.E_SLIDES :] = mean_stretch
        new[:, laws.E_SLIDES] = new[:, laws.E_SLIDES] > 0.5
        self.level, self._elements = level, new
        self._parameters[laws.P_LEVEL] = float(level)

    def strike(self, impact: Impact, start_s: float) -> None:
        """Apply a tap from start_s on; resets the record of an earlier one."""
        self._switch_level(self._impact_level)
        s = self.state
        s[laws.TAP_DIRECTION], s[laws.TAP_START_S] = _DIRECTIONS[impact.direction], start_s
        s[laws.TAP_S], s[laws.TAP_N_S] = impact.duration_s, impact.impulse_n_s
        s[laws.FOLLOW_S], s[laws.FOLLOW_N_S] = impact.follow_s, impact.follow_n_s
        # the offset refers to the first grasp; the object may have moved in the hand since
        moved_m = s[laws.COM_RISE if impact.direction == "side" else laws.COM_ACROSS]
        s[laws.TAP_OFFSET] = impact.offset_m - moved_m
        s[laws.MOVED_FROM_S] = s[laws.MOVED_UNTIL_S] = laws.NOT_YET
        if impact.direction == "closing" and s[laws.HAS_INERTIA] == 0.0:
            free_along_closing_axis(self._parameters, s, self.normal_n)
        self._in_impact = self.level is not self._base_level or s[laws.HAS_INERTIA] != 0.0
        self._last_motion_s = start_s + impact.duration_s + impact.follow_s

    def _is_at_rest(self, t_s: float) -> bool:
        """Whether the object has come to rest after the last impact; call it at every step."""
        s = self.state
        speeds = laws.ACROSS_SPEED, laws.SLIP_SPEED, laws.LATERAL_SPEED
        speed_mps = max(abs(s[speed]) for speed in speeds)
        slow = speed_mps < REST_SHARE * GROSS_SLIP_MPS
        if not (slow and abs(s[laws.TURN_RATE]) < REST_SHARE * GROSS_TURN_RADPS):
            self._last_motion_s = t_s
        return t_s > self._last_motion_s + REST_S

    def _end_impact(self) -> None:
        """Return to the level before the impact; clears residual velocities."""
        s = self.state
        s[laws.ACROSS_SPEED] = s[laws.TURN_RATE] = s[laws.SPIN] = 0.0
        s[laws.HAS_INERTIA] = s[laws.LATERAL_SPEED] = 0.0
        self._switch_level(self._base_level)
        self._in_impact = False

    def pull(self, settings: PullSettings, start_s: float) -> None:
        """Apply a downward force from start_s on, with a ramp at either end."""
        s = self.state
        s[laws.PULL_START_S], s[laws.PULL_N] = start_s, settings.force_n
        s[laws.PULL_RAMP_S], s[laws.PULL_S] = PULL_RAMP_S, PULL_S

    def wet(self, share: float) -> None:
        """Reduce the friction of all pads to this share."""
        self._parameters[laws.P_MU_S] *= share
        self._parameters[laws.P_MU_K] *= share

    def push(self, down_n: float, start_s: float) -> None:
        """Apply a steady downward force from start_s on; replaces any pull."""
        s = self.state
        s[laws.PULL_RAMP_S], s[laws.PULL_S] = RAMP_S, FOREVER_S
        s[laws.PULL_START_S], s[laws.PULL_N] = start_s - RAMP_S, down_n

    def advance(
        self, t_s: float, dt_s: float, rise_m: float, from_mps: float, to_mps: float,
        travel0: Floats, travel1: Floats,
    ) -> None:  # fmt: skip
        """Advance from t_s by dt_s. The hand rises by rise_m, at from_mps first and to_mps last;
        the fingers close from travel0 to travel1, (3,) m."""
        if self._in_impact and self._is_at_rest(t_s):
            self._end_impact()
        laws.advance(
            self._parameters, self.state, self._elements, t_s, dt_s, self._settings.step_s,
            rise_m, from_mps, to_mps, travel0, travel1,
        )  # fmt: skip

    def clearance_m(self, travel: Floats) -> float:
        """Gap between the object and the pads, m: sum of the thumb's and the nearest opposing
        finger's; 0 while a finger touches the object."""
        gap: float = laws.clearance(self._parameters, self.state, travel)
        return gap

    def surface_motion(self, state: Floats, frames: PadFrames) -> tuple[Floats, Floats, Floats]:
        """Motion (3, 2), mm, and angle (3,), rad, of the surface at each pad's centre, and centre
        (3, 2), mm, of a curved one; in the pads' frames, from a copy of the state."""
        motion_mm, centre_mm = np.empty((FINGERS, 2)), np.empty((FINGERS, 2))
        turn = np.empty(FINGERS)
        laws.surface_motion(
            self._parameters, state, frames.angle_rad, frames.up, frames.across, self._places_m,
            frames.turns, motion_mm, turn, centre_mm,
        )  # fmt: skip
        return motion_mm, turn, centre_mm
