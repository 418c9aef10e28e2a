"""One object between three fingers, at one contact level: what a cell advances.

The laws themselves are compiled, in ``laws``; here are their parameters, their elements and a
state that belongs together.
"""

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

# Linkage of one finger; assumed, 3-10 N/mm: without it one motor count would be 7-15 N and no
# insufficient grasp would exist. And the 10 mm urethane pad, normal; derived, 12-20 N/mm.
MOUNT_STIFFNESS_NPM, PAD_STIFFNESS_NPM = 5000.0, 15000.0
RELAXATION_TIME_S = 0.2  # of the fraction that relaxes; real clip 0.1-0.3 s
FORCE_RISE_N = 0.2  # truth: a grip force has increased by this much; a few deviations of wander
FINGER_SPACING_M = 0.06  # of B and C; assumed, 40-75 mm
PULL_RAMP_S, PULL_S = 0.1, 0.3  # to full strength and back, and at it; assumed
RAMP_S, FOREVER_S = 1e-3, 1e6  # of a push, which is all there when it begins
BRUSH_POINTS = 6  # a side of a pad
# Mean distance from the middle of a square of half side 1: torque at which a uniform patch spins.
SQUARE_SPIN = float((np.sqrt(2.0) + np.log(1.0 + np.sqrt(2.0))) / 3.0)
# What an impact moved stands once it was slower than this share of gross slip for so long, longer
# than half a swing on the pads; creeping on at that speed it would turn by 0.5 deg in ten seconds.
REST_SHARE, REST_S = 5e-3, 0.5
_DIRECTIONS = {"top": laws.TOP, "side": laws.SIDE, "closing": laws.CLOSING}


def finger_stiffness(body: GraspObject) -> float:
    """Normal stiffness of one finger on one wall, N/m: mount, pad and wall in series."""
    return 1 / (1 / MOUNT_STIFFNESS_NPM + 1 / PAD_STIFFNESS_NPM + 1 / body.wall_stiffness_npm)


def held_radps(body: GraspObject) -> float:
    """Of an object that all fingers hold, along the closing axis, rad/s."""
    return math.sqrt(FINGERS * finger_stiffness(body) / body.total_kg)


def parameters(contact: ContactSettings, body: GraspObject, level: Level = Level.SLIDER) -> Floats:
    """Parameter vector (27,) of the compiled laws."""
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
        float(level), contact.impact_step_s, contact.normal_loss_s,
    )  # fmt: skip
    return out


def initial_state(present: bool = True) -> Floats:
    """State vector (50,): object at rest on the table, nothing touched; or no object yet."""
    state = np.zeros(laws.STATE_SIZE)
    state[laws.PRESENT] = 1.0 if present else 0.0
    for never in (laws.ONSET_S, laws.RISE_S, laws.MOVED_FROM_S, laws.MOVED_UNTIL_S):
        state[never] = laws.NOT_YET
    return state


def let_along(p: Floats, state: Floats, normal_n: Floats) -> None:
    """From now on the object has its inertia along the closing axis: parameters p (27,), state
    (50,), what the fingers press with (3,), N, at rest."""
    state[laws.INERT], state[laws.LATERAL_SPEED] = 1.0, 0.0
    stiffness = p[laws.P_STIFFNESS : laws.P_STIFFNESS + FINGERS]
    state[laws.SQUEEZE : laws.SQUEEZE + FINGERS] = normal_n / stiffness


# Middle of each pad, (3, 2), m: the thumb opposes the middle between B and C.
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

    up: Floats  # (3, 2)
    across: Floats  # (3, 2)
    turns: Floats  # (3,) of a rotation from across to upwards

    @classmethod
    def at(cls, angle_rad: float) -> Self:
        """Upwards is at that angle from each pad's x."""
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        opposed = np.array([1.0, -1.0, -1.0])
        return cls(np.tile([cos, sin], (FINGERS, 1)), np.outer(opposed, [-sin, cos]), -opposed)


