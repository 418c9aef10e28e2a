"""What a person or the arm does to a held object: blows of the mallet, touches, pulls, drags.

How hard is found on the contact law alone, for the object as drawn and held as firmly as it is
(``bench``), as the mallet's own blow is (``scenarios.tap.mallet``); what it moves is measured.
"""

import math
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from grasp.loop import Tick
from grasp.phases import Phase
from scenarios.acquire.datasets.bench import Bench, pressed
from scenarios.tap.config import TapSettings
from scenarios.tap.mallet import MOST_N_S
from scenarios.world.blow import Blow
from scenarios.world.cell import SimulatedCell
from scenarios.world.truth import Truth

Kind = Literal["near", "mallet", "weak", "elastic", "shove", "touch", "pull", "drag", "shake"]
Direction = Literal["top", "side", "closing"]
# Force downwards, N, from seconds since it began and the truth; None: let go
Law = Callable[[float, Truth], float | None]

# Drawn evenly between these bounds unless it says otherwise; all assumed.
PAUSES_S = (0.35, 1.0)  # from the end of one act to the next, and before the first
NEAR = (0.75, 1.25)  # of the blow that moves it JUST_M for good
WEAK = (0.05, 0.7)  # likewise, evenly in the logarithm
ELASTIC_M = (0.0004, 0.0009)  # out and back
BESIDE_M = 0.005  # deviation of where a blow lands
SHOVES_M, SHOVES_S = (0.001, 0.012), (0.06, 0.2)
TOUCH_SHARE, TOUCHES_S = (0.1, 0.9), (0.08, 1.0)  # peak, of what is left of friction
PULL_SHARE, RAMPS_S, PULLS_S = (0.2, 0.97), (0.02, 0.5), (0.1, 0.6)
DRAGS_MPS, DRAGS_M = (0.004, 0.06), (0.0015, 0.015)  # speeds evenly in the logarithm
SHAKE_SHARE, SHAKES_HZ, SHAKES_S = (0.1, 0.6), (2.0, 9.0), (0.5, 2.0)
MOST_SHAKEN_MPS2 = 6.0

SPREAD = TapSettings().spread
HAND_NPM, HAND_NSPM = 1500.0, 8.0  # of a person who drags: stiffness and damping of a hand
LETS_GO_M = 0.003  # a person who only pulls lets go when it moves
FADES = 0.7  # of a force that is let go, from tick to tick


