"""Drop rate of the lift over random objects, friction, mass, offsets and hands.

Half of the lifts use the six objects of the experiments with other friction and mass, half random
objects. Every tenth lift sets the object down, the others end in the air. *Holdable*: sliding
friction at the force limit carries the weight while the arm accelerates; 10 N could then have held
a dropped object. Intervals: Clopper-Pearson, 95 %.
"""

import argparse
import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache

import msgspec
import numpy as np

from drivers.robotiq.model.hand import HandSettings
from grasp.cli.options import whole
from grasp.cli.parser import Parser
from scenarios.acquire.datasets.random_objects import random_object
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import SET_DOWN_EVERY
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftOutcome
from scenarios.rigs.simulated import cell_settings
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.objects import GraspObject
from studies.runner import PAPER_OBJECTS, Study, markdown

LIFTS = 20_000
SHAPES = ("straight", "ellipsoid")
TRIAL = 17  # keeps these random numbers apart from those of the world with the same seed
# Ranges, uniform; assumed unless the settings state a source. Mass and tip mass are log-uniform.
FRICTION, MASS = (0.6, 1.2), (0.5, 2.0)  # factors of the objects of the experiments
LOAD = (0.7, 2.5)  # weight of a random object over the friction of its first grip
WIDTH_ERROR_M = (-0.0001, 0.0006)  # a side; a narrower object is not touched by the first grip
ASIDE_M, SCATTER_M = (0.0, 0.006), (0.0, 0.00016)  # standard deviations in one lift
LATENCY_S, DEBOUNCE_S, TIP_KG = (0.01, 0.08), (0.01, 0.06), (0.05, 0.4)
REFRESH_HZ = (100, 200)
SMOOTH_UM = 100.0  # slip on smoother surfaces causes little vibration
LOST = (LiftOutcome.DROPPED, LiftOutcome.EXPELLED)


class Task(msgspec.Struct, frozen=True):
    """A lift; object and hand follow from the seed."""

    seed: int
    detector: str | None = None


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one lift. ``least_n``: force at every finger that carries the accelerated weight by
    sliding friction. ``cause``: of the run's last phase."""

    seed: int
    object: str
    set_down: bool
    outcome: str
    cause: str
    least_n: float
    slip_mm: float | None
    peak_n: float
    limit_n: float
    bound_n: float  # force limit plus the overshoot that the guard allows
    texture_um: float  # rms
    tip_kg: float  # moving mass of a finger

    @property
    def lost(self) -> bool:
        return self.outcome in LOST

    @property
    def smooth(self) -> bool:
        return self.texture_um < SMOOTH_UM

    @property
    def holdable(self) -> bool:
        return self.least_n <= self.limit_n


@cache
def _base(name: str, detector: str | None, keep: bool) -> LiftConfig:
    settings = (f"controller.keep={str(keep).lower()}",)
    return load_config(name, "simulated", detector, None, settings).for_lift()


def sampled(task: Task) -> LiftConfig:
    """Settings of that lift."""
    rng = np.random.default_rng([task.seed, TRIAL])
    keep = task.seed % SET_DOWN_EVERY != 0
    name = PAPER_OBJECTS[int(rng.integers(len(PAPER_OBJECTS)))]
    config, replace = _base(name, task.detector, keep), msgspec.structs.replace
    hand = replace(
        config.hand, command_latency_s=rng.uniform(*LATENCY_S), debounce_s=rng.uniform(*DEBOUNCE_S),
        tip_mass_kg=math.exp(rng.uniform(*np.log(TIP_KG))),
        refresh_hz=REFRESH_HZ[int(rng.integers(len(REFRESH_HZ)))],
    )  # fmt: skip
    variation = replace(
        config.variation, width_error_m=rng.uniform(*WIDTH_ERROR_M), aside_m=rng.uniform(*ASIDE_M),
        finger_scatter_m=rng.uniform(*SCATTER_M),
    )  # fmt: skip
    body = _body(config, rng) if rng.uniform() < 0.5 else _scaled(config.object, rng)
    return replace(config, object=body, hand=hand, variation=variation)


def _scaled(body: GraspObject, rng: np.random.Generator) -> GraspObject:
    friction, mass = rng.uniform(*FRICTION), math.exp(rng.uniform(*np.log(MASS)))
    return msgspec.structs.replace(
        body, friction_static=friction * body.friction_static,
        friction_kinetic=friction * body.friction_kinetic,
        mass_kg=mass * body.mass_kg, added_mass_kg=mass * body.added_mass_kg,
    )  # fmt: skip


def _body(config: LiftConfig, rng: np.random.Generator) -> GraspObject:
    return random_object(SHAPES[int(rng.integers(len(SHAPES)))], LOAD, config, rng)


