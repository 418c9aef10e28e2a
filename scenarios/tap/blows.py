"""The blow itself: which way, where it lands, and how hard it must be to move the object."""

import copy
import math
from functools import cache
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import Vector3
from scenarios.tap.settings import TapSettings
from scenarios.world.objects import GraspObject
from scenarios.world.settings import (
    HALF_APERTURE_M,
    Blow,
    ContactSettings,
    Level,
)

if TYPE_CHECKING:  # what is compiled is needed for a search, and not by a hand that strikes
    from scenarios.world.contact import Contact, Floats

MOST_N_S = 2.0
HALVINGS = 16  # to 0.03 mN s
SETTLE_S, AFTER_S = 0.6, 0.6


def direction_of(settings: TapSettings, seed: int) -> str:
    """Of the tap with that seed: ``alternate`` strikes the top with even seeds."""
    if settings.direction != "alternate":
        return settings.direction
    return "top" if seed % 2 == 0 else "side"


def nominal_impulse_n_s(
    body: GraspObject, hand: ContactSettings, grip_n: Vector3, tap: TapSettings, direction: str
) -> float:
    """As told, or searched for; raises ConfigError when no blow moves the object enough."""
    if tap.impulse_n_s:
        return tap.impulse_n_s
    # the strength of one blow is what is searched: what differs between trials plays no part
    alike = msgspec.structs.replace(
        tap, impulse_n_s=0.0, direction="alternate", spread=0.0, offset_spread_m=0.0, strength=1.0
    )
    return searched(body, hand, grip_n, alike, "top" if direction == "closing" else direction)


@cache
def searched(
    body: GraspObject, hand: ContactSettings, grip_n: Vector3, tap: TapSettings, direction: str
) -> float:
    held = held_at(body, hand, grip_n, search_level(tap, direction))
    low, high = 0.0, MOST_N_S
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        moved_m = moved_by(held, tap.mark_height_m, blow_of(tap, direction, middle, 0.0))
        low, high = (middle, high) if moved_m < tap.aim_m else (low, middle)
    reached_m = moved_by(held, tap.mark_height_m, blow_of(tap, direction, high, 0.0))
    if not reached_m < 2 * tap.aim_m:
        raise ConfigError(
            "tap", "aim_m",
            f"no blow on the {direction} moves {body.name} {tap.aim_m * 1e3:g} mm and leaves it "
            "in the hand", "a smaller tap.aim_m, or tap.impulse_n_s",
        )  # fmt: skip
    return high


def search_level(tap: TapSettings, direction: str) -> Level:
    """What a search takes, whatever its trials do: only a blow through the middle turns nothing."""
    centred = direction == "top" and tap.top_offset_m == 0.0
    return Level.SLIDER if centred else Level.SPIN


def blow_of(
    tap: TapSettings, direction: str, impulse_n_s: float, delay_s: float, beside_m: float = 0.0
) -> Blow:
    """``beside_m``: how far from where it was meant to land."""
    follow_n_s = tap.follow_fraction * impulse_n_s
    meant_m = {"top": tap.top_offset_m, "side": tap.side_offset_m}
    offset_m = meant_m[direction] + beside_m if direction in meant_m else 0.0
    return msgspec.convert(
        {
            "direction": direction, "impulse_n_s": impulse_n_s - follow_n_s,
            "duration_s": tap.duration_s, "follow_n_s": follow_n_s, "follow_s": tap.follow_s,
            "delay_s": delay_s, "offset_m": offset_m,
        },
        Blow,
    )  # fmt: skip


class Held(msgspec.Struct, frozen=True):
    """The object in the air, settled in a firm grip."""

    contact: "Contact"
    travel_m: "Floats"

    def waits(self, since_s: float, for_s: float) -> None:
        """Let time pass."""
        self.contact.advance(since_s, for_s, 0.0, 0.0, 0.0, self.travel_m, self.travel_m)


def held_at(body: GraspObject, hand: ContactSettings, grip_n: Vector3, level: Level) -> Held:
    """At that grip force, which is what the motors leave once the pads have relaxed."""
    from scenarios.world import laws
    from scenarios.world.contact import Contact, finger_stiffness, parameters

    contact = Contact(hand, body, level)
    contact.place()
    contact.state[laws.HEIGHT] = 1.0
    kept = 1 - hand.relaxation_fraction
    pressed_m = np.array(grip_n) / (kept * finger_stiffness(body))
    width_m, _ = laws.width_and_slope(parameters(hand, body), 0.0)
    touch_m = HALF_APERTURE_M - width_m
    held = Held(contact, touch_m + pressed_m)
    held.waits(0.0, SETTLE_S)
    return held


def moved_by(held: Held, mark_height_m: float, blow: Blow) -> float:
    """Displacement of the tape mark for good, m; infinite if the object was lost."""
    from scenarios.world import laws

    trial = copy.deepcopy(held)
    before, after = held.contact.state, trial.contact.state
    trial.contact.strike(blow, SETTLE_S)
    trial.waits(SETTLE_S, AFTER_S)
    if after[laws.NORMAL] <= 0.0:
        return math.inf
    turned_rad = after[laws.TURN] - before[laws.TURN]
    down_m = after[laws.SLIP] - before[laws.SLIP] + mark_height_m * (1 - math.cos(turned_rad))
    return math.hypot(down_m, after[laws.ACROSS] - mark_height_m * math.sin(turned_rad))
