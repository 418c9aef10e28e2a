"""An object in a grip: acts are tried on the contact law alone before a recording has them."""

import copy
import math
from collections.abc import Callable

import msgspec
import numpy as np

from scenarios.acquire.rest import TURN_LEVER_M
from scenarios.tap.config import TapSettings
from scenarios.tap.mallet import AFTER_S, MOST_N_S, SETTLE_S, Held, blow_of, held_at
from scenarios.world import laws
from scenarios.world.blow import Blow
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.objects import GraspObject
from scenarios.world.world_settings import Level

# Drawn evenly between these bounds, of a recording's blows; assumed.
DURATIONS_S, FOLLOWS, FOLLOWS_S = (0.004, 0.015), (0.0, 0.2), (0.02, 0.06)
SIDE_OFFSETS_M = (-0.02, 0.06)  # where blows on the side land, above the grip
JUST_M = 0.001
LEFT_M = 0.0004  # at most, by elastic motion: less than the label `slip` takes for one
AIM_M = TapSettings().aim_m
LEAST_N_S = 0.002
HALVINGS = 9  # of the logarithm: to 1.4 %
CURVE = np.geomspace(0.05, 1.0, 9)  # of the impulse that just moves it
LOOK_S, LOOKS = 0.001, 60  # at how far a blow moves it for a moment


class Impulses(msgspec.Struct, frozen=True):
    """Of blows in one direction, N s."""

    just: float  # moves it JUST_M for good
    aim: float  # and the mallet's aim
    furthest_m: tuple[float, ...]  # at CURVE times `just`
    moved_m: tuple[float, ...]


class Bench:
    """The object in a grip, on which blows are tried before they are struck."""

    def __init__(
        self, body: GraspObject, hand: ContactSettings, grip_n: tuple[float, float, float],
        turns: bool, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.body, self._hand, self._grip_n, self._turns = body, hand, grip_n, turns
        self._mallet = TapSettings(
            duration_s=float(rng.uniform(*DURATIONS_S)),
            follow_fraction=float(rng.uniform(*FOLLOWS)), follow_s=float(rng.uniform(*FOLLOWS_S)),
            side_offset_m=float(rng.uniform(*SIDE_OFFSETS_M)),
        )  # fmt: skip
        self._held: dict[Level, Held] = {}
        self._known: dict[str, Impulses] = {}
        friction_n, weight_n = body.friction_static * sum(grip_n), body.mass_kg * GRAVITY_MPS2
        self.spare_down_n = max(friction_n - weight_n, 0.0)
        self.spare_aside_n = math.sqrt(max(friction_n**2 - weight_n**2, 0.0))

    def spare_n(self, direction: str) -> float:
        """What friction still bears that way beside the weight; along the closing axis, of the two
        fingers that a push unloads."""
        whole = {"top": self.spare_down_n, "side": self.spare_aside_n}
        return whole.get(direction, 0.5 * self._grip_n[0])

    def blow(self, direction: str, impulse_n_s: float, beside_m: float = 0.0) -> Blow:
        """The recording's own mallet, so hard."""
        return blow_of(self._mallet, direction, impulse_n_s, 0.0, beside_m)

    def impulses(self, direction: str) -> Impulses:
        """Searched once; along the closing axis as hard as on the top, as the mallet does."""
        way = "top" if direction == "closing" else direction
        if way not in self._known:
            self._known[way] = self._searched(way)
        return self._known[way]

    def _searched(self, way: str) -> Impulses:
        def moved(impulse_n_s: float) -> float:
            return self.tried(self.blow(way, impulse_n_s))[1]

        just = least(lambda j: moved(j) >= JUST_M, LEAST_N_S, MOST_N_S)
        aim = least(lambda j: moved(j) >= AIM_M, just, min(4 * just, MOST_N_S))
        tries = [self.tried(self.blow(way, part * just)) for part in CURVE.tolist()]
        furthest, left = zip(*tries, strict=True)
        return Impulses(just, aim, furthest, left)

    def tried(self, blow: Blow) -> tuple[float, float]:
        """How far the object is at most, m, and for good; both infinite where it is lost."""
        level = Level.SPIN if self._turns or blow.direction == "side" else Level.SLIDER
        if level not in self._held:
            self._held[level] = held_at(self.body, self._hand, self._grip_n, level)
        trial = copy.deepcopy(self._held[level])
        before = _place(trial)
        trial.contact.strike(blow, SETTLE_S)
        furthest = 0.0
        for i in range(LOOKS):
            trial.waits(SETTLE_S + i * LOOK_S, LOOK_S)
            furthest = max(furthest, float(np.linalg.norm(_place(trial) - before)))
        trial.waits(SETTLE_S + LOOKS * LOOK_S, AFTER_S - LOOKS * LOOK_S)
        if trial.contact.state[laws.NORMAL] <= 0.0:
            return math.inf, math.inf
        moved = float(np.linalg.norm(_place(trial) - before))
        return max(furthest, moved), moved

    def elastic(self, direction: str, furthest_m: float) -> float:
        """Impulse that moves it so far for a moment, or as far as leaves it nearly where it was."""
        known = self.impulses(direction)
        part = min(
            float(np.interp(furthest_m, known.furthest_m, CURVE)),
            float(np.interp(LEFT_M, known.moved_m, CURVE)),
        )
        return known.just * part

    def shove(self, direction: str, moved_m: float, lasts_s: float) -> Blow:
        """A push of a hand that takes so long and moves it so far for good, as searched."""
        spare_n = self.spare_n(direction)

        def moves(force_n: float) -> bool:
            return self.tried(pressed(direction, force_n, lasts_s))[1] >= moved_m

        force_n = least(moves, 0.5 * spare_n, 4.0 * spare_n)
        return pressed(direction, force_n, lasts_s)


def _place(held: Held) -> np.ndarray:
    s = held.contact.state
    return np.array([s[laws.SLIP], s[laws.ACROSS], TURN_LEVER_M * s[laws.TURN]])


def least(enough: Callable[[float], bool], low: float, high: float) -> float:
    """The least that is enough, between bounds, by halving the logarithm; the upper bound where
    nothing is."""
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def pressed(direction: str, peak_n: float, lasts_s: float) -> Blow:
    """A half sine of force; as a mallet's follow-through, since it may last."""
    carried_n_s = 2.0 / math.pi * peak_n * lasts_s
    table = {
        "direction": direction, "impulse_n_s": 0.0, "duration_s": 0.001,
        "follow_n_s": min(carried_n_s, 5.0), "follow_s": lasts_s,
    }  # fmt: skip
    return msgspec.convert(table, Blow)
