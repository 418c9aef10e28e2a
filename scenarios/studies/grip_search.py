"""Finger positions, in whole counts, that hold an object and are sure to let it slip in the lift.

The paper's lift needs a grasp that keeps contact and is too weak, and calls such configurations
challenging to find (section V-C): one motor count is 2 to 4 N on a rigid object. Each finger has a
position of its own (individual mode), which divides that step. Every triple near first contact is
judged on many draws of the variation between trials, by the contact law's own balance of forces.
"""

import itertools
from collections.abc import Iterator
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.interfaces import Counts3
from grasp.settings import Layer, load
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import twin_onset_s
from scenarios.rigs.variation import Draw, draw
from scenarios.world import contact, laws
from scenarios.world.contact import Floats


class GripCriteria(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a weak grasp must be; the paper gives no figures."""

    least_n: Annotated[float, Meta(ge=0.0, le=10.0, description="at the thumb, relaxed")] = 0.5
    most_n: Annotated[float, Meta(gt=0.0, le=10.0, description="at the thumb, at first")] = 3.0
    finger_n: Annotated[float, Meta(ge=0.0, le=5.0, description="at either other finger")] = 0.1
    slip_margin: Annotated[
        float, Meta(ge=0.0, lt=1.0, description="friction carries this much less than the weight")
    ] = 0.05
    reach_counts: Annotated[int, Meta(ge=1, le=10, description="searched past first contact")] = 4
    least_sure: Annotated[
        float, Meta(ge=0.0, le=1.0, description="of the draws must fail in nothing")
    ] = 0.99
    draws: Annotated[int, Meta(ge=1, le=10_000, description="trials that each is judged on")] = 200

    def __post_init__(self) -> None:
        if self.least_n >= self.most_n:
            raise ValueError(f"least_n {self.least_n:g} is not below most_n {self.most_n:g}")


class FoundGrip(msgspec.Struct, frozen=True, kw_only=True):
    """One triple of positions over all draws: forces in N, shares of draws from 0 to 1."""

    counts: Counts3
    thumb_n: tuple[float, float, float]  # least (relaxed), median, most
    finger_n: float  # least of B and C, relaxed
    carried: float  # most of the weight that friction could carry, at first
    fails: dict[str, float]  # share of draws that are loose, firm, finger (lost touch), holds
    sure: float  # share of draws that fail in nothing

    def meets(self, wanted: GripCriteria) -> bool:
        """True when it slips in every draw, and hardly ever fails in anything else."""
        return self.fails["holds"] == 0.0 and self.sure >= wanted.least_sure

    @property
    def slip_margin(self) -> float:
        return 1.0 - self.carried


def criteria(
    least_n: float | None = None, most_n: float | None = None, draws: int | None = None
) -> GripCriteria:
    """The criteria with what is not None in place of the defaults. Raises ConfigError for what
    cannot be."""
    asked = {"least_n": least_n, "most_n": most_n, "draws": draws}
    given = {key: value for key, value in asked.items() if value is not None}
    return load(GripCriteria, [Layer("grip-search", given)])


def with_counts(config: LiftConfig, counts: Counts3) -> LiftConfig:
    """The configuration with these positions for its object."""
    body = msgspec.structs.replace(config.object, grip_counts=counts)
    return msgspec.structs.replace(config, object=body)


def lifts_that_slip(config: LiftConfig, seeds: range) -> int:
    """How many simulated lifts slip when nobody reacts."""
    return sum(twin_onset_s(config, seed) is not None for seed in seeds)


def search(config: LiftConfig, criteria: GripCriteria, seed: int = 0) -> list[FoundGrip]:
    """All triples near first contact, best first: fails in fewest draws, then middling force."""
    trials = _trials(config, criteria.draws, seed)
    grips = [judge(config, criteria, counts, trials) for counts in _candidates(config, criteria)]
    middle_n = 0.5 * (criteria.least_n + criteria.most_n)
    return sorted(
        grips,
        key=lambda g: (
            -g.sure,
            abs(round(g.thumb_n[1] - middle_n, 6)),
            max(g.counts) - min(g.counts),
        ),
    )


def judge(
    config: LiftConfig, criteria: GripCriteria, counts: Counts3, trials: list[Draw]
) -> FoundGrip:
    """One triple on all trials."""
    pressed, carried = _forces(config, counts, trials)
    relaxed = pressed * (1 - config.contact.relaxation_fraction)
    flags = {
        "loose": relaxed[:, 0] < criteria.least_n,
        "firm": pressed[:, 0] > criteria.most_n,
        "finger": relaxed[:, 1:].min(axis=1) < criteria.finger_n,
        "holds": carried > 1.0 - criteria.slip_margin,
    }
    thumb = relaxed[:, 0].min(), np.median(pressed[:, 0]), pressed[:, 0].max()
    return FoundGrip(
        counts=counts,
        thumb_n=(float(thumb[0]), float(thumb[1]), float(thumb[2])),
        finger_n=float(relaxed[:, 1:].min()),
        carried=float(carried.max()),
        fails={name: float(flag.mean()) for name, flag in flags.items()},
        sure=float((~np.any(list(flags.values()), axis=0)).mean()),
    )


def present_grip(config: LiftConfig, criteria: GripCriteria, seed: int = 0) -> FoundGrip:
    """The object's own positions, judged the same way."""
    trials = _trials(config, criteria.draws, seed)
    return judge(config, criteria, config.object.grip_counts, trials)


def _trials(config: LiftConfig, draws: int, seed: int) -> list[Draw]:
    children = np.random.SeedSequence(seed).spawn(draws)
    return [
        draw(config.variation, config.object, config.hand, np.random.default_rng(child))
        for child in children
    ]


def _candidates(config: LiftConfig, criteria: GripCriteria) -> Iterator[Counts3]:
    """Triples around first contact. B and C are alike, and the object is free along the closing
    axis, so only one order of the two and triples about its middle are tried."""
    p = contact.parameters(config.contact, config.object)
    width_m, _ = laws.width_and_slope(p, 0.0)
    first = int((config.contact.half_aperture_m - width_m) / config.hand.m_per_count)
    near = range(max(0, first - 2), min(255, first + criteria.reach_counts) + 1)
    for a, b, c in itertools.product(near, near, near):
        if c <= b <= c + 1 and abs(2 * a - b - c) <= 2:
            yield a, b, c


def _forces(
    config: LiftConfig, counts: Counts3, trials: list[Draw]
) -> tuple[Floats, NDArray[np.float64]]:
    """Normal forces (n, 3), N, at first, and the share (n,) of the weight that friction carries."""
    pressed = np.zeros((len(trials), contact.FINGERS))
    carried = np.zeros(len(trials))
    for k, trial in enumerate(trials):
        p = contact.parameters(config.contact, trial.body)
        width_m, slope = laws.width_and_slope(p, 0.0)
        travel = config.hand.m_per_count * np.array(counts, float) + trial.finger_offset_m
        laws.normal_forces(p, width_m, travel, contact.initial_state(), pressed[k])
        flank = slope + trial.body.friction_static / np.sqrt(1 + slope * slope)
        mass_kg = trial.body.mass_kg + trial.body.added_mass_kg
        carried[k] = pressed[k].sum() * flank / (mass_kg * contact.GRAVITY_MPS2)
    return pressed, carried
