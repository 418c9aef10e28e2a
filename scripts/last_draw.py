"""Detectors on a draw that nothing was settled on: taps, lifts, data sets, the real clip.

    python scripts/last_draw.py --data DIR... [--recording FILE [--weights FILE...]] [--out FILE]
    python scripts/last_draw.py --first-seed 90000 92000 --objects can box  a look on other seeds

Taps of the six objects and of the second half dozen at five strengths are run once, with nobody
answering; every detector hears the same counts and decides by its packaged rule. Lifts are run in
the loop, each with every detector. Every tap and every lift of an object has a seed of its own, and
so a hand: intervals take trials for independent. Data sets are new draws too: every recording under
the folders is scored. Prints Markdown tables, each under the entry that the pages ask for; whatever
they say is reported, and nothing is tuned on it: looks are taken on other seeds.
"""

import argparse
import itertools
import math
import shlex
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean, variance
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import registered_events
from detector.interface import DETECTORS
from detector.network_file import read_network
from detector.recordings import read
from detector.scores.evaluation import Evaluation, evaluate_recording, stream
from detector.scores.quantiles import Quantiles, quantiles
from grasp.loop import Tick
from grasp.settings import UNSEEN, names
from scenarios.benchmark.scoring import contender, read_split
from scenarios.campaign.config import load_config
from scenarios.campaign.paper import wilson
from scenarios.lab.fit import quantile_t
from scenarios.lift import lift
from scenarios.rigs.workers import Workers, results
from scenarios.tap import tap
from scenarios.trial.result import versions
from scenarios.trial.series import Bench

STRENGTHS = (0.2, 0.4, 0.6, 0.8, 1.0)  # of the blow that moves the object 7 mm
# of the draw; no campaign, figure or test has it; 50, 70, 80 and 100 thousand are spent
FIRST_SEED = 130_000
OBJECTS = (*names("objects"), *names(f"objects/{UNSEEN}"))
SEEDS = 100  # of an object
TAP_SEEDS = 40  # of those the taps', whatever is asked for; the others are the lifts'
SOON_MS = 100.0
CLASSES = {"2 mm or more": (2.0, np.inf), "1-2 mm": (1.0, 2.0), "0.5-1 mm": (0.5, 1.0),
           "within 0.5 mm": (0.0, 0.5)}  # fmt: skip


class Struck(NamedTuple):  # a struct of this file would not reach a worker
    """A tap as every detector hears it: frames since the detector was last reset."""

    object: str
    moved_mm: float
    struck_s: float
    onset_s: float
    until_s: float
    t_s: NDArray[np.float64]
    counts: NDArray[np.int16]


class Lifted(NamedTuple):
    """A lift in the loop."""

    object: str
    seed: int
    outcome: str
    held: bool
    reaction_ms: float | None
    slip_mm: float | None


class Draw(NamedTuple):
    """How many trials of each object, and the first seed of all."""

    first_seed: int
    taps: int  # of each strength
    lifts: int  # with every detector

    def of_taps(self, name: str) -> list[range]:
        """The seeds of an object's taps, a strength each."""
        first = self.first_seed + SEEDS * OBJECTS.index(name)
        return [range(first + i * self.taps, first + (i + 1) * self.taps)
                for i in range(len(STRENGTHS))]  # fmt: skip

    def of_lifts(self, name: str) -> range:
        """The seeds of an object's lifts, the same with every detector."""
        first = self.first_seed + SEEDS * OBJECTS.index(name) + TAP_SEEDS
        return range(first, first + self.lifts)

    @property
    def overlaps(self) -> bool:
        """Whether an object has more trials than seeds of its own."""
        return len(STRENGTHS) * self.taps > TAP_SEEDS or self.lifts > SEEDS - TAP_SEEDS


def taps(draw: Draw, name: str) -> Iterator[Struck]:
    for strength, seeds in zip(STRENGTHS, draw.of_taps(name), strict=True):
        words = [f"tap.strength={strength}"]
        config = load_config(name, "simulated", None, None, words).for_tap()
        ticks: list[Tick] = []
        for finished in tap.run_series(config, seeds, Bench(on_tick=ticks.append)):
            r = finished.result
            if r is not None and r.struck_s is not None and r.displacement_m is not None:
                t_s, counts = _since_reset(ticks, r.struck_s)
                onset_s = r.struck_s if r.slip_onset_s is None else r.slip_onset_s
                until_s = r.watched_until_s or np.inf
                yield Struck(
                    name, 1e3 * r.displacement_m, r.struck_s, onset_s, until_s, t_s, counts
                )
            ticks.clear()


