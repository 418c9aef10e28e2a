"""How hard the mallet strikes: searched as the paper's operator did, until the object moves.

"Enough force to induce slip, but not to cause complete grasp failure" (paper, section V-B). The
search bisects the impulse on the contact law alone, for the object as configured and held as firmly
as the hand will hold it (``guard.cap_mode`` decides), until the object moves ``tap.aim_m`` for
good. A trial's own friction, mass and grip differ from that, and so does the hand's strength from
blow to blow: what a trial's tap really moves is measured, not assumed.
"""

import copy
import math
from functools import cache

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import Vector3
from scenarios.tap.config import TapConfig
from scenarios.tap.settings import TapSettings
from scenarios.world import laws
from scenarios.world.blow import Blow
from scenarios.world.contact import (
    Contact,
    Floats,
    Level,
    LevelChoice,
    finger_stiffness,
    parameters,
)
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.objects import GraspObject

MOST_N_S = 2.0
HALVINGS = 24
SETTLE_S, AFTER_S = 0.6, 0.6


class Swing(msgspec.Struct, frozen=True):
    """One blow as the hand delivers it, and how much longer than needed it waits before."""

    blow: Blow
    wait_s: float

    @property
    def impulse_n_s(self) -> float:
        return self.blow.impulse_n_s + self.blow.follow_n_s


def direction_of(settings: TapSettings, seed: int) -> str:
    """Of the tap with that seed: ``alternate`` strikes the top with even seeds."""
    if settings.direction != "alternate":
        return settings.direction
    return "top" if seed % 2 == 0 else "side"


def swing(config: TapConfig, seed: int) -> Swing:
    """The blow that a seed stands for. Raises ConfigError when no blow moves the object enough."""
    tap = config.tap
    direction = direction_of(tap, seed)
    nominal_n_s = tap.impulse_n_s or search(config, "top" if direction == "closing" else direction)
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
    hand = 1 + tap.spread * float(np.clip(rng.standard_normal(), -2.5, 2.5))
    delay, wait = rng.uniform(size=2).tolist()
    impulse_n_s = tap.strength * nominal_n_s * max(hand, 0.0)
    blow = _blow(tap, direction, impulse_n_s, config.loop.period_s * delay)
    return Swing(blow, tap.wait_s * wait)


def mallet_speed_mps(config: TapConfig, impulse_n_s: float) -> float:
    """Speed at which the mallet met the object: J = (1 + e) m M / (m + M) v, object free."""
    tap, body = config.tap, config.object
    mass_kg = body.mass_kg + body.added_mass_kg
    reduced_kg = tap.mallet_kg * mass_kg / (tap.mallet_kg + mass_kg)
    return impulse_n_s / ((1 + tap.restitution) * reduced_kg)


def search(config: TapConfig, direction: str) -> float:
    """Impulse, N s, that moves the configured object ``tap.aim_m`` in that direction.

    Raises ConfigError when none below 2 N s does: the object is knocked out before.
    """
    # the strength of one blow is what is searched: what differs between trials plays no part
    tap = msgspec.structs.replace(
        config.tap, impulse_n_s=0.0, direction="alternate", spread=0.0, strength=1.0
    )
    return _search(config.object, config.contact, config.guard.full_grip_n, tap, direction)


@cache
def _search(
    body: GraspObject, hand: ContactSettings, grip_n: Vector3, tap: TapSettings, direction: str
) -> float:
    held = _held(body, hand, grip_n, Level.SLIDER if direction == "top" else Level.SPIN)
    low, high = 0.0, MOST_N_S
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        moved_m = _moved_m(held, hand, _blow(tap, direction, middle, 0.0))
        low, high = (middle, high) if moved_m < tap.aim_m else (low, middle)
    reached_m = _moved_m(held, hand, _blow(tap, direction, high, 0.0))
    if not reached_m < 2 * tap.aim_m:
        raise ConfigError(
            "tap", "aim_m",
            f"no blow on the {direction} moves {body.name} {tap.aim_m * 1e3:g} mm and leaves it "
            "in the hand", "a smaller tap.aim_m, or tap.impulse_n_s",
        )  # fmt: skip
    return high


def _blow(tap: TapSettings, direction: str, impulse_n_s: float, delay_s: float) -> Blow:
    follow_n_s = tap.follow_fraction * impulse_n_s
    return msgspec.convert(
        {
            "direction": direction, "impulse_n_s": impulse_n_s - follow_n_s,
            "duration_s": tap.duration_s, "follow_n_s": follow_n_s, "follow_s": tap.follow_s,
            "delay_s": delay_s,
        },
        Blow,
    )  # fmt: skip


class _Held(msgspec.Struct, frozen=True):
    """The object in the air, settled in a firm grip."""

    contact: Contact
    travel_m: Floats

    def waits(self, since_s: float, for_s: float) -> None:
        """Let time pass."""
        self.contact.advance(since_s, for_s, 0.0, 0.0, 0.0, self.travel_m, self.travel_m)


def _held(body: GraspObject, hand: ContactSettings, grip_n: Vector3, level: Level) -> _Held:
    """At that grip force, which is what the motors leave once the pads have relaxed."""
    contact = Contact(hand, body, LevelChoice(level, hand.step_s, hand.blow_step_s))
    contact.place()
    contact.state[laws.HEIGHT] = 1.0
    kept = 1 - hand.relaxation_fraction
    pressed_m = np.array(grip_n) / (kept * finger_stiffness(hand, body))
    width_m, _ = laws.width_and_slope(parameters(hand, body), 0.0)
    touch_m = hand.half_aperture_m - width_m
    held = _Held(contact, touch_m + pressed_m)
    held.waits(0.0, SETTLE_S)
    return held


def _moved_m(held: _Held, hand: ContactSettings, blow: Blow) -> float:
    """Displacement for good, m, or what the rotation is worth, whichever is more; infinite if the
    object was lost."""
    trial = copy.deepcopy(held)
    before, after = held.contact.state, trial.contact.state
    trial.contact.strike(blow, SETTLE_S)
    trial.waits(SETTLE_S, AFTER_S)
    if after[laws.NORMAL] <= 0.0:
        return math.inf
    moved_m = math.hypot(after[laws.SLIP] - before[laws.SLIP], after[laws.ACROSS])
    turned_rad = abs(after[laws.TURN] - before[laws.TURN])
    return max(moved_m, hand.turn_lever_m * float(turned_rad))
