"""Search for finger positions, in whole counts, that hold an object but let it slip in the lift.

The paper's lift needs a grasp that keeps contact and is too weak. It calls such grasps challenging
to find (section V-C): one motor count is 2 to 4 N on a rigid object. Individual finger positions
give finer steps. The contact law's balance of forces scores all triples near first contact, on many
samples of the variation between trials.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import UsageError
from drivers.interfaces import Counts3
from grasp.cli.options import OBJECT_HELP, Settings, decimal, whole
from grasp.cli.parser import Parser
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import open_loop_onset_s
from scenarios.rigs.simulated import TrialSample, sample_trial
from scenarios.world import contact, laws
from scenarios.world.contact import Floats
from scenarios.world.settings import HALF_APERTURE_M
from studies.runner import PAPER_OBJECTS, Study, markdown

REACH_COUNTS = 4  # search range beyond first contact
SHOWN = 5  # of the triples found


FAILURES = {
    "loose": "thumb too loose",
    "firm": "thumb too firm",
    "finger": "B or C too loose",
    "holds": "does not slip",
}  # in words, by the keys of `Grip.fails`


class Criteria(msgspec.Struct, frozen=True):
    """A grasp that is weak enough; the paper gives no numbers."""

    least_n: float = 0.5  # at the thumb, after relaxation of the rubber
    most_n: float = 3.0  # at the thumb, at first
    finger_n: float = 0.1  # at both other fingers, at least
    slip_margin: float = 0.05  # friction must carry less than the weight by this share
    least_sure: float = 0.99  # share of samples without a failed criterion
    samples: int = 200  # of the variation between trials


class Task(msgspec.Struct, frozen=True):
    """An object to search grips for."""

    config: LiftConfig
    criteria: Criteria
    verify: int  # simulated lifts without reaction


class Grip(msgspec.Struct, frozen=True):
    """A triple of positions with its forces over all sampled variations."""

    counts: Counts3
    thumb_n: tuple[float, float, float]  # least (relaxed), median, most
    finger_n: float  # least of B and C, relaxed
    carried: float  # most of the weight that friction carries, at first
    fails: dict[str, float]  # shares of samples: loose, firm, finger (lost contact), holds
    sure: float  # share of samples without a failed criterion

    def meets(self, criteria: Criteria) -> bool:
        """Whether it slips in every sample and rarely fails another criterion."""
        return self.fails["holds"] == 0.0 and self.sure >= criteria.least_sure


class Row(msgspec.Struct, frozen=True):
    """The object's configured positions, the best ones found, and lifts with the best one."""

    object: str
    present: Grip
    found: list[Grip]
    meets: bool
    slipped: int
    lifts: int


def options(parser: Parser) -> None:
    default = Criteria()
    parser.add_argument("--objects", nargs="+", default=PAPER_OBJECTS, metavar="NAME",
                        help=OBJECT_HELP)  # fmt: skip
    for name in ("least", "most"):
        parser.add_argument(f"--{name}", type=decimal(0, 10), default=getattr(default, f"{name}_n"),
                            metavar="N", help="force at the thumb, N")  # fmt: skip
    parser.add_argument("--samples", type=whole(1, 10_000), default=default.samples, metavar="N",
                        help="of the variation between trials (default: %(default)s)")  # fmt: skip
    parser.add_argument("--verify", type=whole(0, 10_000), default=5, metavar="N",
                        help="lifts without slip response; each must slip")  # fmt: skip
    Settings.add_to(parser)


def grid(args: argparse.Namespace) -> list[Task]:
    if args.least >= args.most:
        raise UsageError(f"--least {args.least:g} N is not below --most {args.most:g} N",
                         "give a larger --most")  # fmt: skip
    criteria = Criteria(least_n=args.least, most_n=args.most, samples=args.samples)
    return [
        Task(load_config(name, "simulated", None, args.config, args.set).for_lift(), criteria,
             args.verify)
        for name in args.objects
    ]  # fmt: skip


def trial(task: Task) -> Row:
    config, criteria = task.config, task.criteria
    found = search(config, criteria)
    body = msgspec.structs.replace(config.object, grip_counts=found[0].counts)
    best = msgspec.structs.replace(config, object=body)
    slipped = sum(open_loop_onset_s(best, seed) is not None for seed in range(task.verify))
    return Row(config.object.name, present(config, criteria), found[:SHOWN],
               found[0].meets(criteria), slipped, task.verify)  # fmt: skip


def search(config: LiftConfig, criteria: Criteria) -> list[Grip]:
    """All triples near first contact, best first: fewest failed samples, then the middle force."""
    trials = _trials(config, criteria.samples)
    grips = [_evaluated(config, criteria, counts, trials) for counts in _candidates(config)]
    middle_n = 0.5 * (criteria.least_n + criteria.most_n)
    return sorted(
        grips,
        key=lambda g: (
            -g.sure,
            abs(round(g.thumb_n[1] - middle_n, 6)),
            max(g.counts) - min(g.counts),
        ),
    )