def _since_reset(
    ticks: Sequence[Tick], struck_s: float
) -> tuple[NDArray[np.float64], NDArray[np.int16]]:
    first = 0
    for i, tick in enumerate(ticks):
        if tick.decision.reset_detector and tick.t_ns * 1e-9 < struck_s:
            first = i + 1
    heard = [tick for tick in ticks[first:] if tick.frame is not None]
    counts = np.stack([tick.frame.counts for tick in heard if tick.frame is not None])
    return np.array([tick.t_ns * 1e-9 for tick in heard]), counts


def answers_ms(detector: str, struck: Sequence[Struck]) -> NDArray[np.float64]:
    """From each one's first motion to the alarm that begins after the blow; infinite: none."""
    config = load_config("can", "simulated", detector)
    made = config.make_detector(3)
    found = []
    for s in struck:
        p, _ = stream(made, s.counts)
        at_s = s.t_s[registered_events(p, config.rule)[:, 0]]
        after = at_s[(at_s >= s.struck_s) & (at_s <= s.until_s)]
        found.append(1e3 * (after[0] - s.onset_s) if len(after) else np.inf)
    return np.array(found)


def all_taps(draw: Draw, name: str) -> list[Struck]:
    """Of one object: a task of a worker's."""
    return list(taps(draw, name))


def all_lifts(draw: Draw, task: tuple[str, str]) -> tuple[str, list[Lifted]]:
    """Of one object and detector, and that detector: a task of a worker's."""
    return task[1], list(lifts(draw, *task))


def lifts(draw: Draw, name: str, detector: str, words: Sequence[str] = ()) -> Iterator[Lifted]:
    config = load_config(name, "simulated", detector, None, words).for_lift()
    for seed in draw.of_lifts(name):
        r = lift.run(config, seed, None).result
        if r is not None:
            slip_mm = None if r.slip_distance_m is None else 1e3 * r.slip_distance_m
            yield Lifted(
                name, seed, str(r.outcome), bool(r.success), r.reaction_latency_ms, slip_mm
            )


def share(hits: int, n: int) -> str:
    if not n:
        return "–"
    low, high = wilson(hits, n)
    return f"{hits} of {n} ({100 * hits / n:.0f} % [{100 * low:.0f}, {100 * high:.0f}])"


def of(q: Quantiles | None, digits: int = 0) -> str:
    return "–" if q is None else " / ".join(f"{v:.{digits}f}" for v in (q.p50, q.p90, q.p99))


def entry(kind: str) -> str:
    """The comment that stands above a table of the pages; its code is what a trial rests on."""
    command = shlex.join(["python", "scripts/last_draw.py", *sys.argv[1:]])
    said = f'id=last-draw-{kind} command="{command}" detector=all commit={versions()["commit"]}'
    return f"\n<!-- figure: {said} code=@trial,scenarios/lift,scenarios/tap -->\n"


def table(*heads: str) -> list[str]:
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]


def tap_table(struck: Sequence[Struck], answers: dict[str, NDArray[np.float64]]) -> str:
    moved = np.array([s.moved_mm for s in struck])
    lines = table(
        "detector", "2 mm or more, within 100 ms", "1-2 mm", "0.5-1 mm", "within 0.5 mm (false)",
        "ms after first motion, p50 / p90 / p99 of those of 2 mm",
    )  # fmt: skip
    for name, delay in answers.items():
        cells = []
        for title, (low, high) in CLASSES.items():
            which = (moved >= low) & (moved < high)
            heard = delay <= SOON_MS if title == "2 mm or more" else np.isfinite(delay)
            cells.append(share(int((which & heard).sum()), int(which.sum())))
        far = moved >= CLASSES["2 mm or more"][0]
        lines.append(f"| `{name}` | {' | '.join(cells)} | {of(quantiles(delay[far]))} |")
    return "\n".join(lines)


def tap_objects(struck: Sequence[Struck], answers: dict[str, NDArray[np.float64]]) -> str:
    moved = np.array([s.moved_mm for s in struck])
    held = np.array([s.object for s in struck])
    far, near = (moved >= low for low in (CLASSES["2 mm or more"][0], CLASSES["1-2 mm"][0] / 2))
    lines = table("object", *(f"`{name}`" for name in answers))
    for o in sorted(set(held)):
        mine = held == o
        cells = [
            f"{(mine & far & (d <= SOON_MS)).sum()} of {(mine & far).sum()}, "
            f"{(mine & ~near & np.isfinite(d)).sum()} of {(mine & ~near).sum()}"
            for d in answers.values()
        ]
        lines.append(f"| {o} | {' | '.join(cells)} |")
    return "\n".join(lines)


