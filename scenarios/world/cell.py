"""The simulated cell: one world joined to the three device models, advanced to any later instant.

Between commands the world advances in one compiled call. While a finger moves near the object,
gripper model and contact law exchange forces every millisecond; each integrates in finer steps.
"""

import math
from collections.abc import Callable
from operator import itemgetter
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CODE_MAX, FINGER_NAMES
from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings
from drivers.takktile.model.board import BoardModel
from drivers.takktile.settings import BoardModelSettings
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings
from scenarios.world import laws
from scenarios.world.contact import FINGERS, Contact, Floats, PadFrames, held_object_radps
from scenarios.world.fingertip import Codes, Fingertips, HeldObject
from scenarios.world.objects import GraspObject, within
from scenarios.world.settings import (
    ContactSettings,
    DamageSettings,
    FingertipSettings,
    Impact,
    Level,
    PullSettings,
    Surface,
    settings_in_grasp,
)
from scenarios.world.truth import Truth

EXCHANGE_NS = 1_000_000
SIDES = np.array([1.0, -1.0, -1.0])  # side of the object of each finger; the thumb opposes B and C
PULL_AFTER_S = 0.2  # time for which the arm has stood still in the air; assumed
CLOSING_MPS = 0.22  # closing speed of thumb and opposing fingers together, at most

# entries of the contact's state that the truth consists of
_TRUE_STATE = itemgetter(
    laws.HEIGHT, laws.SPEED, laws.SLIP, laws.SLIP_SPEED,
    *(first + i for first in (laws.NORMAL, laws.SHEAR, laws.PEAK) for i in range(FINGERS)),
    laws.ONSET_S, laws.RISE_S, laws.SLOPE, laws.ACROSS, laws.TAP_START_S, laws.TAP_S,
    laws.MOVED_FROM_S, laws.MOVED_UNTIL_S, laws.TURN, laws.SPIN,
)  # fmt: skip


Newtons = Annotated[float, within(0.0, 50.0)]


class CellSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of all parts of the cell."""

    body: GraspObject
    contact: ContactSettings
    fingertip: FingertipSettings
    hand: HandSettings
    board: BoardModelSettings
    arm: ArmModelSettings
    finger_offset_m: Floats  # (3,) true travel of each finger minus the commanded one
    pull: PullSettings = PullSettings()
    damage: DamageSettings = DamageSettings()
    level: Level = Level.SLIDER
    impact_level: Level | None = None  # while an impact moves the object; None: as level


class PadPress(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Press of a person's finger on one taxel of an open hand, to identify it."""

    finger: Literal["A", "B", "C"]
    taxel: Annotated[int, within(0, 10_000)]
    newtons: Newtons = 1.0
    seconds: Annotated[float, within(0.0, 60.0)] = 1.0


