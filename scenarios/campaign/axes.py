"""Six ways to make a lift harder, each in its unit, and the static bound of what 10 N can hold.

The bound is that of Coulomb friction at the force limit: the thumb at F and the fingers that oppose
it at F in all carry 2 mu_k F, so m (g + a) + pull <= 2 mu_k F. It knows nothing of time: a
controller that answers slip late loses objects that the bound would let it hold. Of an axis
without such a bound (taxels, gain) it is the whole of what can be lost.
"""

from collections.abc import Callable
from enum import StrEnum

import msgspec
import numpy as np

from scenarios.campaign.config import RunConfig
from scenarios.world.contact_settings import GRAVITY_MPS2

MOST_WIDTH_MM = 20.0
HALVINGS = 40


class Harder(StrEnum):
    """Which way an axis gets harder."""

    UP = "up"
    DOWN = "down"


class Axis(msgspec.Struct, frozen=True):
    """One way: its unit, where a configuration stands on it, how to move it, and its bound."""

    name: str
    title: str
    unit: str
    harder: Harder
    here: Callable[[RunConfig], float]
    moved: Callable[[RunConfig, float], list[str]]  # assignments, section.key=value
    bound: Callable[[RunConfig], float]

    def share(self, config: RunConfig, value: float) -> float:
        """Of what 10 N can hold: 1 at the bound, less where it is easier. ``config``: the one that
        is moved."""
        bound = self.bound(config)
        return bound / value if self.harder is Harder.DOWN else value / bound


def _mass_kg(config: RunConfig) -> float:
    return config.object.mass_kg + config.object.added_mass_kg


def _holds_n(config: RunConfig) -> float:
    """Weight and pull that sliding friction carries at the force limit."""
    return 2 * config.object.friction_kinetic * config.guard.force_limit_n


def _least_friction(config: RunConfig) -> float:
    return _mass_kg(config) * GRAVITY_MPS2 / (2 * config.guard.force_limit_n)


def _rougher(config: RunConfig, kinetic: float) -> list[str]:
    static = kinetic * config.object.friction_static / config.object.friction_kinetic
    return [f"object.friction_kinetic={kinetic:g}", f"object.friction_static={static:g}"]


def _heavier(config: RunConfig, mass_kg: float) -> list[str]:
    own_kg = min(config.object.mass_kg, mass_kg)
    return [f"object.mass_kg={own_kg:g}", f"object.added_mass_kg={mass_kg - own_kg:g}"]


def _per_speed(config: RunConfig) -> float:
    """Acceleration that goes with a metre a second of arm speed, 1/s."""
    return config.controller.lift_acceleration_mps2 / config.controller.lift_speed_mps


def _quicker(config: RunConfig, speed_mps: float) -> list[str]:
    rise_mps2 = _per_speed(config) * speed_mps
    return [
        f"controller.lift_speed_mps={speed_mps:g}",
        f"controller.lift_acceleration_mps2={rise_mps2:g}",
        f"arm.max_speed_mps={max(config.arm.max_speed_mps, speed_mps):g}",
        f"arm.max_acceleration_mps2={max(config.arm.max_acceleration_mps2, rise_mps2):g}",
    ]


def _fastest_mps(config: RunConfig) -> float:
    most_mps2 = _holds_n(config) / _mass_kg(config) - GRAVITY_MPS2
    return most_mps2 / _per_speed(config)


def _pulled(config: RunConfig, force_n: float) -> list[str]:
    """At the top: an arm that pauses to answer slip stands lower."""
    return [f"pull.force_n={force_n:g}", f"pull.above_m={config.controller.lift_height_m / 2:g}"]


def _hardest_pull_n(config: RunConfig) -> float:
    return _holds_n(config) - _mass_kg(config) * GRAVITY_MPS2


def _thumb_n(config: RunConfig, wider_mm: float) -> float:
    """Force at the thumb in the first grasp of an object so much wider a side."""
    from scenarios.world import contact, laws

    p = contact.parameters(config.contact, config.object)
    width_m, _ = laws.width_and_slope(p, 0.0)
    travel = config.hand.m_per_count * np.array(config.object.grip_counts, float)
    forces = np.zeros(contact.FINGERS)
    wider_m = width_m + 1e-3 * wider_mm
    laws.normal_forces(p, wider_m, travel, contact.initial_state(), forces)
    return float(forces[0])


def _width_mm(config: RunConfig, side: int, reached: Callable[[float], bool]) -> float:
    low, high = 0.0, MOST_WIDTH_MM
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(_thumb_n(config, side * middle)) else (middle, high)
    return high


def _widest_mm(config: RunConfig) -> float:
    """From where on the first grasp alone would take the whole of the force limit."""
    return _width_mm(config, 1, lambda thumb_n: thumb_n >= config.guard.force_limit_n)


def _narrowest_mm(config: RunConfig) -> float:
    """From where on the first grasp would touch nothing."""
    return _width_mm(config, -1, lambda thumb_n: thumb_n <= 0.0)


def _setting(key: str, scale: float = 1.0) -> Callable[[RunConfig, float], list[str]]:
    return lambda config, value: [f"{key}={scale * value:g}"]


AXES = {
    axis.name: axis
    for axis in (
        Axis("friction", "friction of the object", "kinetic coefficient", Harder.DOWN,
             lambda c: c.object.friction_kinetic, _rougher, _least_friction),
        Axis("mass", "mass", "kg", Harder.UP,
             _mass_kg, _heavier, lambda c: _holds_n(c) / GRAVITY_MPS2),
        Axis("speed", "arm speed, acceleration with it", "m/s", Harder.UP,
             lambda c: c.controller.lift_speed_mps, _quicker, _fastest_mps),
        Axis("pull", "pull in the hold", "N", Harder.UP,
             lambda c: c.pull.force_n, _pulled, _hardest_pull_n),
        Axis("wider", "wider than expected", "mm a side", Harder.UP,
             lambda c: max(0.0, 1e3 * c.variation.width_error_m),
             _setting("variation.width_error_m", 1e-3), _widest_mm),
        Axis("narrower", "narrower than expected", "mm a side", Harder.UP,
             lambda c: max(0.0, -1e3 * c.variation.width_error_m),
             _setting("variation.width_error_m", -1e-3), _narrowest_mm),
        Axis("taxels", "taxels lost", "share", Harder.UP,
             lambda c: c.damage.taxels_lost, _setting("damage.taxels_lost"), lambda c: 1.0),
        Axis("gain", "gain lost", "share", Harder.UP,
             lambda c: c.damage.gain_lost, _setting("damage.gain_lost"), lambda c: 1.0),
    )
}  # fmt: skip
