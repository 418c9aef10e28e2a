"""What could be told of the last draw's own lifts, and how soon: the bound of when force can rise.

    python scripts/lift_bound.py --data data/observer/run
    python scripts/lift_bound.py --first-seed 120000 --data data/observer/run         other lifts

The lifts of `scripts/last_draw.py` are run with nobody answering, so that the slip goes on. The
ideal observer (`grasp chart observer`, extra `train`) has learnt from the lifts of data sets, from
which no detector may have learnt, and knows nothing of the twelve objects. It is told when gross
slip set in, as no detector is, and asked so much later, with all counts until then and what `tcn`
and `gru` said. It calls slip what scores above all but so many of the moments in which drawn
objects are held, by observers that have not learnt from those: so many at each time by itself,
where a detector's share is of moments that it answers at any time within half a second, and so the
observer is flattered. Beside it the detectors on the same lifts: by the most that they said in one
sample, told when as the observer is, and by their own rules; an alarm that is on already when slip
sets in tells nothing. Nothing is tuned on it.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from detector.interface import DETECTORS
from detector.recordings import Recording
from detector.scores.evaluation import Streamed
from detector.scores.quantiles import quantile
from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGERS
from grasp.cli.options import need, whole
from grasp.loop import Tick
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.rigs.workers import Workers, results
from scenarios.studies.detectors.observer import (
    AFTER_S,
    FOLDS,
    LIFT_TITLES,
    Cases,
    Moment,
    cases,
    features,
    heard,
    hits,
    lift_moments,
)
from scripts.last_draw import FIRST_SEED, OBJECTS, Draw

TIMES_S = (0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2)
HEARD = ("tcn", "gru")  # by the observer
IDLE_SHARES = (0.05, 0.1)  # of the moments in which what is held stays
UNANSWERED = ("controller.reactions=false", "controller.keep=true")
RESAMPLES, SEED = 2000, 0
Floats = NDArray[np.float64]


class Slipped(NamedTuple):  # a struct of this file would not reach a worker
    """A lift that nobody answers."""

    object: str
    onset_s: float  # of gross slip
    reset: int  # the first sample after the detector was last reset before it
    t_s: Floats
    counts: NDArray[np.int16]

    @property
    def recording(self) -> Recording:
        """As the observer reads it; what slipped is not asked of it."""
        still = np.zeros(len(self.t_s), dtype=np.bool_)
        return Recording(self.t_s, self.counts, still, None, f"a lift of {self.object}")

    @property
    def onset(self) -> int:
        """The first sample after slip set in."""
        return int(np.searchsorted(self.t_s, self.onset_s, side="right"))


def slips(draw: Draw, name: str) -> Iterator[Slipped]:
    config = load_config(name, "simulated", None, None, UNANSWERED).for_lift()
    for seed in draw.of_lifts(name):
        ticks: list[Tick] = []
        result = lift.run(config, seed, None, ticks.append).result
        if result is None or result.slip_onset_s is None:
            continue
        frames = [(tick.t_ns * 1e-9, tick.frame.counts) for tick in ticks if tick.frame is not None]
        t_s = np.array([t for t, _ in frames])
        resets = [tick.t_ns * 1e-9 for tick in ticks if tick.decision.reset_detector]
        last_s = max((t for t in resets if t < result.slip_onset_s), default=-np.inf)
        reset = int(np.searchsorted(t_s, last_s, side="right"))
        counts = np.stack([counts for _, counts in frames])
        yield Slipped(name, result.slip_onset_s, reset, t_s, counts)


def all_slips(draw: Draw, name: str) -> list[Slipped]:
    """Of one object: a task of a worker's."""
    return list(slips(draw, name))


def heard_of(names: Sequence[str], slipped: Sequence[Slipped]) -> dict[str, list[Streamed]]:
    """What detectors say of the lifts: as in a run, nothing before they were reset."""
    whole = [s.recording for s in slipped]
    since = [replace(r, t_s=r.t_s[s.reset :], counts=r.counts[s.reset :], slip=r.slip[s.reset :])
             for r, s in zip(whole, slipped, strict=True)]  # fmt: skip
    found = {}
    for name, streams in heard(names, since).items():
        found[name] = [
            replace(made, recording=r,
                    probabilities=np.pad(made.probabilities, ((s.reset, 0), (0, 0))))
            for made, r, s in zip(streams, whole, slipped, strict=True)
        ]  # fmt: skip
    return found