def trial(task: Task) -> Row:
    config = sampled(task)
    result = lift.run(config, task.seed, None).result
    if result is None or result.peak_force_n is None:
        raise RuntimeError(f"seed {task.seed}: no result")
    body, limit_n = cell_settings(config, task.seed)[0].body, config.guard.force_limit_n
    accelerated = GRAVITY_MPS2 + config.controller.lift_acceleration_mps2
    slip_m = result.slip_distance_m
    return Row(
        seed=task.seed, object=body.name, set_down=not config.controller.keep,
        outcome=result.outcome, cause=result.phases[-1].cause,
        least_n=body.least_holding_n(accelerated),
        slip_mm=None if slip_m is None else 1e3 * slip_m,
        peak_n=max(result.peak_force_n.values()), limit_n=limit_n,
        bound_n=limit_n + config.guard.overshoot_n,
        texture_um=1e6 * body.texture_rms_m, tip_kg=config.hand.tip_mass_kg,
    )  # fmt: skip


def options(parser: Parser) -> None:
    parser.add_argument("--lifts", type=whole(1, 10**7), default=LIFTS, metavar="N",
                        help="number of lifts (default: %(default)s)")  # fmt: skip
    parser.add_argument("--first-seed", type=whole(0, 10**9), default=0, metavar="N",
                        help="seed of the first lift; the others follow (default: 0)")  # fmt: skip
    parser.add_argument("--detector", metavar="NAME", help="default: the profile's")


def grid(args: argparse.Namespace) -> list[Task]:
    seeds = range(args.first_seed, args.first_seed + args.lifts)
    return [Task(seed, args.detector) for seed in seeds]


def clopper_pearson(k: int, n: int) -> tuple[float, float]:
    """Exact 95 % interval of a rate of k in n (Clopper and Pearson 1934), by bisection."""

    def at_most(most: int, p: float) -> float:  # probability of at most that many
        logs = (
            math.lgamma(n + 1) - math.lgamma(i + 1) - math.lgamma(n - i + 1)
            + i * math.log(p) + (n - i) * math.log1p(-p)
            for i in range(most + 1)
        )  # fmt: skip
        return math.fsum(map(math.exp, logs))

    def crossing(above: Callable[[float], bool]) -> float:
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if above(middle) else (low, middle)
        return 0.5 * (low + high)

    least = 0.0 if k == 0 else crossing(lambda p: 1.0 - at_most(k - 1, p) < 0.025)
    most = 1.0 if k == n else crossing(lambda p: at_most(k, p) > 0.025)
    return least, most


Test = Callable[[Row], bool]
GROUPS: dict[str, tuple[Test, Test]] = {
    "dropped, of all": (lambda r: r.lost, lambda r: True),
    "dropped, of holdable": (lambda r: r.lost, lambda r: r.holdable),
    "dropped, of holdable and set down": (lambda r: r.lost, lambda r: r.holdable and r.set_down),
    "slid out, of holdable and smooth (texture below 0.1 mm rms)": (
        lambda r: r.outcome == LiftOutcome.DROPPED, lambda r: r.holdable and r.smooth),
    "slid out, of holdable and rougher": (
        lambda r: r.outcome == LiftOutcome.DROPPED, lambda r: r.holdable and not r.smooth),
    "squeezed out past the widest point, of holdable": (
        lambda r: r.outcome == LiftOutcome.EXPELLED, lambda r: r.holdable),
    "true force above limit plus overshoot": (lambda r: r.peak_n > r.bound_n, lambda r: True),
    "the same, tip mass up to the assumed one": (
        lambda r: r.peak_n > r.bound_n, lambda r: r.tip_kg <= HandSettings().tip_mass_kg),
}  # what is counted, and among which lifts  # fmt: skip


def rates(rows: Sequence[Row]) -> list[tuple[str, int, int, float, float]]:
    """Of each group: name, lifts counted, of how many lifts, and the interval of their rate."""
    found = []
    for name, (counts, among) in GROUPS.items():
        group = [row for row in rows if among(row)]
        hits = sum(map(counts, group))
        ends = clopper_pearson(hits, len(group)) if group else (0.0, 1.0)
        found.append((name, hits, len(group), *ends))
    return found


def table(rows: Sequence[Row]) -> str:
    """Rates with intervals, all outcomes, and the causes of drops that the limit could hold."""
    rated = [(*counted, f"{100 * low:.3f}-{100 * high:.3f}") for *counted, low, high in rates(rows)]
    outcomes = Counter((row.holdable, row.outcome) for row in rows).most_common()
    causes = Counter(
        (row.outcome, row.cause) for row in rows if row.lost and row.holdable
    ).most_common()
    kinds = [("yes" if able else "no", outcome, n) for (able, outcome), n in outcomes]
    drops = [(outcome, cause, n) for (outcome, cause), n in causes]
    return "\n\n".join(
        markdown(dict(zip(names, zip(*lines, strict=True), strict=True)))
        for names, lines in (
            (("rate", "lifts", "of", "95 % interval, %"), rated),
            (("holdable", "outcome", "lifts"), kinds),
            (("outcome of a holdable drop", "last phase ended because", "lifts"), drops),
        ) if lines
    )  # fmt: skip


STUDY = Study("drop rate and rate of excess force over random objects, offsets and hands",
              grid, trial, Row, table, None, options)  # fmt: skip
