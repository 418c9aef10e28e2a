"""How hard the mallet strikes: searched as the paper's operator did, until the object moves.

"Enough force to induce slip, but not to cause complete grasp failure" (paper, section V-B). The
search bisects the impulse on the contact law alone, for the object as configured and held as firmly
as the hand will hold it (``guard.cap_mode`` decides), until the object moves ``tap.aim_m`` for
good. A trial's own friction, mass and grip differ from that, and so does the hand's strength from
blow to blow: what a trial's tap really moves is measured, not assumed.
"""

import msgspec
import numpy as np

from scenarios.rigs.config import CUT
from scenarios.tap.blows import blow_of, direction_of, nominal_impulse_n_s
from scenarios.tap.config import TapConfig
from scenarios.world.settings import Blow


class Swing(msgspec.Struct, frozen=True):
    """One blow as the hand delivers it, and how much longer than needed it waits before."""

    blow: Blow
    wait_s: float

    @property
    def impulse_n_s(self) -> float:
        return self.blow.impulse_n_s + self.blow.follow_n_s


def swing(config: TapConfig, seed: int) -> Swing:
    """The tap of a seed. A real rig uses only its wait, because a person strikes.
    Raises ConfigError when no tap moves the object enough."""
    tap = config.tap
    direction = direction_of(tap, seed)
    nominal_n_s = 0.0 if config.real else search(config, direction)
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
    hand = 1 + tap.spread * float(np.clip(rng.standard_normal(), -CUT, CUT))
    delay, wait = rng.uniform(size=2).tolist()
    beside_m = tap.offset_spread_m * float(np.clip(rng.standard_normal(), -CUT, CUT))
    impulse_n_s = tap.strength * nominal_n_s * max(hand, 0.0)
    blow = blow_of(tap, direction, impulse_n_s, config.loop.period_s * delay, beside_m)
    return Swing(blow, tap.wait_s * wait)


def mallet_speed_mps(config: TapConfig, impulse_n_s: float) -> float:
    """Speed at which the mallet met the object: J = (1 + e) m M / (m + M) v, object free."""
    tap, body = config.tap, config.object
    mass_kg = body.mass_kg + body.added_mass_kg
    reduced_kg = tap.mallet_kg * mass_kg / (tap.mallet_kg + mass_kg)
    return impulse_n_s / ((1 + tap.restitution) * reduced_kg)


def search(config: TapConfig, direction: str) -> float:
    """Impulse, N s, of the nominal blow in that direction; raises ConfigError when there is none
    below 2 N s: the object is knocked out before."""
    grip_n = config.guard.full_grip_n
    return nominal_impulse_n_s(config.object, config.contact, grip_n, config.tap, direction)