class Acts(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is done to a held object in one recording. Shares are taken in proportion."""

    number: Annotated[int, Meta(ge=1, le=100)]
    kinds: Annotated[dict[Kind, Annotated[float, Meta(gt=0.0)]], Meta(min_length=1)]
    directions: Annotated[dict[Direction, Annotated[float, Meta(gt=0.0)]], Meta(min_length=1)] = (
        msgspec.field(default_factory=lambda: {"top": 0.5, "side": 0.5})
    )
    firm: bool = False  # by a full grip, not the first one
    turning: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # of the recordings: blows may turn it


class Done(msgspec.Struct, frozen=True):
    """An act, when it began, s since the cell began, and when it is or was over."""

    kind: str
    direction: str
    from_s: float
    until_s: float
    impulse_n_s: float = 0.0


class _Force:
    """A force downwards that follows a law tick by tick, until it has faded."""

    def __init__(self, law: Law) -> None:
        self._law = law
        self._force_n, self._over = 0.0, False

    def now(self, since_s: float, truth: Truth) -> float | None:
        """The force, None once there is none any more."""
        asked = None if self._over else self._law(since_s, truth)
        if asked is not None:
            self._force_n = asked
            return asked
        self._over = True
        self._force_n *= FADES
        return self._force_n if abs(self._force_n) > 0.05 else None


class Performer:
    """Does the acts of a recording while the object is held at the top; ``take`` follows a trial
    and says when all are done."""

    def __init__(
        self, acts: Acts, bench: Bench, cell: SimulatedCell, rng: np.random.Generator
    ) -> None:
        self.done: list[Done] = []
        self._acts, self._bench, self._cell, self._rng = acts, bench, cell, rng
        self._due_s: float | None = None
        self._begun: Done | None = None
        self._force: _Force | None = None  # of what is not over with a blow

    def take(self, tick: Tick, truth: Truth | None) -> bool:
        """True when the object is to be set down."""
        if truth is None or tick.decision.phase is not Phase.HOLD or tick.arm.moving:
            return False
        t_s = tick.t_ns * 1e-9
        if self._due_s is None:
            self._due_s = t_s + self._pause()
        if self._begun is not None:
            self._go_on(self._begun, t_s, truth)
        elif t_s >= self._due_s:
            if len(self.done) == self._acts.number or not truth.touched:
                return True
            self._begin(t_s, truth)
        return False

    def _pause(self) -> float:
        return float(self._rng.uniform(*PAUSES_S))

    def _of(self, shares: dict[Kind, float] | dict[Direction, float]) -> str:
        weights = np.array(list(shares.values()))
        return str(self._rng.choice(list(shares), p=weights / weights.sum()))

    def _begin(self, t_s: float, truth: Truth) -> None:
        kind, direction = self._of(self._acts.kinds), self._of(self._acts.directions)
        if kind == "shake":
            self._cell.shaken = True
        laws = {"shake": self._shaking, "pull": self._pulling, "drag": self._dragging}
        if kind in laws:
            self._force = _Force(laws[kind](truth.slip_distance_m))
            self._begun = Done(kind, "" if kind == "shake" else "top", t_s, t_s)
            return
        if kind == "shove" and direction == "closing":
            direction = "top"
        blow = self._struck(kind, direction)
        self._cell.tap(blow)
        until_s = t_s + blow.duration_s + blow.follow_s
        self._begun = Done(kind, direction, t_s, until_s, blow.impulse_n_s + blow.follow_n_s)

    def _go_on(self, act: Done, t_s: float, truth: Truth) -> None:
        if self._force is not None:
            force_n = self._force.now(t_s - act.from_s, truth)
            self._cell.push(0.0 if force_n is None else force_n)
            if force_n is not None:
                return
        elif t_s < act.until_s:
            return
        self._force, self._begun, self._cell.shaken = None, None, False
        self.done.append(msgspec.structs.replace(act, until_s=t_s))
        self._due_s = t_s + self._pause()

    def _struck(self, kind: str, direction: str) -> Blow:
        rng, bench = self._rng, self._bench
        if kind == "touch":
            peak_n = float(rng.uniform(*TOUCH_SHARE)) * bench.spare_n(direction)
            return pressed(direction, peak_n, float(rng.uniform(*TOUCHES_S)))
        if kind == "shove":
            return bench.shove(
                direction, float(rng.uniform(*SHOVES_M)), float(rng.uniform(*SHOVES_S))
            )
        known = bench.impulses(direction)
        hard = {
            "near": lambda: known.just * float(rng.uniform(*NEAR)),
            "weak": lambda: known.just * math.exp(float(rng.uniform(*np.log(WEAK)))),
            "mallet": lambda: known.aim * max(1.0 + SPREAD * float(rng.standard_normal()), 0.0),
            "elastic": lambda: bench.elastic(direction, float(rng.uniform(*ELASTIC_M))),
        }[kind]()
        beside_m = float(np.clip(rng.standard_normal(), -2.5, 2.5)) * BESIDE_M
        return bench.blow(direction, min(hard, MOST_N_S), beside_m)

    def _pulling(self, from_m: float) -> Law:
        """Up to a share of what friction still bears, for a while, and let go."""
        rng = self._rng
        peak_n = float(rng.uniform(*PULL_SHARE)) * self._bench.spare_down_n
        ramp_s, lasts_s = float(rng.uniform(*RAMPS_S)), float(rng.uniform(*PULLS_S))

        def law(since_s: float, now: Truth) -> float | None:
            left = 2 * ramp_s + lasts_s - since_s
            if left <= 0.0 or abs(now.slip_distance_m - from_m) > LETS_GO_M:
                return None
            return peak_n * min(1.0, since_s / ramp_s, left / ramp_s)

        return law

    def _dragging(self, from_m: float) -> Law:
        """A hand that goes down at a steady speed and takes the object along, so far."""
        rng = self._rng
        speed_mps = math.exp(float(rng.uniform(*np.log(DRAGS_MPS))))
        way_m = float(rng.uniform(*DRAGS_M))
        most_n, longest_s = 2.0 * self._bench.spare_down_n, 2.0 * way_m / speed_mps + 1.0

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
        rng, mass_kg = self._rng, self._bench.body.mass_kg
        share = float(rng.uniform(*SHAKE_SHARE))
        peak_n = min(share * self._bench.spare_down_n, MOST_SHAKEN_MPS2 * mass_kg)
        hertz, lasts_s = float(rng.uniform(*SHAKES_HZ)), float(rng.uniform(*SHAKES_S))

        def law(since_s: float, now: Truth) -> float | None:
            if since_s >= lasts_s or abs(now.slip_distance_m - from_m) > LETS_GO_M:
                return None
            return peak_n * math.sin(2 * math.pi * hertz * since_s)

        return law