def present(config: LiftConfig, criteria: Criteria) -> Grip:
    """The grip at the object's configured positions."""
    trials = _trials(config, criteria.samples)
    return _evaluated(config, criteria, config.object.grip_counts, trials)


def _evaluated(
    config: LiftConfig, criteria: Criteria, counts: Counts3, trials: list[TrialSample]
) -> Grip:
    pressed, carried = _forces(config, counts, trials)
    relaxed = pressed * (1 - config.contact.relaxation_fraction)
    flags = {
        "loose": relaxed[:, 0] < criteria.least_n,
        "firm": pressed[:, 0] > criteria.most_n,
        "finger": relaxed[:, 1:].min(axis=1) < criteria.finger_n,
        "holds": carried > 1.0 - criteria.slip_margin,
    }
    thumb = relaxed[:, 0].min(), np.median(pressed[:, 0]), pressed[:, 0].max()
    return Grip(
        counts=counts,
        thumb_n=(float(thumb[0]), float(thumb[1]), float(thumb[2])),
        finger_n=float(relaxed[:, 1:].min()),
        carried=float(carried.max()),
        fails={name: float(flag.mean()) for name, flag in flags.items()},
        sure=float((~np.any(list(flags.values()), axis=0)).mean()),
    )


def _trials(config: LiftConfig, draws: int) -> list[TrialSample]:
    return [
        sample_trial(config.variation, config.object, config.hand, np.random.default_rng(child))
        for child in np.random.SeedSequence(0).spawn(draws)
    ]


def _candidates(config: LiftConfig) -> Iterator[Counts3]:
    """Triples around first contact. B and C are alike, so one order of the two is enough. The
    object is free along the closing axis, so triples about its middle are enough."""
    p = contact.parameters(config.contact, config.object)
    width_m, _ = laws.width_and_slope(p, 0.0)
    first = int((HALF_APERTURE_M - width_m) / config.hand.m_per_count)
    near = range(max(0, first - 2), min(255, first + REACH_COUNTS) + 1)
    for a, b, c in itertools.product(near, near, near):
        if c <= b <= c + 1 and abs(2 * a - b - c) <= 2:
            yield a, b, c


def _forces(
    config: LiftConfig, counts: Counts3, trials: list[TrialSample]
) -> tuple[Floats, NDArray[np.float64]]:
    """Initial normal forces (n, 3), N, and the share (n,) of the weight that friction carries."""
    pressed = np.zeros((len(trials), contact.FINGERS))
    carried = np.zeros(len(trials))
    for k, one in enumerate(trials):
        p = contact.parameters(config.contact, one.body)
        width_m, slope = laws.width_and_slope(p, 0.0)
        travel = config.hand.m_per_count * np.array(counts, float) + one.finger_offset_m
        laws.normal_forces(p, width_m, travel, contact.initial_state(), pressed[k])
        flank = slope + one.body.friction_static / np.sqrt(1 + slope * slope)
        mass_kg = one.body.mass_kg + one.body.added_mass_kg
        carried[k] = pressed[k].sum() * flank / (mass_kg * contact.GRAVITY_MPS2)
    return pressed, carried


def table(rows: Sequence[Row]) -> str:
    lines = [("now", row.object, row.present) for row in rows]
    lines += [(f"{i + 1}", row.object, g) for row in rows for i, g in enumerate(row.found)]
    lines.sort(key=lambda line: line[1])
    grips = [grip for *_, grip in lines]
    text = markdown({
        "object": [name for _, name, _ in lines],
        "rank": [rank for rank, *_ in lines],
        "counts A B C": ["{} {} {}".format(*g.counts) for g in grips],
        "thumb, N: least (relaxed pads)": [f"{g.thumb_n[0]:.2f}" for g in grips],
        "median": [f"{g.thumb_n[1]:.2f}" for g in grips],
        "most": [f"{g.thumb_n[2]:.2f}" for g in grips],
        "friction carries at most, %": [100 * g.carried for g in grips],
        "samples that fail a criterion, %": [_failures(g) for g in grips],
    })  # fmt: skip
    found = [
        f"{row.object}: {row.slipped} of {row.lifts} lifts with the best slipped; the criteria are "
        + ("met." if row.meets else f"not met by {_failures(row.found[0])} % of its samples.")
        for row in rows
    ]
    return "\n".join([text, "", *found])


def _failures(grip: Grip) -> str:
    """Criteria that samples of a grip fail, with the share in percent."""
    shares = [f"{FAILURES[name]} {100 * f:.1f}" for name, f in grip.fails.items() if f]
    return ", ".join(shares) or "none"


STUDY = Study("finger positions that hold an object too weakly to lift it", grid, trial, Row, table,
              options=options)  # fmt: skip
