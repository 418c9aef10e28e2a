"""What a person or the arm does to a held object: impacts of the mallet, touches, pulls, drags.

How hard is found on the contact law alone, for the object as drawn and held as firmly as it is
(`GripTrials`), as the mallet's own impact is (``scenarios.tap.mallet``); what it moves is measured.
"""

import copy
import math
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from grasp.loop import Tick
from grasp.states import State
from scenarios.acquire.labels import TURN_LEVER_M
from scenarios.tap.mallet import (
    AFTER_S,
    MOST_N_S,
    SETTLE_S,
    SettledGrasp,
    TapSettings,
    impact_of,
    settled_grasp,
)
from scenarios.world import laws
from scenarios.world.cell import SimulatedCell
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.objects import GraspObject
from scenarios.world.settings import ContactSettings, Impact, Level
from scenarios.world.truth import Truth

Kind = Literal["near", "mallet", "weak", "elastic", "shove", "touch", "pull", "drag", "shake"]
Direction = Literal["top", "side", "closing"]
Share = Annotated[float, Meta(gt=0.0)]  # in proportion to the others
# Force downwards, N, from seconds since it began and the truth; None: let go
Law = Callable[[float, Truth], float | None]

# Drawn evenly between these bounds unless it says otherwise; all assumed.
PAUSES_S = (0.35, 1.0)  # from the end of one disturbance to the next, and before the first
NEAR = (0.75, 1.25)  # of the impact that moves it JUST_M for good
WEAK = (0.05, 0.7)  # likewise, evenly in the logarithm
ELASTIC_M = (0.0004, 0.0009)  # out and back
BESIDE_M = 0.005  # deviation of where an impact lands
SHOVES_M, SHOVES_S = (0.001, 0.012), (0.06, 0.2)
TOUCH_SHARE, TOUCHES_S = (0.1, 0.9), (0.08, 1.0)  # peak, of what is left of friction
PULL_SHARE, RAMPS_S, PULLS_S = (0.2, 0.97), (0.02, 0.5), (0.1, 0.6)
DRAGS_MPS, DRAGS_M = (0.004, 0.06), (0.0015, 0.015)  # speeds evenly in the logarithm
SHAKE_SHARE, SHAKES_HZ, SHAKES_S = (0.1, 0.6), (2.0, 9.0), (0.5, 2.0)
# and for all impacts of a recording
DURATIONS_S, FOLLOWS, FOLLOWS_S = (0.004, 0.015), (0.0, 0.2), (0.02, 0.06)
SIDE_OFFSETS_M = (-0.02, 0.06)  # where impacts on the side land, above the grip

MOST_SHAKEN_MPS2 = 6.0
SPREAD, AIM_M = TapSettings().spread, TapSettings().aim_m
HAND_NPM, HAND_NSPM = 1500.0, 8.0  # of a person who drags: stiffness and damping of a hand
LETS_GO_M = 0.003  # a person who only pulls lets go when it moves
FADES, FADED_N = 0.7, 0.05  # of a force that is let go, from tick to tick; and where it ends
JUST_M = 0.001
LEFT_M = 0.0004  # at most, by elastic motion: less than the label `slip` takes for one
LEAST_N_S = 0.002
HALVINGS = 9  # of the logarithm: to 1.4 %
CURVE = np.geomspace(0.05, 1.0, 9)  # of the impulse that just moves it
LOOK_S, LOOKS = 0.001, 60  # at how far an impact moves it for a moment