class Scores(NamedTuple):
    """How much likelier slip is than rest, so long after: of the lifts (n,), of rest (m,). Of each
    the group that it is drawn with, an object or a recording."""

    lifts: Floats
    rest: Floats
    objects: NDArray[np.intp]  # (n,)
    recordings: NDArray[np.intp]  # (m,)


def observed(
    asked: Cases, drawn: Cases, objects: NDArray[np.intp], time_s: float
) -> Scores:  # fmt: skip
    """What the observer says of the lifts, having learnt from all that is drawn, and of the moments
    of rest, each having learnt from other objects."""
    from detector.training.observer import held_out  # noqa: PLC0415  (torch only where asked)

    known = np.flatnonzero(drawn.lasts >= drawn.samples(time_s))
    part = drawn.part(known)
    of_lifts, of_drawn = features(asked, time_s), features(part, time_s)
    idle = part.classes == 0
    rest = _likelier(held_out(of_drawn, part.classes, part.groups, FOLDS))[idle]
    sets = np.repeat([0, 1], [len(of_lifts), len(of_drawn)])
    classes = np.concatenate([asked.classes, part.classes])
    told = held_out(np.concatenate([of_lifts, of_drawn]), classes, sets, 2)
    return Scores(_likelier(told[: len(of_lifts)]), rest, objects, part.groups[idle])


def surest(
    asked: Cases, drawn: Cases, objects: NDArray[np.intp], name: str, time_s: float
) -> Scores:  # fmt: skip
    """The most that a detector said in one sample since, of lifts and moments of rest: what it
    knows, whatever its rule makes of it, if it is told when as the observer is."""
    idle = drawn.part(np.flatnonzero((drawn.classes == 0) & (drawn.lasts >= drawn.samples(time_s))))
    of_lifts, of_rest = (c.said[name][:, : c.samples(time_s)].max(axis=1) for c in (asked, idle))
    return Scores(of_lifts, of_rest, objects, idle.groups)


def _likelier(told: Floats) -> Floats:
    odds: Floats = np.logaddexp.reduce(told[:, 1:], axis=1) - told[:, 0]
    return odds


def share(scores: Scores, idle_share: float) -> float:
    """Of the lifts, what scores above all but so much of rest."""
    moved = np.repeat([True, False], [len(scores.lifts), len(scores.rest)])
    return hits(np.concatenate([scores.lifts, scores.rest]), moved, idle_share)


def interval(scores: Scores, idle_share: float) -> tuple[float, float]:
    """95 % of that share: bootstrap over objects and over recordings of rest, the threshold found
    anew."""
    rng = np.random.default_rng(SEED)
    groups = [[np.flatnonzero(of == g) for g in np.unique(of)] for of in scores[2:]]
    drawn = []
    for _ in range(RESAMPLES):
        lifts, rest = (np.concatenate([its[i] for i in rng.integers(0, len(its), len(its))])
                       for its in groups)  # fmt: skip
        part = Scores(scores.lifts[lifts], scores.rest[rest], lifts, rest)
        drawn.append(share(part, idle_share))
    drawn.sort()
    return quantile(drawn, 0.025), quantile(drawn, 0.975)


def soonest_ms(shares: Sequence[float], wanted: float) -> float:
    """When so large a share is told: between two times on a straight line; infinite, if never."""
    times_ms = [0.0, *(1e3 * s for s in TIMES_S)]
    most = np.maximum.accumulate([0.0, *shares])
    if most[-1] < wanted:
        return np.inf
    at = int(np.argmax(most >= wanted))
    part = (wanted - most[at - 1]) / (most[at] - most[at - 1])
    return float(times_ms[at - 1] + part * (times_ms[at] - times_ms[at - 1]))


def scores_row(every: Sequence[Scores], idle_share: float) -> list[str]:
    """Shares at all times with their intervals, and when half and nine tenths are told."""
    shares = [share(scores, idle_share) for scores in every]
    limits = [interval(scores, idle_share) for scores in every]
    cells = [
        f"{100 * s:.0f} [{100 * low:.0f}, {100 * high:.0f}]"
        for s, (low, high) in zip(shares, limits, strict=True)
    ]
    return [
        f"{100 * idle_share:.0f}",
        *cells,
        *(f"{soonest_ms(shares, w):.0f}" for w in (0.5, 0.9)),
    ]


