"""The mallet tap: settings, and the search for an impulse like that of the paper's operator.

"Enough force to induce slip, but not to cause complete grasp failure" (paper, section V-B). The
search bisects the impulse on the contact law alone, for the configured object in a firm grip
(``guard.limit_mode``), until the permanent displacement is ``tap.aim_m``. Friction, mass, grip and
strength of the tap vary between trials, so each trial measures its displacement.
"""

import copy
import math
from functools import cache
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import Vector3
from scenarios.rigs.config import CUT_SIGMAS
from scenarios.tap.config import TapConfig, TapSettings
from scenarios.world.objects import GraspObject
from scenarios.world.settings import HALF_APERTURE_M, ContactSettings, Impact, Level

if TYPE_CHECKING:  # compiled code: only a search needs it
    from scenarios.world.contact import Contact, Floats

MOST_N_S = 2.0
HALVINGS = 16  # to 0.03 mN s
SETTLE_S, AFTER_S = 0.6, 0.6
MARK_HEIGHT_M = 0.05  # of the tape mark above the grip; assumed
OFFSET_SPREAD_M = 0.005  # standard deviation of the impact's position; assumed, 2-10 mm
WAIT_S = 0.3  # before an impact: uniform from 0 to this
MALLET_KG = 0.454  # 16 oz (paper)
RESTITUTION = 0.3  # rubber on the object; assumed, 0.2-0.5


class Swing(msgspec.Struct, frozen=True):
    """One impact, and the random wait before it beyond the necessary one."""

    impact: Impact
    wait_s: float

    @property
    def impulse_n_s(self) -> float:
        return self.impact.impulse_n_s + self.impact.follow_n_s


def swing(config: TapConfig, seed: int) -> Swing:
    """The random tap of a seed. A real rig uses only its wait, because an operator taps.
    Raises ConfigError when no tap moves the object enough."""
    tap, direction = config.tap, config.direction(seed)
    nominal_n_s = 0.0 if config.real else nominal_impulse_n_s(config, direction)
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
    hand = 1 + tap.spread * float(np.clip(rng.standard_normal(), -CUT_SIGMAS, CUT_SIGMAS))
    delay, wait = rng.uniform(size=2).tolist()
    beside_m = OFFSET_SPREAD_M * float(np.clip(rng.standard_normal(), -CUT_SIGMAS, CUT_SIGMAS))
    impulse_n_s = nominal_n_s * max(hand, 0.0)
    impact = impact_of(tap, direction, impulse_n_s, config.loop.period_s * delay, beside_m)
    return Swing(impact, WAIT_S * wait)


def mallet_speed_mps(config: TapConfig, impulse_n_s: float) -> float:
    """Speed of the mallet at impact, m/s: J = (1 + e) m M / (m + M) v, for a free object."""
    mass_kg = config.object.mass_kg + config.object.added_mass_kg
    reduced_kg = MALLET_KG * mass_kg / (MALLET_KG + mass_kg)
    return impulse_n_s / ((1 + RESTITUTION) * reduced_kg)


def nominal_impulse_n_s(config: TapConfig, direction: str) -> float:
    """Impulse of the nominal impact in that direction, N s, as set or searched. Raises ConfigError
    where every impulse that moves the object enough knocks it out of the hand, or exceeds 2 N s."""
    tap = config.tap
    if tap.impulse_n_s:
        return tap.impulse_n_s
    common = msgspec.structs.replace(tap, direction="alternate", spread=0.0)  # searched once
    grip_n = config.guard.full_grip_n
    searched = "top" if direction == "closing" else direction
    return _search(config.object, config.contact, grip_n, common, searched)


@cache
def _search(
    body: GraspObject, hand: ContactSettings, grip_n: Vector3, tap: TapSettings, direction: str
) -> float:
    # regardless of the trials' contact level: only an impact on top causes no rotation
    grasp = settled_grasp(body, hand, grip_n, Level.SLIDER if direction == "top" else Level.SPIN)
    low, high = 0.0, MOST_N_S
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        moved_m = moved_by(grasp, impact_of(tap, direction, middle, 0.0))
        low, high = (middle, high) if moved_m < tap.aim_m else (low, middle)
    if not moved_by(grasp, impact_of(tap, direction, high, 0.0)) < 2 * tap.aim_m:
        raise ConfigError(
            "tap", "aim_m",
            f"no tap on the {direction} moves {body.name} by {tap.aim_m * 1e3:g} mm and leaves it "
            "in the hand", "a smaller tap.aim_m, or tap.impulse_n_s",
        )  # fmt: skip
    return high


def impact_of(
    tap: TapSettings, direction: str, impulse_n_s: float, delay_s: float, beside_m: float = 0.0
) -> Impact:
    """The impact of that impulse; ``beside_m``: its distance from the intended position."""
    follow_n_s = tap.follow_fraction * impulse_n_s
    intended_m = {"top": 0.0, "side": tap.side_offset_m}
    offset_m = intended_m[direction] + beside_m if direction in intended_m else 0.0
    return msgspec.convert(
        {
            "direction": direction, "impulse_n_s": impulse_n_s - follow_n_s,
            "duration_s": tap.duration_s, "follow_n_s": follow_n_s, "follow_s": tap.follow_s,
            "delay_s": delay_s, "offset_m": offset_m,
        },
        Impact,
    )  # fmt: skip


class SettledGrasp(msgspec.Struct, frozen=True):
    """A lifted object in a firm grip whose contact forces have settled."""

    contact: "Contact"
    travel_m: "Floats"

    def wait(self, since_s: float, for_s: float) -> None:
        """Advance the simulation."""
        self.contact.advance(since_s, for_s, 0.0, 0.0, 0.0, self.travel_m, self.travel_m)


def settled_grasp(
    body: GraspObject, hand: ContactSettings, grip_n: Vector3, level: Level
) -> SettledGrasp:
    """The settled grasp at that grip force, which the pads keep after their relaxation."""
    from scenarios.world import laws
    from scenarios.world.contact import Contact, finger_stiffness, parameters

    contact = Contact(hand, body, level)
    contact.place()
    contact.state[laws.HEIGHT] = 1.0
    kept = 1 - hand.relaxation_fraction
    pressed_m = np.array(grip_n) / (kept * finger_stiffness(body))
    width_m, _ = laws.width_and_slope(parameters(hand, body), 0.0)
    touch_m = HALF_APERTURE_M - width_m
    grasp = SettledGrasp(contact, touch_m + pressed_m)
    grasp.wait(0.0, SETTLE_S)
    return grasp


def moved_by(grasp: SettledGrasp, impact: Impact) -> float:
    """Permanent displacement of the tape mark, m; infinite if the object was lost."""
    from scenarios.world import laws

    trial = copy.deepcopy(grasp)
    before, after = grasp.contact.state, trial.contact.state
    trial.contact.strike(impact, SETTLE_S)
    trial.wait(SETTLE_S, AFTER_S)
    if after[laws.NORMAL] <= 0.0:
        return math.inf
    turned_rad = after[laws.TURN] - before[laws.TURN]
    down_m = after[laws.SLIP] - before[laws.SLIP] + MARK_HEIGHT_M * (1 - math.cos(turned_rad))
    return math.hypot(down_m, after[laws.ACROSS] - MARK_HEIGHT_M * math.sin(turned_rad))