def lift_table(lifted: dict[str, list[Lifted]]) -> str:
    lines = table(
        "detector", "held", "force rises after onset, ms, p50 / p90 / p99", "slipped, mm",
        "otherwise",
    )  # fmt: skip
    for name, every in lifted.items():
        lost = [r.outcome for r in every if not r.held]
        other = ", ".join(f"{lost.count(o)} {o}" for o in sorted(set(lost)))
        held = share(sum(r.held for r in every), len(every))
        slipped = quantiles(r.slip_mm for r in every if r.slip_mm is not None)
        lines.append(
            f"| `{name}` | {held} | {of(reaction(every))} | {of(slipped, 1)} | {other or '–'} |"
        )
    return "\n".join(lines)


def reaction(every: Sequence[Lifted]) -> Quantiles | None:
    """Of what slipped; infinite where the force never rose."""
    return quantiles(r.reaction_ms for r in every if r.slip_mm is not None)


def lift_objects(lifted: dict[str, list[Lifted]]) -> str:
    lines = table("object", *(f"`{name}`" for name in lifted))
    for o in sorted({r.object for every in lifted.values() for r in every}):
        cells = []
        for every in lifted.values():
            mine = [r for r in every if r.object == o]
            cells.append(f"{sum(r.held for r in mine)} of {len(mine)}, {of(reaction(mine))}")
        lines.append(f"| {o} | {' | '.join(cells)} |")
    return "\n".join(lines)


def data_rows(folders: Sequence[Path], name: str) -> list[str]:
    """Of one detector, on each data set and on all: a task of a worker's."""
    each = [contender(name, read_split([folder], "all"), folder.name) for folder in folders]
    streams = [stream for made in each for stream in made.streams]
    whole = msgspec.structs.replace(each[0], streams=streams, data="all")
    return [_data_row(name, made.data, made.evaluation()) for made in (*each, whole)]


def _data_row(name: str, data: str, s: Evaluation) -> str:
    blows = s.blows and (f"{s.blows.far_registered} of {s.blows.far}; "
                         f"{s.blows.unmoved_registered} of {s.blows.unmoved}")  # fmt: skip
    return (
        f"| `{name}` | {data} | {_with(s, 'accuracy', 100.0, 1)} | {_with(s, 'auc')} "
        f"| {s.event_recall or 0:.3f} | {s.false_events_per_min_hand or 0:.2f} "
        f"| {of(s.delay_ms)} | {blows or '–'} |"
    )


def data_table(detectors: Sequence[str], folders: Sequence[Path], workers: Workers) -> str:
    lines = table(
        "detector", "data", "accuracy, %", "AUC", "recall", "false a minute, hand",
        "delay, ms, p50 / p90 / p99", "blows of 2 mm within 100 ms; idle ones",
    )  # fmt: skip
    for rows in results(partial(data_rows, folders), detectors, workers):
        lines += rows
    return "\n".join(lines)


def clip_table(detectors: Sequence[str], clip: Path, weights: Sequence[Path]) -> str:
    """The packaged ones, then every seed of those whose weights are given, their means and how much
    less one has than the other."""
    lines = table("detector", "AUC", "accuracy at the deployed threshold, %", "caught", "false")
    areas: dict[str, list[float]] = {}
    named: list[tuple[str, Path | None]] = [(name, None) for name in detectors]
    named += [(read_network(file).card.name, file) for file in weights]
    for name, file in named:
        words = [] if file is None else [f"network.weights={file}"]
        config = load_config("can", "simulated", name, None, words)
        s = evaluate_recording(config.make_detector(1), config.rule, read(clip))
        if file is not None:
            areas.setdefault(name, []).append(s.auc or 0.0)
        said = f"`{name}`" if file is None else file.stem
        caught = f"{s.true_events - s.missed_events} of {s.true_events}"
        lines.append(f"| {said} | {_with(s, 'auc')} | {_with(s, 'accuracy', 100.0, 1)} | {caught} "
                     f"| {s.false_events} |")  # fmt: skip
    means = [f"`{n}`, mean of {len(a)} seeds: AUC {fmean(a):.3f}" for n, a in areas.items()]
    return "\n".join(
        [*lines, "", *means, *map(less_text, itertools.combinations(areas.items(), 2))]
    )


class Less(NamedTuple):
    """What one mean is less than another, and its 95 % interval; None: too few seeds for one."""

    mean: float
    interval: tuple[float, float] | None