class PadWeight(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Weight on one pad of an open hand, curved like the scene's object. It stays until the next
    one; 0 N removes it."""

    finger: Literal["A", "B", "C"]
    newtons: Newtons


class SimulatedCell:
    """World, gripper, board and arm on one time line; world time starts at start_ns."""

    def __init__(self, settings: CellSettings, rng: np.random.Generator, start_ns: int = 0) -> None:
        self.gripper = GripperModel(settings.hand, start_ns)
        self.arm = ArmModel(settings.arm, start_ns)
        self.board = BoardModel(settings.board, self._latch)
        self._start_ns = self._now_ns = start_ns
        self._table_m: float | None = None  # arm height with the pads at the first object's mark
        self._arm_height_m, self._arm_rise_mps = self.arm.at(start_ns).position_m[2], 0.0
        self.load(settings, rng)

    def load(self, settings: CellSettings, rng: np.random.Generator) -> None:
        """Load another scene: object, contact and fingertips. The object is not in place yet; the
        devices stay as they are."""
        surfaces = [surface_of(settings.body)] * FINGERS
        held = HeldObject(SIDES, held_object_radps(settings.body))
        self.fingertips = Fingertips(settings_in_grasp(settings.fingertip), surfaces, rng, held)
        self._weights_n = np.zeros(FINGERS)
        self.shaken = False  # an external disturbance shakes the arm
        self._damage = TaxelDamage(
            settings.damage, settings.fingertip.noise_counts, rng.spawn(1)[0]
        )
        self._pull = PullTrigger(settings.pull, self._now_ns)
        # the surface's x is the object's upwards
        self._frames = PadFrames.at(math.radians(settings.fingertip.slip_direction_deg))
        self.contact = Contact(
            settings.contact, settings.body, settings.level, settings.impact_level
        )
        self._offset_m = settings.finger_offset_m
        self._travel_m = self.gripper.travel_m + self._offset_m

    def place_object(self) -> None:
        """Put the object on the table between the fingers, which must be open: activation closes
        the hand fully, so the object is placed afterwards. At the table's height the first object
        has its grip mark at the pads; with a higher arm the pads are above a later object's."""
        if self._table_m is None:
            self._table_m = self._arm_height_m
        self.contact.place(self._arm_height_m - self._table_m)

    def tap(self, impact: Impact) -> None:
        """Strike the object; resets the record of the previous impact."""
        start_s = (self._now_ns - self._start_ns) * 1e-9 + impact.delay_s
        self.contact.strike(impact, start_s)

    def push(self, down_n: float) -> None:
        """Press the object down with a steady force (negative: up) until the next push."""
        self.contact.push(down_n, (self._now_ns - self._start_ns) * 1e-9)

    def press(self, press: PadPress) -> None:
        """Press a pad from now on."""
        until_s = (self._now_ns - self._start_ns) * 1e-9 + press.seconds
        self.fingertips.press(FINGER_NAMES.index(press.finger), press.taxel, press.newtons, until_s)

    def put_weight(self, weight: PadWeight) -> None:
        """Put a weight on a pad; it loads neither object nor hand."""
        self._weights_n[FINGER_NAMES.index(weight.finger)] = weight.newtons

    def advance(self, now_ns: int) -> None:
        """Advance everything to now_ns."""
        gripper = self.gripper
        while self._now_ns < now_ns:
            t_ns, end_ns = self._now_ns, now_ns
            before_m = self._travel_m
            if gripper.moving:
                reach_m = CLOSING_MPS * (now_ns - t_ns) * 1e-9
                if self.contact.clearance_m(before_m) <= reach_m:
                    end_ns = min(now_ns, t_ns + EXCHANGE_NS)
                s = self.contact.state
                loads = FingerLoads(s[laws.NORMAL : laws.NORMAL + FINGERS], s[laws.STIFFNESS :])
                gripper.advance(end_ns, loads)
                self._travel_m = gripper.travel_m + self._offset_m
            else:
                gripper.advance(end_ns)
            (_, _, height_m), (_, _, rise_mps), _ = self.arm.advance(end_ns)
            self.contact.advance(
                (t_ns - self._start_ns) * 1e-9, (end_ns - t_ns) * 1e-9,
                height_m - self._arm_height_m, self._arm_rise_mps, rise_mps,
                before_m, self._travel_m,
            )  # fmt: skip
            self._arm_height_m, self._arm_rise_mps = height_m, rise_mps
            self._now_ns = end_ns
            if self._pull.waits:
                self._begin_pull()

    def _begin_pull(self) -> None:
        """Begin the pull if it is due."""
        height_m = float(self.contact.state[laws.HEIGHT])
        if self._pull.begins(self._now_ns, height_m, self._arm_rise_mps):
            self.contact.pull(self._pull.settings, (self._now_ns - self._start_ns) * 1e-9)

    def _latch(self, t_ns: int) -> Callable[[], tuple[Codes, Codes]]:
        """Sampling function for the contact state of now; evaluated only if the board reads it, and
        before the next one."""
        arm_moves = self.shaken or self._arm_rise_mps != 0.0
        self._latched = t_ns, self.contact.state.copy(), arm_moves
        return self._sample

    def _sample(self) -> tuple[Codes, Codes]:
        t_ns, s, arm_moves = self._latched
        motion_mm, turn, centre_mm = self.contact.surface_motion(s, self._frames)
        self.fingertips.advance(
            (t_ns - self._start_ns) * 1e-9,
            s[laws.NORMAL : laws.NORMAL + FINGERS] + self._weights_n,
            motion_mm, turn, centre_mm, arm_moves,
        )  # fmt: skip
        pressure, temperature = self.fingertips.codes()
        return self._damage.apply(pressure).ravel(), temperature.ravel()

    def compile(self) -> None:
        """Run every compiled function once. The first run on a machine takes seconds, so it must
        finish before a device has to reply."""
        self.contact.clearance_m(self._travel_m)
        self.advance(self._now_ns + EXCHANGE_NS)
        self._latch(self._now_ns)()

    def truth(self) -> Truth:
        """The state of the world at the time that it was last advanced to."""
        (
            height_m, speed_mps, slip_m, slip_mps, a_n, b_n, c_n, a_shear_n, b_shear_n, c_shear_n,
            a_peak_n, b_peak_n, c_peak_n, onset_s, rise_s, slope, across_m, tap_start_s, tap_s,
            moved_from_s, moved_until_s, turn_rad, spin_radps,
        ) = _TRUE_STATE(self.contact.state.tolist())  # fmt: skip
        return Truth(
            self._now_ns, height_m, speed_mps, slip_m, slip_mps, (a_n, b_n, c_n),
            (a_shear_n, b_shear_n, c_shear_n), (a_peak_n, b_peak_n, c_peak_n),
            None if onset_s == laws.NOT_YET else onset_s,
            None if rise_s == laws.NOT_YET else rise_s,
            slope, across_m, tap_start_s if tap_s > 0.0 else None,
            None if moved_from_s == laws.NOT_YET else moved_from_s,
            None if moved_until_s == laws.NOT_YET else moved_until_s, turn_rad, spin_radps,
        )  # fmt: skip


class PullTrigger:
    """Decides when the pull of a trial begins."""

    def __init__(self, settings: PullSettings, now_ns: int) -> None:
        self.settings = settings
        self._since_ns = now_ns
        self.waits = settings.force_n != 0.0

    def begins(self, now_ns: int, height_m: float, rise_mps: float) -> bool:
        """True once: when the object, at height_m, has stayed up for PULL_AFTER_S with the arm,
        whose vertical speed is rise_mps, at rest."""
        if not self.waits:
            return False
        if rise_mps != 0.0 or height_m < self.settings.above_m:
            self._since_ns = now_ns
        self.waits = now_ns - self._since_ns < PULL_AFTER_S * 1e9
        return not self.waits


class TaxelDamage:
    """Applies damage to tactile codes; the first sample counts as rest."""

    def __init__(
        self, settings: DamageSettings, noise_counts: float, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._gain = 1.0 - settings.gain_lost
        self._noise_counts = noise_counts * math.sqrt(1.0 - self._gain**2)  # that the gain removes
        self._undamaged = settings == DamageSettings()
        self._rng = rng
        self._first: Codes | None = None
        self._lost: NDArray[np.bool_] | None = None

    def apply(self, codes: Codes) -> Codes:
        """Codes (F, T) of the damaged fingertips."""
        if self._undamaged:
            return codes
        if self._first is None or self._lost is None:
            self._first, self._lost = codes.copy(), self._choose_lost_taxels(*codes.shape)
        noise = self._noise_counts * self._rng.standard_normal(codes.shape)
        exact = self._first + self._gain * (codes - self._first) + noise
        out = np.clip(np.rint(exact), 0, CODE_MAX).astype(np.int16)
        return np.where(self._lost, self._first, out)

    def _choose_lost_taxels(self, fingers: int, taxels: int) -> NDArray[np.bool_]:
        lost = np.arange(taxels) < round(self._settings.taxels_lost * taxels)
        return np.stack([self._rng.permutation(lost) for _ in range(fingers)])


def surface_of(body: GraspObject) -> Surface:
    """Surface of the object at every pad, x upwards; horizontal sections of an ellipsoid are
    circles."""
    curvature = (0.0, 0.0)
    if body.shape == "ellipsoid":
        curvature = (body.half_width_m / body.half_height_m**2 * 1e-3, 1e-3 / body.half_width_m)
    return Surface(
        curvature_per_mm=curvature,
        texture_rms_mm=body.texture_rms_m * 1e3, texture_length_mm=body.texture_length_m * 1e3,
        friction_static=body.friction_static, friction_kinetic=body.friction_kinetic,
    )  # fmt: skip