def detector_row(asked: Cases, drawn: Cases, name: str) -> list[str]:
    """The same of a detector by its own rule."""
    idle = float((drawn.answers_s[name][drawn.classes == 0] <= AFTER_S).mean())
    answers = np.sort(asked.answers_s[name])
    cells = [f"{100 * float((answers <= s).mean()):.0f}" for s in TIMES_S]
    middle, late = (1e3 * quantile(answers, q) for q in (0.5, 0.9))
    return [f"{100 * idle:.0f}", *cells, f"{middle:.0f}", f"{late:.0f}"]


def lifts_in(folders: Sequence[Path]) -> list[Recording]:
    """Recordings of lifts; ends the program where there are none that slip, or none that hold."""
    try:
        found = [r for r in read_split(folders, "all") if r.fingers == FINGERS]
    except BadFile as error:
        raise SystemExit(str(error)) from None
    kinds = {m.kind > 0 for m in lift_moments(found)}
    if kinds != {True, False}:
        raise SystemExit("--data: lifts that slip are needed, and some that hold")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True,
        help="recordings of `grasp chart observer --data DIR --share 1`: DIR/run",
    )  # fmt: skip
    parser.add_argument(
        "--detectors", nargs="+", choices=sorted(DETECTORS), default=["tcn", "gru", "energy"]
    )
    parser.add_argument("--lifts", type=whole(1, 60), default=10, help="of an object")
    parser.add_argument(
        "--first-seed", type=whole(0, 10**9), default=FIRST_SEED, help="(default: the last draw's)"
    )
    parser.add_argument("--jobs", type=whole(1, 64), default=2, help="worker processes")
    args = parser.parse_args()
    try:
        need("train", "torch")
    except UsageError as error:
        parser.error(str(error))
    sets, names = lifts_in(args.data), sorted({*HEARD, *args.detectors})
    print("running the lifts, then streaming and learning: some minutes", file=sys.stderr)
    draw = Draw(args.first_seed, 0, args.lifts)
    found = results(partial(all_slips, draw), OBJECTS, Workers(args.jobs))
    slipped = sorted((s for of_object in found for s in of_object), key=lambda s: s.object)
    recordings = [s.recording for s in slipped]
    # the class is asked of nobody: the observer tells slip of any speed from rest
    moments = [Moment(i, s.onset, len(s.t_s) - s.onset, 1) for i, s in enumerate(slipped)]
    asked = cases(recordings, moments, heard_of(names, slipped))
    drawn = cases(sets, lift_moments(sets), heard(names, sets))
    objects = np.array([OBJECTS.index(slipped[i].object) for i in asked.groups])
    counted = np.bincount(drawn.classes, minlength=len(LIFT_TITLES))
    print(f"{len(asked.classes)} lifts of {len(slipped)} have half a second before their slip; "
          f"learnt from {counted[1:].sum()} lifts that slip and {counted[0]} moments that do not\n",
          flush=True)  # fmt: skip
    after = (f"told after {1e3 * s:.0f} ms, %" for s in TIMES_S)
    heads = ["what hears", "moments of rest called slip, %", *after, "half, ms", "nine tenths, ms"]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for name in args.detectors:
        print(f"| `{name}`, own rule | {' | '.join(detector_row(asked, drawn, name))} |")
    for name in args.detectors:
        every = [surest(asked, drawn, objects, name, time_s) for time_s in TIMES_S]
        _print_rows(f"`{name}`, told when", every)
    for said in (HEARD, ()):
        views = [replace(c, said={n: c.said[n] for n in said}) for c in (asked, drawn)]
        every = [observed(views[0], views[1], objects, time_s) for time_s in TIMES_S]
        _print_rows("observer" if said else "observer, counts alone", every)
    return 0


def _print_rows(title: str, every: Sequence[Scores]) -> None:
    for idle_share in IDLE_SHARES:
        print(f"| {title} | {' | '.join(scores_row(every, idle_share))} |", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