class Contact:
    """The object, the pads and what has happened to them. Times count from when the cell began.

    ``state`` is laid out as ``laws`` says; it may be read and copied.
    """

    def __init__(
        self, settings: ContactSettings, body: GraspObject, level: Level = Level.SLIDER,
        impact_level: Level | None = None,
    ) -> None:  # fmt: skip
        """Set the contact level while an impact moves the object; None: the level before it. Raises
        ValueError for a lower level, which has no rotation."""
        self.level, self._before = level, level
        self._impact_level = level if impact_level is None else impact_level
        if self._impact_level < level:
            raise ValueError(f"{self._impact_level.label} is less than {level.label}")
        self.state = initial_state(present=False)
        self._settings = settings
        self._parameters = parameters(settings, body, level)
        self._elements = elements(level)
        self._places_m = FINGER_PLACES_M[:, 0]
        self._moved_s = 0.0  # when an impact was last seen to move the object

    @property
    def normal_n(self) -> Floats:
        """(3,) normal force of each finger; a view of the state."""
        return self.state[laws.NORMAL : laws.NORMAL + FINGERS]

    def place(self, above_m: float = 0.0) -> None:
        """The object stands on the table, untouched, its mark so far below the pads."""
        self.state[:] = initial_state()
        self.state[laws.SLIP], self.state[laws.COM_RISE] = above_m, -above_m
        self._go_on_at(self._before)
        self._elements[:, laws.E_SLIDES :] = 0.0

    def _go_on_at(self, level: Level) -> None:
        """Another level from now on: each element takes over its finger's stretch."""
        if level is self.level:
            return
        old, new = self._elements, elements(level)
        for finger in range(FINGERS):
            was = old[old[:, laws.E_FINGER] == finger, laws.E_SLIDES :].mean(axis=0)
            new[new[:, laws.E_FINGER] == finger, laws.E_SLIDES :] = was
        new[:, laws.E_SLIDES] = new[:, laws.E_SLIDES] > 0.5
        self.level, self._elements = level, new
        self._parameters[laws.P_LEVEL] = float(level)

    def strike(self, impact: Impact, start_s: float) -> None:
        """Apply a tap from start_s on; displacement by an earlier one is forgotten."""
        self._go_on_at(self._impact_level)
        s = self.state
        s[laws.TAP_DIRECTION], s[laws.TAP_START_S] = _DIRECTIONS[impact.direction], start_s
        s[laws.TAP_S], s[laws.TAP_N_S] = impact.duration_s, impact.impulse_n_s
        s[laws.FOLLOW_S], s[laws.FOLLOW_N_S] = impact.follow_s, impact.follow_n_s
        # of the object as it stood at first: it may have moved in the hand since
        moved_m = s[laws.COM_RISE if impact.direction == "side" else laws.COM_ACROSS]
        s[laws.TAP_OFFSET] = impact.offset_m - moved_m
        s[laws.MOVED_FROM_S] = s[laws.MOVED_UNTIL_S] = laws.NOT_YET
        if impact.direction == "closing" and s[laws.INERT] == 0.0:
            let_along(self._parameters, s, self.normal_n)
        self._moved_s = start_s + impact.duration_s + impact.follow_s

    def _rests(self, t_s: float) -> bool:
        """Whether what the last impact moved stands in the hand; asked again and again."""
        s = self.state
        ways = laws.ACROSS_SPEED, laws.SLIP_SPEED, laws.LATERAL_SPEED
        speed_mps = max(abs(s[way]) for way in ways)
        slow = speed_mps < REST_SHARE * GROSS_SLIP_MPS
        if not (slow and abs(s[laws.TURN_RATE]) < REST_SHARE * GROSS_TURN_RADPS):
            self._moved_s = t_s
        return t_s > self._moved_s + REST_S

    def _come_to_rest(self) -> None:
        """On as before the impact: nothing is left that would turn, go across or along."""
        s = self.state
        s[laws.ACROSS_SPEED] = s[laws.TURN_RATE] = s[laws.SPIN] = 0.0
        s[laws.INERT] = s[laws.LATERAL_SPEED] = 0.0
        self._go_on_at(self._before)

    def pull(self, settings: PullSettings, start_s: float) -> None:
        """A force downwards from start_s on, with a ramp at either end."""
        s = self.state
        s[laws.PULL_START_S], s[laws.PULL_N] = start_s, settings.force_n
        s[laws.PULL_RAMP_S], s[laws.PULL_S] = PULL_RAMP_S, PULL_S

    def wet(self, share: float) -> None:
        """From now on the pads have so much of their friction left."""
        self._parameters[laws.P_MU_S] *= share
        self._parameters[laws.P_MU_K] *= share

    def push(self, down_n: float, start_s: float) -> None:
        """A steady force downwards from start_s on, in place of any pull."""
        s = self.state
        s[laws.PULL_RAMP_S], s[laws.PULL_S] = RAMP_S, FOREVER_S
        s[laws.PULL_START_S], s[laws.PULL_N] = start_s - RAMP_S, down_n

    def advance(
        self, t_s: float, dt_s: float, rise_m: float, from_mps: float, to_mps: float,
        travel0: Floats, travel1: Floats,
    ) -> None:  # fmt: skip
        """From t_s on for dt_s: the hand rises by rise_m, its speed at both ends given; the fingers
        close from travel0 to travel1, (3,) m."""
        if self.state[laws.PRESENT] == 0.0:  # as when the hand is activated
            return
        struck = self.level is not self._before or self.state[laws.INERT] != 0.0
        if struck and self._rests(t_s):
            self._come_to_rest()
        laws.advance(
            self._parameters, self.state, self._elements, t_s, dt_s, self._settings.step_s,
            rise_m, from_mps, to_mps, travel0, travel1,
        )  # fmt: skip

    def compile(self) -> None:
        """Run the law once, on a copy: it is not asked before there is an object."""
        still = np.zeros(FINGERS)
        laws.advance(
            self._parameters, self.state.copy(), self._elements.copy(), 0.0, 1e-3,
            self._settings.step_s, 0.0, 0.0, 0.0, still, still,
        )  # fmt: skip

    @property
    def stiffness_npm(self) -> Floats:
        """(3,) dN/dtravel of each finger with the others still; a view of the state."""
        return self.state[laws.STIFFNESS :]

    def clearance_m(self, travel: Floats) -> float:
        """How far thumb and nearest opposing finger may close in all before both sides touch."""
        gap: float = laws.clearance(self._parameters, self.state, travel)
        return gap

    def felt(self, state: Floats, frames: PadFrames) -> tuple[Floats, Floats, Floats]:
        """In the pads' frames, of a copy of the state: motion (3, 2), m, and turn (3,), rad, of the
        surface at each pad's middle; centre (3, 2), m, of a curved one."""
        motion, turn, centre = np.empty((FINGERS, 2)), np.empty(FINGERS), np.empty((FINGERS, 2))
        laws.felt(
            self._parameters, state, frames.up, frames.across, self._places_m, frames.turns,
            motion, turn, centre,
        )  # fmt: skip
        return motion, turn, centre