def less_over_seeds(a: Sequence[float], b: Sequence[float]) -> Less:
    """The mean of ``a`` less that of ``b`` by Welch: seeds of both drawn anew, their spreads not
    taken for equal. What was scored stands still: its own strokes or recordings are not drawn."""
    mean = fmean(a) - fmean(b)
    if min(len(a), len(b)) < 2:
        return Less(mean, None)
    parts = [(variance(x) / len(x), len(x) - 1) for x in (a, b)]
    square = sum(part for part, _ in parts)
    if square == 0.0:
        return Less(mean, (mean, mean))
    freedom = square**2 / sum(part**2 / n for part, n in parts)
    half = student(freedom) * math.sqrt(square)
    return Less(mean, (mean - half, mean + half))


def student(freedom: float) -> float:
    """What 95 % lie within on either side, by Student's distribution; between whole degrees of
    freedom in proportion to one over them, in which it is nearly straight."""
    low = math.floor(freedom)
    below, above = (quantile_t(0.975, whole) for whole in (low, low + 1))
    return below + (above - below) * (1 / low - 1 / freedom) / (1 / low - 1 / (low + 1))


def less_text(pair: tuple[tuple[str, Sequence[float]], tuple[str, Sequence[float]]]) -> str:
    """One network's seeds beside another's, as a person reads it."""
    (one, a), (other, b) = pair
    mean, interval = less_over_seeds(a, b)
    told = f"`{one}` less `{other}`, in the mean: AUC {mean:+.3f}"
    if interval is None:
        return told
    low, high = interval
    return f"{told} [{low:+.3f}, {high:+.3f}], 95 % over seeds alone (Welch), not over strokes"


def _with(s: Evaluation, name: str, times: float = 1.0, digits: int = 3) -> str:
    low, high = s.intervals.get(name, (np.nan, np.nan))
    value, low, high = (times * x for x in (getattr(s, name) or 0.0, low, high))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--data", type=Path, nargs="*", default=[])
    parser.add_argument("--recording", type=Path)
    parser.add_argument("--weights", type=Path, nargs="*", default=[], help="other seeds, for it")
    parser.add_argument("--detectors", nargs="+", default=DETECTORS)
    parser.add_argument("--objects", nargs="+", choices=OBJECTS, default=OBJECTS)
    parser.add_argument("--taps", type=int, default=8, help="an object and strength")
    parser.add_argument("--lifts", type=int, default=10, help="an object and detector")
    parser.add_argument(
        "--first-seed", type=int, nargs="+", default=[FIRST_SEED], help="of several, all together"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    draws = [Draw(first, args.taps, args.lifts) for first in args.first_seed]
    if any(draw.overlaps for draw in draws):
        parser.error(
            f"an object has {TAP_SEEDS} seeds of taps, {SEEDS - TAP_SEEDS} of lifts: ask for fewer"
        )
    workers = Workers(args.jobs)
    rows: list[dict[str, object]] = []
    if args.taps:
        found = [made for draw in draws
                 for made in results(partial(all_taps, draw), args.objects, workers)]  # fmt: skip
        struck = sorted((s for of_object in found for s in of_object), key=lambda s: s.object)
        answers = {d: answers_ms(d, struck) for d in args.detectors}
        print(f"{len(struck)} taps\n{entry('taps')}\n{tap_table(struck, answers)}")
        print(f"{entry('taps-objects')}\n{tap_objects(struck, answers)}", flush=True)
        rows = [{"object": s.object, "moved_mm": s.moved_mm,
                 "answers_ms": {d: float(a[i]) for d, a in answers.items()}}
                for i, s in enumerate(struck)]  # fmt: skip
    lifted: dict[str, list[Lifted]] = {d: [] for d in args.detectors}
    if args.lifts:
        tasks = [(o, d) for o in args.objects for d in args.detectors]
        for draw in draws:
            for detector, made in results(partial(all_lifts, draw), tasks, workers):
                lifted[detector] += made
        print(f"{entry('lifts')}\n{lift_table(lifted)}")
        print(f"{entry('lifts-objects')}\n{lift_objects(lifted)}", flush=True)
    if args.data:
        print(f"{entry('data')}\n{data_table(args.detectors, args.data, workers)}", flush=True)
    if args.recording is not None:
        clip = clip_table(args.detectors, args.recording, args.weights)
        print(f"{entry('clip')}\n{clip}", flush=True)
    if args.out is not None:
        args.out.write_bytes(
            msgspec.json.encode(
                {
                    "taps": rows,
                    "lifts": {d: [r._asdict() for r in made] for d, made in lifted.items()},
                }
            )
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