class Disturbances(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is done to a held object in one recording."""

    number: Annotated[int, Meta(ge=1, le=100)]
    kinds: Annotated[dict[Kind, Share], Meta(min_length=1)]
    directions: Annotated[dict[Direction, Share], Meta(min_length=1)] = msgspec.field(
        default_factory=lambda: {"top": 0.5, "side": 0.5}
    )
    firm: bool = False  # by a full grip, not the first one
    turning: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # of the recordings: impacts may turn it


class Done(msgspec.Struct, frozen=True):
    """A disturbance, when it began, s since the cell began, and when it is or was over."""

    kind: str
    direction: str
    from_s: float
    until_s: float
    impulse_n_s: float = 0.0


class Performer:
    """Disturbs the object of a recording while it is held at the top; ``take`` follows a trial and
    says when all is done."""

    def __init__(
        self, asked: Disturbances, trials: "GripTrials", cell: SimulatedCell,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.done: list[Done] = []
        self._asked, self._trials, self._cell, self._rng = asked, trials, cell, rng
        self._due_s: float | None = None
        self._begun: Done | None = None
        self._law: Law | None = None  # of the force that acts now, until it is let go
        self._force_n: float | None = None  # None: an impact, or nothing

    def take(self, tick: Tick, truth: Truth | None) -> bool:
        """True when the object is to be set down."""
        if truth is None or tick.decision.state is not State.HOLD or tick.arm.moving:
            return False
        t_s = tick.t_ns * 1e-9
        if self._due_s is None:
            self._due_s = t_s + self._between(PAUSES_S)
        if self._begun is not None:
            self._go_on(self._begun, t_s, truth)
        elif t_s >= self._due_s:
            if len(self.done) == self._asked.number or not truth.touched:
                return True
            self._begin(t_s, truth)
        return False

    def _between(self, bounds: tuple[float, float]) -> float:
        return float(self._rng.uniform(*bounds))

    def _between_logarithms(self, bounds: tuple[float, float]) -> float:
        return math.exp(float(self._rng.uniform(*np.log(bounds))))

    def _one_of(self, shares: dict[Kind, float] | dict[Direction, float]) -> str:
        weights = np.array(list(shares.values()))
        return str(self._rng.choice(list(shares), p=weights / weights.sum()))

    def _begin(self, t_s: float, truth: Truth) -> None:
        kind, direction = self._one_of(self._asked.kinds), self._one_of(self._asked.directions)
        laws_of = {"shake": self._shaking, "pull": self._pulling, "drag": self._dragging}
        if kind in laws_of:
            self._cell.shaken = kind == "shake"
            self._law, self._force_n = laws_of[kind](truth.slip_distance_m), 0.0
            self._begun = Done(kind, "" if kind == "shake" else "top", t_s, t_s)
            return
        if kind == "shove" and direction == "closing":
            direction = "top"
        impact = self._struck(kind, direction)
        self._cell.tap(impact)
        until_s = t_s + impact.duration_s + impact.follow_s
        self._begun = Done(kind, direction, t_s, until_s, impact.impulse_n_s + impact.follow_n_s)

    def _go_on(self, begun: Done, t_s: float, truth: Truth) -> None:
        if self._force_n is not None:
            asked = self._law(t_s - begun.from_s, truth) if self._law is not None else None
            if asked is None:
                self._law, self._force_n = None, FADES * self._force_n
            else:
                self._force_n = asked
            if asked is None and abs(self._force_n) <= FADED_N:
                self._force_n = None
            self._cell.push(self._force_n or 0.0)
            if self._force_n is not None:
                return
        elif t_s < begun.until_s:
            return
        self._begun, self._cell.shaken = None, False
        self.done.append(msgspec.structs.replace(begun, until_s=t_s))
        self._due_s = t_s + self._between(PAUSES_S)

    def _struck(self, kind: str, direction: str) -> Impact:
        rng, trials = self._rng, self._trials
        if kind == "touch":
            peak_n = self._between(TOUCH_SHARE) * trials.spare_n(direction)
            return pressed(direction, peak_n, self._between(TOUCHES_S))
        if kind == "shove":
            return trials.shove(direction, self._between(SHOVES_M), self._between(SHOVES_S))
        known = trials.impulses(direction)
        hard = {
            "near": lambda: known.just * self._between(NEAR),
            "weak": lambda: known.just * self._between_logarithms(WEAK),
            "mallet": lambda: known.aim * max(1.0 + SPREAD * float(rng.standard_normal()), 0.0),
            "elastic": lambda: trials.elastic(direction, self._between(ELASTIC_M)),
        }[kind]()
        beside_m = float(np.clip(rng.standard_normal(), -2.5, 2.5)) * BESIDE_M
        return trials.impact(direction, min(hard, MOST_N_S), beside_m)

    def _pulling(self, from_m: float) -> Law:
        """Up to a share of what friction still bears, for a while, and let go."""
        peak_n = self._between(PULL_SHARE) * self._trials.spare_down_n
        ramp_s, lasts_s = self._between(RAMPS_S), self._between(PULLS_S)

        def law(since_s: float, now: Truth) -> float | None:
            left = 2 * ramp_s + lasts_s - since_s
            if left <= 0.0 or abs(now.slip_distance_m - from_m) > LETS_GO_M:
                return None
            return peak_n * min(1.0, since_s / ramp_s, left / ramp_s)

        return law

    def _dragging(self, from_m: float) -> Law:
        """A hand that goes down at a steady speed and takes the object along, so far."""
        speed_mps, way_m = self._between_logarithms(DRAGS_MPS), self._between(DRAGS_M)
        most_n, longest_s = 2.0 * self._trials.spare_down_n, 2.0 * way_m / speed_mps + 1.0

        def law(since_s: float, now: Truth) -> float | None:
            gone_m = now.slip_distance_m - from_m
            if gone_m >= way_m or since_s > longest_s:
                return None
            pull_n = HAND_NPM * (speed_mps * since_s - gone_m)
            pull_n += HAND_NSPM * (speed_mps - now.slip_speed_mps)
            return min(max(pull_n, 0.0), most_n)

        return law

    def _shaking(self, from_m: float) -> Law:
        """What the object's inertia asks of the grip while the arm is shaken up and down."""
        mass_kg = self._trials.body.mass_kg
        share = self._between(SHAKE_SHARE)
        peak_n = min(share * self._trials.spare_down_n, MOST_SHAKEN_MPS2 * mass_kg)
        hertz, lasts_s = self._between(SHAKES_HZ), self._between(SHAKES_S)

        def law(since_s: float, now: Truth) -> float | None:
            if since_s >= lasts_s or abs(now.slip_distance_m - from_m) > LETS_GO_M:
                return None
            return peak_n * math.sin(2 * math.pi * hertz * since_s)

        return law


class Impulses(msgspec.Struct, frozen=True):
    """Of impacts in one direction, N s."""

    just: float  # moves it JUST_M for good
    aim: float  # and the mallet's aim
    furthest_m: tuple[float, ...]  # at CURVE times `just`
    moved_m: tuple[float, ...]


class GripTrials:
    """The object in a grip, on which impacts are tried before they are struck."""

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
        self._held: dict[Level, SettledGrasp] = {}
        self._known: dict[str, Impulses] = {}
        friction_n, weight_n = body.friction_static * sum(grip_n), body.mass_kg * GRAVITY_MPS2
        self.spare_down_n = max(friction_n - weight_n, 0.0)
        self.spare_aside_n = math.sqrt(max(friction_n**2 - weight_n**2, 0.0))

    def spare_n(self, direction: str) -> float:
        """What friction still bears that way beside the weight; along the closing axis, of the two
        fingers that a push unloads."""
        whole = {"top": self.spare_down_n, "side": self.spare_aside_n}
        return whole.get(direction, 0.5 * self._grip_n[0])

    def impact(self, direction: str, impulse_n_s: float, beside_m: float = 0.0) -> Impact:
        """The recording's own mallet, so hard."""
        return impact_of(self._mallet, direction, impulse_n_s, 0.0, beside_m)

    def impulses(self, direction: str) -> Impulses:
        """Searched once; along the closing axis as hard as on the top, as the mallet does."""
        way = "top" if direction == "closing" else direction
        if way not in self._known:
            self._known[way] = self._searched(way)
        return self._known[way]

    def _searched(self, way: str) -> Impulses:
        def moved(impulse_n_s: float) -> float:
            return self.tried(self.impact(way, impulse_n_s))[1]

        just = least(lambda j: moved(j) >= JUST_M, LEAST_N_S, MOST_N_S)
        aim = least(lambda j: moved(j) >= AIM_M, just, min(4 * just, MOST_N_S))
        tries = [self.tried(self.impact(way, part * just)) for part in CURVE.tolist()]
        furthest, left = zip(*tries, strict=True)
        return Impulses(just, aim, furthest, left)

    def tried(self, impact: Impact) -> tuple[float, float]:
        """How far the object is at most, m, and for good; both infinite where it is lost."""
        level = Level.SPIN if self._turns or impact.direction == "side" else Level.SLIDER
        if level not in self._held:
            self._held[level] = settled_grasp(self.body, self._hand, self._grip_n, level)
        trial = copy.deepcopy(self._held[level])
        before = _place(trial)
        trial.contact.strike(impact, SETTLE_S)
        furthest = 0.0
        for i in range(LOOKS):
            trial.wait(SETTLE_S + i * LOOK_S, LOOK_S)
            furthest = max(furthest, float(np.linalg.norm(_place(trial) - before)))
        trial.wait(SETTLE_S + LOOKS * LOOK_S, AFTER_S - LOOKS * LOOK_S)
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

    def shove(self, direction: str, moved_m: float, lasts_s: float) -> Impact:
        """A push of a hand that takes so long and moves it so far for good, as searched."""
        spare_n = self.spare_n(direction)

        def moves(force_n: float) -> bool:
            return self.tried(pressed(direction, force_n, lasts_s))[1] >= moved_m

        return pressed(direction, least(moves, 0.5 * spare_n, 4.0 * spare_n), lasts_s)


def _place(held: SettledGrasp) -> np.ndarray:
    s = held.contact.state
    return np.array([s[laws.SLIP], s[laws.ACROSS], TURN_LEVER_M * s[laws.TURN]])


def least(enough: Callable[[float], bool], low: float, high: float) -> float:
    """The least that is enough, between bounds, by halving the logarithm; the upper bound where
    nothing is."""
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def pressed(direction: str, peak_n: float, lasts_s: float) -> Impact:
    """A half sine of force; as a mallet's follow-through, since it may last."""
    carried_n_s = 2.0 / math.pi * peak_n * lasts_s
    table = {
        "direction": direction, "impulse_n_s": 0.0, "duration_s": 0.001,
        "follow_n_s": min(carried_n_s, 5.0), "follow_s": lasts_s,
    }  # fmt: skip
    return msgspec.convert(table, Impact)
