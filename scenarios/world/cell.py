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
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES, Vector3
from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings
from drivers.takktile.model.board import BoardModel, BoardModelSettings
from drivers.ur.model import ArmModel, ArmModelSettings
from scenarios.world import laws
from scenarios.world.contact import FINGERS, Contact, Floats, PadFrames, held_radps
from scenarios.world.fingertip import Codes, Fingertips, Held
from scenarios.world.objects import GraspObject, within
from scenarios.world.settings import (
    ContactSettings,
    DamageSettings,
    FingertipSettings,
    Impact,
    Level,
    PullSettings,
    Surface,
    in_a_grasp,
)
from scenarios.world.truth import Truth

EXCHANGE_NS = 1_000_000
SIDES = np.array([1.0, -1.0, -1.0])  # of the object: the thumb presses against the other two
PULL_AFTER_S = 0.2  # that the arm has stood in the air; assumed
CLOSING_MPS = 0.22  # thumb and opposing fingers at full speed


Newtons = Annotated[float, within(0.0, 50.0)]


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
    level: Level = Level.SLIDER
    impact_level: Level | None = None  # while an impact moves the object; None: the same


class PadPress(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A person's finger on one pad of an open hand, who wants to know which taxel answers."""

    finger: Literal["A", "B", "C"]
    taxel: Annotated[int, within(0, 10_000)]
    newtons: Newtons = 1.0
    seconds: Annotated[float, within(0.0, 60.0)] = 1.0


class LaidWeight(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A weight that a person lays on one pad of an open hand, its face curved as the scene's
    object; it lies there until another is laid, 0 N: none."""

    finger: Literal["A", "B", "C"]
    newtons: Newtons


class SimulatedCell:
    """World, gripper, board and arm on one time line; the world's own time starts at start_ns."""

    def __init__(self, settings: CellSettings, rng: np.random.Generator, start_ns: int = 0) -> None:
        self.gripper = GripperModel(settings.hand, start_ns)
        self.arm = ArmModel(settings.arm, start_ns)
        self.board = BoardModel(settings.board, self._latch)
        self._start_ns = self._now_ns = start_ns
        self._table_m: float | None = None  # height of the arm with its pads at the first mark
        self._arm_height_m, self._arm_rise_mps = self.arm.position(start_ns)[2], 0.0
        self.load(settings, rng)

    def load(self, settings: CellSettings, rng: np.random.Generator) -> None:
        """Another scene: object, contact and fingertips; no object is in place yet. The devices
        are those that the cell began with, wherever they stand."""
        surfaces = [surface_of(settings.body)] * FINGERS
        held = Held(SIDES, held_radps(settings.body))
        self.fingertips = Fingertips(in_a_grasp(settings.fingertip), surfaces, rng, held)
        self._laid_n = np.zeros(FINGERS)
        self.shaken = False  # something shakes the arm that is not its own motion
        self._damage = Damage(settings.damage, settings.fingertip.noise_counts, rng.spawn(1)[0])
        self._pull = Pull(settings.pull, self._now_ns)
        angle = math.radians(settings.fingertip.slip_direction_deg)
        self._frames = PadFrames.at(angle)
        self._turn = np.full(FINGERS, angle)  # the surface's x is the object's upwards
        self.contact = Contact(
            settings.contact, settings.body, settings.level, settings.impact_level
        )
        # views of the contact's state, and so always as it stands
        self._loads = FingerLoads(self.contact.normal_n, self.contact.stiffness_npm)
        self._offset_m = settings.finger_offset_m
        self._travel_m = self.gripper.travel_m + self._offset_m

    def place_object(self) -> None:
        """Put the object on the table between the fingers, which must be open: an activation
        closes the hand fully, so the object comes afterwards, as in the laboratory. The table is
        where the first one has its mark at the pads; an arm that stands higher by then is above
        the mark of the next."""
        if self._table_m is None:
            self._table_m = self._arm_height_m
        self.contact.place(self._arm_height_m - self._table_m)

    def tap(self, impact: Impact) -> None:
        """Strike the object. What an earlier impact moved is forgotten."""
        start_s = (self._now_ns - self._start_ns) * 1e-9 + impact.delay_s
        self.contact.strike(impact, start_s)

    def push(self, down_n: float) -> None:
        """A hand presses the object down from now on (up, below zero), until the next push."""
        self.contact.push(down_n, (self._now_ns - self._start_ns) * 1e-9)

    def press(self, by: PadPress) -> None:
        """A person presses a pad from now on."""
        until_s = (self._now_ns - self._start_ns) * 1e-9 + by.seconds
        self.fingertips.press(FINGER_NAMES.index(by.finger), by.taxel, by.newtons, until_s)

    def lay(self, weight: LaidWeight) -> None:
        """A weight on a pad, which alone feels it: object and hand do not."""
        self._laid_n[FINGER_NAMES.index(weight.finger)] = weight.newtons

    def advance(self, now_ns: int) -> None:
        """Advance everything to now_ns."""
        while self._now_ns < now_ns:
            end_ns = now_ns
            if self.gripper.moving and self._near(now_ns):
                end_ns = min(now_ns, self._now_ns + EXCHANGE_NS)
            self._advance_to(end_ns)

    def _near(self, until_ns: int) -> bool:
        """True when moving fingers could reach the object by then, or touch it now."""
        reach_m = CLOSING_MPS * (until_ns - self._now_ns) * 1e-9
        touched = bool(self.contact.normal_n.max() > 0.0)
        return touched or self.contact.clearance_m(self._travel_m) <= reach_m

    def _advance_to(self, end_ns: int) -> None:
        t0, t1 = self._now_ns, end_ns
        before, moved = self._travel_m, self.gripper.moving
        self.gripper.advance(t1, self._loads)
        if moved:
            self._travel_m = self.gripper.travel_m + self._offset_m
        self.arm.brake_if_unread(t1)
        height, rise_mps = self.arm.vertical(t1)
        self.contact.advance(
            (t0 - self._start_ns) * 1e-9, (t1 - t0) * 1e-9,
            height - self._arm_height_m, self._arm_rise_mps, rise_mps,
            before, self._travel_m,
        )  # fmt: skip
        self._arm_height_m, self._arm_rise_mps = height, rise_mps
        self.arm.commit(end_ns)
        self._now_ns = end_ns
        if self._pull.begins(end_ns, float(self.contact.state[laws.HEIGHT]), rise_mps):
            self.contact.pull(self._pull.settings, (end_ns - self._start_ns) * 1e-9)

    def _latch(self, t_ns: int) -> Callable[[], tuple[Codes, Codes]]:
        """What the pads are about to feel now; not all of it will be asked for."""
        return partial(
            self._sample, t_ns, self.contact.state.copy(), self.shaken or self._arm_rise_mps != 0.0
        )

    def _sample(self, t_ns: int, s: Floats, arm_moves: bool) -> tuple[Codes, Codes]:
        motion, turn, centre = self.contact.felt(s, self._frames)
        self.fingertips.advance(
            (t_ns - self._start_ns) * 1e-9, s[laws.NORMAL : laws.NORMAL + FINGERS] + self._laid_n,
            motion * 1e3, self._turn + turn, centre * 1e3, arm_moves,
        )  # fmt: skip
        pressure, temperature = self.fingertips.codes()
        return self._damage.felt(pressure).ravel(), temperature.ravel()

    def compile(self) -> None:
        """Run every compiled function once. The first time on a machine that takes seconds, which
        must have passed before a device has to answer."""
        self.contact.compile()
        self._near(self._now_ns + EXCHANGE_NS)
        self._advance_to(self._now_ns + EXCHANGE_NS)
        self._latch(self._now_ns)()

    def truth(self) -> Truth:
        """The state of the world at the time that it was last advanced to."""
        s = self.contact.state.tolist()
        return Truth(
            t_ns=self._now_ns, height_m=s[laws.HEIGHT], speed_mps=s[laws.SPEED],
            slip_distance_m=s[laws.SLIP], slip_speed_mps=s[laws.SLIP_SPEED],
            normal_n=_three(s, laws.NORMAL), shear_n=_three(s, laws.SHEAR),
            peak_n=_three(s, laws.PEAK), slip_onset_s=_time(s[laws.ONSET_S]),
            force_rise_s=_time(s[laws.RISE_S]), flank_slope=s[laws.SLOPE], across_m=s[laws.ACROSS],
            impact_s=s[laws.TAP_START_S] if s[laws.TAP_S] > 0.0 else None,
            moved_from_s=_time(s[laws.MOVED_FROM_S]), moved_until_s=_time(s[laws.MOVED_UNTIL_S]),
            turn_rad=s[laws.TURN], turn_speed_radps=s[laws.SPIN],
        )  # fmt: skip


class Pull:
    """Tells when the pull of a trial begins; it does so once."""

    def __init__(self, settings: PullSettings, now_ns: int) -> None:
        self.settings = settings
        self._since_ns = now_ns
        self._over = settings.force_n == 0.0

    def begins(self, now_ns: int, height_m: float, rise_mps: float) -> bool:
        """Take how high the object is and how fast the arm rises now."""
        if self._over:
            return False
        if rise_mps != 0.0 or height_m < self.settings.above_m:
            self._since_ns = now_ns
        self._over = now_ns - self._since_ns >= PULL_AFTER_S * 1e9
        return self._over


class Damage:
    """Changes what damaged fingertips read. Rest is taken for what they read first."""

    def __init__(
        self, settings: DamageSettings, noise_counts: float, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._kept = 1.0 - settings.gain_lost
        self._noise_counts = noise_counts * math.sqrt(1.0 - self._kept**2)  # what scaling takes
        self._whole = settings == DamageSettings()
        self._rng = rng
        self._first: Codes | None = None
        self._lost: NDArray[np.bool_] | None = None

    def felt(self, codes: Codes) -> Codes:
        """Codes (F, T) as the damaged fingertips give them."""
        if self._whole:
            return codes
        if self._first is None or self._lost is None:
            self._first, self._lost = codes.copy(), self._draw(*codes.shape)
        noise = self._noise_counts * self._rng.standard_normal(codes.shape)
        out = np.rint(self._first + self._kept * (codes - self._first) + noise)
        return np.where(self._lost, self._first, out.astype(np.int16))

    def _draw(self, fingers: int, taxels: int) -> NDArray[np.bool_]:
        lost = np.arange(taxels) < round(self._settings.taxels_lost * taxels)
        return np.stack([self._rng.permutation(lost) for _ in range(fingers)])


def surface_of(body: GraspObject) -> Surface:
    """What every pad touches, x upwards; an ellipsoid is round in its horizontal section."""
    curvature = (0.0, 0.0)
    if body.shape == "ellipsoid":
        curvature = (body.half_width_m / body.half_height_m**2 * 1e-3, 1e-3 / body.half_width_m)
    return Surface(
        curvature_per_mm=curvature,
        texture_rms_mm=body.texture_rms_m * 1e3, texture_length_mm=body.texture_length_m * 1e3,
        friction_static=body.friction_static, friction_kinetic=body.friction_kinetic,
    )  # fmt: skip


def _three(state: list[float], at: int) -> Vector3:
    return state[at], state[at + 1], state[at + 2]


def _time(t_s: float) -> float | None:
    return None if t_s == laws.NOT_YET else t_s
