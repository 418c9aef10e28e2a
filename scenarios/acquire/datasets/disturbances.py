"""Disturbances of a held object by a person or the arm: mallet impacts, touches, pulls, drags.

Their strength is found by simulating the contact law alone for the random object and its grip
(`GripTrials`), as for the mallet (``scenarios.tap.mallet``). The recording measures their effect.
"""

import copy
import math
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from detector.recordings import MOVED_M
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.acquire.labels import TURN_LEVER_M
from scenarios.tap.config import TapSettings
from scenarios.tap.mallet import AFTER_S, MOST_N_S, SETTLE_S, SettledGrasp, impact_of, settled_grasp
from scenarios.world import laws
from scenarios.world.cell import SimulatedCell
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.objects import GraspObject
from scenarios.world.settings import ContactSettings, Impact, Level
from scenarios.world.truth import Truth

Kind = Literal["near", "mallet", "weak", "elastic", "shove", "touch", "pull", "drag", "shake"]
Direction = Literal["top", "side", "closing"]
Share = Annotated[float, Meta(gt=0.0)]  # in proportion to the others
# Force downwards, N, as a function of seconds since its start and the truth; None: let go
ForceProfile = Callable[[float, Truth], float | None]

# Uniform between these bounds unless stated otherwise; all assumed.
PAUSE_S = (0.35, 1.0)  # between disturbances, and before the first
NEAR = (0.75, 1.25)  # over the impulse with a lasting displacement of MOVED_M
WEAK_SHARE = (0.05, 0.7)  # likewise, log-uniform
ELASTIC_M = (0.0004, 0.0009)  # largest displacement of an elastic motion
OFFSET_DEVIATION_M = 0.005  # standard deviation of the point of impact
SHOVES_M, SHOVES_S = (0.001, 0.012), (0.06, 0.2)
TOUCH_SHARE, TOUCHES_S = (0.1, 0.9), (0.08, 1.0)  # peak over the friction reserve
PULL_SHARE, RAMPS_S, PULLS_S = (0.2, 0.97), (0.02, 0.5), (0.1, 0.6)
SHAKE_SHARE, SHAKES_HZ, SHAKES_S = (0.1, 0.6), (2.0, 9.0), (0.5, 2.0)
# and for all impacts of a recording
DURATIONS_S, FOLLOWS, FOLLOWS_S = (0.004, 0.015), (0.0, 0.2), (0.02, 0.06)
SIDE_OFFSETS_M = (-0.02, 0.06)  # height of impacts on the side above the grip

MAX_SHAKE_MPS2 = 6.0
SPREAD, AIM_M = TapSettings().spread, TapSettings().aim_m
HAND_NPM, HAND_NSPM = 1500.0, 8.0  # stiffness and damping of the hand of a person who drags
LET_GO_M = 0.003  # displacement at which a person who pulls lets go
FADE_FACTOR, FADE_END_N = 0.7, 0.05  # decay of a force per tick after letting go, and its end
MAX_LASTING_M = 0.0004  # of an elastic motion: below the bound of the label `slip`
MIN_IMPULSE_N_S = 0.002
HALVINGS = 9  # of the logarithm: to 1.4 %
CURVE = np.geomspace(0.05, 1.0, 9)  # impulses over the one that moves the object MOVED_M
SAMPLE_S, IMPACT_SAMPLES = 0.001, 60  # sampling of the largest displacement of an impact


class DisturbanceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Disturbances of the held object in one recording."""

    number: Annotated[int, Meta(ge=1, le=100)]
    kinds: Annotated[dict[Kind, Share], Meta(min_length=1)]
    directions: Annotated[dict[Direction, Share], Meta(min_length=1)] = msgspec.field(
        default_factory=lambda: {"top": 0.5, "side": 0.5}
    )
    firm: bool = False  # True: full grip; False: first grip
    turning: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # share of recordings with rotation
    drag_mps: tuple[float, float] = (0.004, 0.06)  # log-uniform
    drag_m: tuple[float, float] = (0.0015, 0.015)

    def __post_init__(self) -> None:
        for name, (low, high) in (("drag_mps", self.drag_mps), ("drag_m", self.drag_m)):
            if not 0.0 < low <= high:
                raise ValueError(f"{name}: {low:g} to {high:g} is not a range above 0")


class TimedDisturbance(msgspec.Struct, frozen=True):
    """A disturbance with its start and end, s since the start of the cell."""

    kind: str
    direction: str
    from_s: float
    until_s: float
    impulse_n_s: float = 0.0


class Performer:
    """Applies disturbances to the object while it is held at the top: call ``take`` each tick."""

    def __init__(
        self, settings: DisturbanceSettings, trials: "GripTrials", cell: SimulatedCell,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.done: list[TimedDisturbance] = []
        self._settings, self._trials, self._cell, self._rng = settings, trials, cell, rng
        self._due_s: float | None = None
        self._current: TimedDisturbance | None = None
        self._profile: ForceProfile | None = None  # of the present force; None: fading
        self._force_n: float | None = None  # None: an impact, or no disturbance

    def take(self, tick: Tick, truth: Truth | None) -> bool:
        """Returns True when all disturbances are done and the object can be set down."""
        if truth is None or tick.decision.state is not State.HOLD or tick.arm.moving:
            return False
        t_s = tick.t_ns * 1e-9
        if self._due_s is None:
            self._due_s = t_s + self._between(PAUSE_S)
        if self._current is not None:
            self._continue(self._current, t_s, truth)
        elif t_s >= self._due_s:
            if len(self.done) == self._settings.number or not truth.touched:
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
        settings = self._settings
        kind, direction = self._one_of(settings.kinds), self._one_of(settings.directions)
        profiles = {"shake": self._shaking, "pull": self._pulling, "drag": self._dragging}
        if kind in profiles:
            self._cell.shaken = kind == "shake"
            self._profile, self._force_n = profiles[kind](truth.slip_distance_m), 0.0
            self._current = TimedDisturbance(kind, "" if kind == "shake" else "top", t_s, t_s)
            return
        if kind == "shove" and direction == "closing":
            direction = "top"
        impact = self._impact(kind, direction)
        self._cell.tap(impact)
        until_s = t_s + impact.duration_s + impact.follow_s
        impulse_n_s = impact.impulse_n_s + impact.follow_n_s
        self._current = TimedDisturbance(kind, direction, t_s, until_s, impulse_n_s)

    def _continue(self, current: TimedDisturbance, t_s: float, truth: Truth) -> None:
        if self._force_n is not None:
            profile, since_s = self._profile, t_s - current.from_s
            target_n = profile(since_s, truth) if profile is not None else None
            if target_n is None:
                self._profile, self._force_n = None, FADE_FACTOR * self._force_n
            else:
                self._force_n = target_n
            if target_n is None and abs(self._force_n) <= FADE_END_N:
                self._force_n = None
            self._cell.push(self._force_n or 0.0)
            if self._force_n is not None:
                return
        elif t_s < current.until_s:
            return
        self._current, self._cell.shaken = None, False
        self.done.append(msgspec.structs.replace(current, until_s=t_s))
        self._due_s = t_s + self._between(PAUSE_S)

    def _impact(self, kind: str, direction: str) -> Impact:
        rng, trials = self._rng, self._trials
        if kind == "touch":
            peak_n = self._between(TOUCH_SHARE) * trials.friction_reserve_n(direction)
            return half_sine_push(direction, peak_n, self._between(TOUCHES_S))
        if kind == "shove":
            return trials.shove(direction, self._between(SHOVES_M), self._between(SHOVES_S))
        impulses = trials.impulses(direction)
        impulse_n_s = {
            "near": lambda: impulses.threshold * self._between(NEAR),
            "weak": lambda: impulses.threshold * self._between_logarithms(WEAK_SHARE),
            "mallet": lambda: impulses.mallet * max(1.0 + SPREAD * rng.standard_normal(), 0.0),
            "elastic": lambda: trials.elastic(direction, self._between(ELASTIC_M)),
        }[kind]()
        offset_m = float(np.clip(rng.standard_normal(), -2.5, 2.5)) * OFFSET_DEVIATION_M
        return trials.impact(direction, min(impulse_n_s, MOST_N_S), offset_m)

    def _pulling(self, from_m: float) -> ForceProfile:
        """Pull with a share of the friction reserve for a time, then let go."""
        peak_n = self._between(PULL_SHARE) * self._trials.down_reserve_n
        ramp_s, lasts_s = self._between(RAMPS_S), self._between(PULLS_S)

        def profile(since_s: float, now: Truth) -> float | None:
            left = 2 * ramp_s + lasts_s - since_s
            if left <= 0.0 or abs(now.slip_distance_m - from_m) > LET_GO_M:
                return None
            return peak_n * min(1.0, since_s / ramp_s, left / ramp_s)

        return profile

    def _dragging(self, from_m: float) -> ForceProfile:
        """Drag by a hand that moves down at constant speed, over a random distance."""
        settings = self._settings
        speed_mps = self._between_logarithms(settings.drag_mps)
        distance_m = self._between(settings.drag_m)
        max_n, max_s = 2.0 * self._trials.down_reserve_n, 2.0 * distance_m / speed_mps + 1.0

        def profile(since_s: float, now: Truth) -> float | None:
            dragged_m = now.slip_distance_m - from_m
            if dragged_m >= distance_m or since_s > max_s:
                return None
            pull_n = HAND_NPM * (speed_mps * since_s - dragged_m)
            pull_n += HAND_NSPM * (speed_mps - now.slip_speed_mps)
            return min(max(pull_n, 0.0), max_n)

        return profile

    def _shaking(self, from_m: float) -> ForceProfile:
        """Inertial force of the object while the arm vibrates up and down."""
        mass_kg = self._trials.body.mass_kg
        share = self._between(SHAKE_SHARE)
        peak_n = min(share * self._trials.down_reserve_n, MAX_SHAKE_MPS2 * mass_kg)
        hertz, lasts_s = self._between(SHAKES_HZ), self._between(SHAKES_S)

        def profile(since_s: float, now: Truth) -> float | None:
            if since_s >= lasts_s or abs(now.slip_distance_m - from_m) > LET_GO_M:
                return None
            return peak_n * math.sin(2 * math.pi * hertz * since_s)

        return profile


class Impulses(msgspec.Struct, frozen=True):
    """Impulses of impacts in one direction, N s, and displacements at CURVE times ``threshold``."""

    threshold: float  # lasting displacement of MOVED_M
    mallet: float  # of the mallet experiment
    furthest_m: tuple[float, ...]  # largest displacement
    moved_m: tuple[float, ...]  # lasting displacement


class GripTrials:
    """Simulated trials of impacts on the object in its grip."""

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
        self.down_reserve_n = max(friction_n - weight_n, 0.0)
        self.side_reserve_n = math.sqrt(max(friction_n**2 - weight_n**2, 0.0))

    def friction_reserve_n(self, direction: str) -> float:
        """Load that friction can carry in that direction besides the weight, N. Along the closing
        axis: the force of the two fingers that a push unloads."""
        whole = {"top": self.down_reserve_n, "side": self.side_reserve_n}
        return whole.get(direction, 0.5 * self._grip_n[0])

    def impact(self, direction: str, impulse_n_s: float, offset_m: float = 0.0) -> Impact:
        """Impact of the recording's mallet with that impulse."""
        return impact_of(self._mallet, direction, impulse_n_s, 0.0, offset_m)

    def impulses(self, direction: str) -> Impulses:
        """Impulses of that direction, searched once; the closing axis has those of the top."""
        direction = "top" if direction == "closing" else direction
        if direction not in self._known:
            self._known[direction] = self._searched(direction)
        return self._known[direction]

    def _searched(self, direction: str) -> Impulses:
        def moved(impulse_n_s: float) -> float:
            return self.simulate_impact(self.impact(direction, impulse_n_s))[1]

        threshold = bisect_least(lambda j: moved(j) >= MOVED_M, MIN_IMPULSE_N_S, MOST_N_S)
        mallet = bisect_least(lambda j: moved(j) >= AIM_M, threshold, min(4 * threshold, MOST_N_S))
        impacts = [self.impact(direction, part * threshold) for part in CURVE.tolist()]
        furthest, lasting = zip(*map(self.simulate_impact, impacts), strict=True)
        return Impulses(threshold, mallet, furthest, lasting)

    def simulate_impact(self, impact: Impact) -> tuple[float, float]:
        """Largest and lasting displacement of the object, m; both infinite if it is lost."""
        level = Level.SPIN if self._turns or impact.direction == "side" else Level.SLIDER
        if level not in self._held:
            self._held[level] = settled_grasp(self.body, self._hand, self._grip_n, level)
        trial = copy.deepcopy(self._held[level])
        before = _place(trial)
        trial.contact.strike(impact, SETTLE_S)
        furthest = 0.0
        for i in range(IMPACT_SAMPLES):
            trial.wait(SETTLE_S + i * SAMPLE_S, SAMPLE_S)
            furthest = max(furthest, float(np.linalg.norm(_place(trial) - before)))
        trial.wait(SETTLE_S + IMPACT_SAMPLES * SAMPLE_S, AFTER_S - IMPACT_SAMPLES * SAMPLE_S)
        if trial.contact.state[laws.NORMAL] <= 0.0:
            return math.inf, math.inf
        moved = float(np.linalg.norm(_place(trial) - before))
        return max(furthest, moved), moved

    def elastic(self, direction: str, furthest_m: float) -> float:
        """Impulse, N s, with that largest displacement, limited by MAX_LASTING_M."""
        impulses = self.impulses(direction)
        part = min(
            float(np.interp(furthest_m, impulses.furthest_m, CURVE)),
            float(np.interp(MAX_LASTING_M, impulses.moved_m, CURVE)),
        )
        return impulses.threshold * part

    def shove(self, direction: str, moved_m: float, lasts_s: float) -> Impact:
        """Push by a hand of that duration and lasting displacement."""
        reserve_n = self.friction_reserve_n(direction)

        def moves(force_n: float) -> bool:
            return self.simulate_impact(half_sine_push(direction, force_n, lasts_s))[1] >= moved_m

        force_n = bisect_least(moves, 0.5 * reserve_n, 4.0 * reserve_n)
        return half_sine_push(direction, force_n, lasts_s)


def _place(held: SettledGrasp) -> np.ndarray:
    s = held.contact.state
    return np.array([s[laws.SLIP], s[laws.ACROSS], TURN_LEVER_M * s[laws.TURN]])


def bisect_least(enough: Callable[[float], bool], low: float, high: float) -> float:
    """Least value that is enough, by bisection of the logarithm; ``high`` if none is."""
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def half_sine_push(direction: str, peak_n: float, lasts_s: float) -> Impact:
    """Push with a half-sine force, as the follow-through of an impact."""
    carried_n_s = 2.0 / math.pi * peak_n * lasts_s
    table = {
        "direction": direction, "impulse_n_s": 0.0, "duration_s": 0.001,
        "follow_n_s": min(carried_n_s, 5.0), "follow_s": lasts_s,
    }  # fmt: skip
    return msgspec.convert(table, Impact)
