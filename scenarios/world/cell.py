"""The simulated cell: one world joined to the three device models, advanced to any later instant.

Between commands the world is one compiled call; only while a finger moves near the object do
gripper model and contact law exchange forces, every millisecond, with finer steps inside each.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from drivers.interfaces import Vector3
from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings
from drivers.takktile.model.board import BoardModel, BoardModelSettings
from drivers.ur.model import ArmModel, ArmModelSettings
from scenarios.world import contact
from scenarios.world.contact import Floats
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.fingertip import (
    Codes,
    Fingertips,
    FingertipSettings,
    Surface,
    in_a_grasp,
)
from scenarios.world.objects import GraspObject
from scenarios.world.scene_terms import Damage, DamageSettings, Pull, PullSettings

EXCHANGE_NS = 1_000_000
CLOSING_MPS = 0.22  # thumb and opposing fingers at full speed


class CellSettings(msgspec.Struct, frozen=True, kw_only=True):
    """All that the cell is made of."""

    body: GraspObject
    contact: ContactSettings
    fingertip: FingertipSettings
    hand: HandSettings
    board: BoardModelSettings
    arm: ArmModelSettings
    finger_offset_m: Floats  # (3,) added travel: where a finger really stops
    pull: PullSettings = PullSettings()
    damage: DamageSettings = DamageSettings()


class Blow(msgspec.Struct, frozen=True, kw_only=True):
    """One tap of a mallet: a half-sine pulse, then a longer one while the hand follows through.

    ``top`` strikes downwards, ``side`` across the closing axis, ``closing`` along it, onto the
    thumb. Struck ``delay_s`` from now.
    """

    impulse_n_s: Annotated[float, Meta(ge=0.0, le=5.0)]
    duration_s: Annotated[float, Meta(gt=0.0, le=0.2)]
    direction: Literal["top", "side", "closing"] = "top"
    follow_n_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    follow_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    delay_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0


_DIRECTIONS = {"top": contact.TOP, "side": contact.SIDE, "closing": contact.CLOSING}


def strike(state: Floats, blow: Blow, start_s: float) -> None:
    """The blow, from start_s on."""
    contact.strike(
        state, _DIRECTIONS[blow.direction], start_s, (blow.duration_s, blow.impulse_n_s),
        (blow.follow_s, blow.follow_n_s),
    )  # fmt: skip


class Truth(msgspec.Struct, frozen=True):
    """What only a simulation knows. Times in seconds since the cell began, None = not yet."""

    t_ns: int
    height_m: float
    speed_mps: float
    slip_distance_m: float
    slip_speed_mps: float
    normal_n: Vector3
    shear_n: Vector3
    peak_n: Vector3
    slip_onset_s: float | None
    force_rise_s: float | None
    flank_slope: float  # of the surface at the pads' last contact; negative: narrowing upwards
    across_m: float = 0.0  # of the object, across the closing axis, relative to the fingertips
    struck_s: float | None = None  # beginning of the last blow
    moved_from_s: float | None = None  # gross slip since that blow: its first instant
    moved_until_s: float | None = None  # and its last one so far

    @property
    def touched(self) -> bool:
        return max(self.normal_n) > 0.0


class SimulatedCell:
    """World, gripper, board and arm on one time line; the world's own time starts at start_ns."""

    def __init__(self, settings: CellSettings, rng: np.random.Generator, start_ns: int = 0) -> None:
        self.gripper = GripperModel(settings.hand, start_ns)
        self.arm = ArmModel(settings.arm, start_ns)
        self.board = BoardModel(settings.board, self._latch)
        self._start_ns = self._now_ns = start_ns
        self._stiffness = np.zeros(contact.FINGERS)
        self._arm_height_m, self._arm_rise_mps = self.arm.position(start_ns)[2], 0.0
        self.load(settings, rng)

    def load(self, settings: CellSettings, rng: np.random.Generator) -> None:
        """Another scene: object, contact and fingertips; no object is in place yet. The devices
        are those that the cell began with, wherever they stand."""
        surfaces = [surface_of(settings.body)] * contact.FINGERS
        self.fingertips = Fingertips(in_a_grasp(settings.fingertip), surfaces, rng)
        self._damage = Damage(settings.damage, rng.spawn(1)[0])
        self._pull = Pull(settings.pull, self._now_ns)
        angle = math.radians(settings.fingertip.slip_direction_deg)
        # (F, 2) in the pads' frames, which face each other: up, and the way a blow across drives
        self._up = np.tile([math.cos(angle), math.sin(angle)], (contact.FINGERS, 1))
        self._across = np.outer([1.0, -1.0, -1.0], [-math.sin(angle), math.cos(angle)])
        self._turn = np.full(contact.FINGERS, angle)  # the surface's x is the object's upwards
        self._parameters = contact.parameters(settings.contact, settings.body)
        self._state = contact.initial_state(present=False)
        self._step_s = settings.contact.step_s
        self._offset_m = settings.finger_offset_m
        self._travel_m = self.gripper.travel_m + self._offset_m

    def place_object(self) -> None:
        """Put the object on the table between the fingers, which must be open: an activation
        closes the hand fully, so the object comes afterwards, as in the laboratory."""
        self._state[:] = contact.initial_state()

    def tap(self, blow: Blow) -> None:
        """Strike the object. What an earlier blow moved is forgotten."""
        start_s = (self._now_ns - self._start_ns) * 1e-9 + blow.delay_s
        strike(self._state, blow, start_s)

    def advance(self, now_ns: int) -> None:
        """Advance everything to now_ns."""
        while self._now_ns < now_ns:
            end_ns = now_ns
            if self.gripper.moving and self._near(now_ns):
                end_ns = min(now_ns, self._now_ns + EXCHANGE_NS)
            self._advance_to(end_ns)

    def _near(self, until_ns: int) -> bool:
        """True when moving fingers could reach the object by then, or touch it now."""
        s = self._state
        reach_m = CLOSING_MPS * (until_ns - self._now_ns) * 1e-9
        clearance_m = contact.clearance(self._parameters, s, self._travel_m)
        return s[contact.NORMAL] > 0.0 or clearance_m <= reach_m

    def _advance_to(self, end_ns: int) -> None:
        t0, t1 = self._now_ns, end_ns
        s = self._state
        before = self._travel_m
        normal = s[contact.NORMAL : contact.NORMAL + contact.FINGERS]
        contact.normal_stiffness(self._parameters, normal, self._stiffness)
        self.gripper.advance(t1, FingerLoads(normal, self._stiffness))
        self._travel_m = self.gripper.travel_m + self._offset_m
        height, rise_mps = self.arm.position(t1)[2], self.arm.velocity(t1)[2]
        contact.advance(
            self._parameters, s, (t0 - self._start_ns) * 1e-9, (t1 - t0) * 1e-9, self._step_s,
            height - self._arm_height_m, self._arm_rise_mps, rise_mps,
            before, self._travel_m,
        )  # fmt: skip
        self._arm_height_m, self._arm_rise_mps = height, rise_mps
        self._now_ns = end_ns
        if self._pull.begins(end_ns, float(s[contact.HEIGHT]), rise_mps):
            p = self._pull.settings
            start_s = (end_ns - self._start_ns) * 1e-9
            contact.pull(s, p.force_n, start_s, p.ramp_s, p.lasts_s)

    def _latch(self, t_ns: int) -> Callable[[], tuple[Codes, Codes]]:
        """What the pads are about to feel now; not all of it will be asked for."""
        return partial(self._sample, t_ns, self._state.copy(), self._arm_rise_mps != 0.0)

    def _sample(self, t_ns: int, s: Floats, arm_moves: bool) -> tuple[Codes, Codes]:
        centre = contact.centre_on_pad(self._parameters, s[contact.SLIP])
        # the object lags behind the rising fingers
        motion = s[contact.ACROSS] * self._across - s[contact.SLIP] * self._up
        self.fingertips.advance(
            (t_ns - self._start_ns) * 1e-9,
            s[contact.NORMAL : contact.NORMAL + contact.FINGERS],
            motion * 1e3,
            self._turn,
            centre * self._up * 1e3,
            arm_moves,
        )
        pressure, temperature = self.fingertips.codes()
        return self._damage.felt(pressure).ravel(), temperature.ravel()

    def compile(self) -> None:
        """Run every compiled function once. The first time on a machine that takes seconds, which
        must have passed before a device has to answer."""
        self._near(self._now_ns + EXCHANGE_NS)
        self._advance_to(self._now_ns + EXCHANGE_NS)
        self._latch(self._now_ns)()

    def truth(self) -> Truth:
        """The state of the world at the time that it was last advanced to."""
        s = self._state
        return Truth(
            t_ns=self._now_ns,
            height_m=float(s[contact.HEIGHT]),
            speed_mps=float(s[contact.SPEED]),
            slip_distance_m=float(s[contact.SLIP]),
            slip_speed_mps=float(s[contact.SLIP_SPEED]),
            normal_n=_three(s, contact.NORMAL),
            shear_n=_three(s, contact.SHEAR),
            peak_n=_three(s, contact.PEAK),
            slip_onset_s=_time(s[contact.ONSET_S]),
            force_rise_s=_time(s[contact.RISE_S]),
            flank_slope=float(s[contact.SLOPE]),
            across_m=float(s[contact.ACROSS]),
            struck_s=float(s[contact.TAP_START_S]) if s[contact.TAP_S] > 0.0 else None,
            moved_from_s=_time(s[contact.MOVED_FROM_S]),
            moved_until_s=_time(s[contact.MOVED_UNTIL_S]),
        )


def surface_of(body: GraspObject) -> Surface:
    """What every pad touches, x upwards; an ellipsoid is round in its horizontal section."""
    curvature = (0.0, 0.0)
    if body.shape == "ellipsoid":
        curvature = (body.half_width_m / body.half_height_m**2 * 1e-3, 1e-3 / body.half_width_m)
    return Surface(
        curvature_per_mm=curvature,
        texture_rms_mm=body.texture_rms_m * 1e3,
        texture_length_mm=body.texture_length_m * 1e3,
        friction_static=body.friction_static,
        friction_kinetic=body.friction_kinetic,
    )


def _three(state: Floats, at: int) -> Vector3:
    a, b, c = state[at : at + 3].tolist()
    return a, b, c


def _time(t_s: np.float64) -> float | None:
    return None if t_s == contact.NOT_YET else float(t_s)
