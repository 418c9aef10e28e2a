"""Which network is the default, by the rule that docs/default-detector.md writes down.

    grasp detector tune tcn --set network.weights=tcn-seed0.onnx --data DIR... > tcn-seed0.toml
    python scripts/default_choice.py --tcn tcn-seed0.onnx... --gru gru-seed0.onnx... --data DIR...
    python scripts/default_choice.py --anew SEED          the packaged two, on objects drawn anew

Every weights file is scored on the split `validation` with the rule in the TOML file of its name
that lies beside it; without files the packaged weights and rules are. `--split test` asks the same
of recordings on which nothing was chosen, and settles nothing. `--anew` draws 400 lifts and
100 recordings of nine blows as `config/datasets/grasped-slip.toml` has them, each of an object of
its own, and scores them all: nothing was chosen on them. Prints the three shares of each seed,
`tcn` less `gru` of their means with 95 % intervals (bootstrap over recordings; with the seeds drawn
as well in brackets of their own), and what the rule makes of them.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.blows import UNMOVED_M, blows_of
from detector.recordings import Recording
from detector.scores.blows import FAR_M, SOON_MS
from detector.scores.evaluation import (
    WARM_UP_SAMPLES,
    Judged,
    cause_of,
    events_by_label,
    judge_stream,
)
from detector.scores.intervals import HIGH, LOW, Interval
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.rigs.workers import Workers, results
from scenarios.studies.detectors.robustness import stream_together

MARGIN = -0.03  # not inferior: the lower bound of each difference above it
RESAMPLES = 2000
LIFTS = "grasped_slip"  # the cause of recordings in which a lifted object slips
ANEW = {"grasped_slip": 400, "grasped_blow": 100}  # recordings of a cause
Counts = NDArray[np.float64]  # (seeds, recordings)
Verdict = Literal["tcn", "gru", "draw"]


class Shares(msgspec.Struct, frozen=True, eq=False):
    """Of one measure: how often a network did right, of how many times it was asked."""

    right: Counts
    of: Counts

    def means(self, drawn: NDArray[np.int64]) -> NDArray[np.float64]:
        """(seeds,) shares over the drawn recordings (k,)."""
        found: NDArray[np.float64] = self.right[:, drawn].sum(1) / self.of[:, drawn].sum(1)
        return found


class Difference(msgspec.Struct, frozen=True):
    """`tcn` less `gru`, of the mean over seeds."""

    value: float
    interval: Interval  # recordings drawn
    with_seeds: Interval  # recordings and seeds drawn


def lifts_caught(recording: Recording, judged: Judged) -> tuple[int, int]:
    delays = judged.events.delays_ms if cause_of(recording) == LIFTS else np.empty(0)
    return int(np.isfinite(delays).sum()), len(delays)


def blows_registered(_: Recording, judged: Judged) -> tuple[int, int]:
    soon = judged.answers_ms[judged.moved_m >= FAR_M] <= SOON_MS
    return int(soon.sum()), len(soon)


def idle_unanswered(_: Recording, judged: Judged) -> tuple[int, int]:
    silent = np.isinf(judged.answers_ms[judged.moved_m < UNMOVED_M])
    return int(silent.sum()), len(silent)


MEASURES: dict[str, Callable[[Recording, Judged], tuple[int, int]]] = {
    "slips of lifts caught": lifts_caught,
    "blows of 2 mm within 100 ms": blows_registered,
    "blows within half a millimetre unanswered": idle_unanswered,
}


def drawn_anew(seed: int, workers: Workers, numbers: Mapping[str, int] = ANEW) -> list[Recording]:
    """Recordings of objects that no data set of another seed has, in the order of the draw."""
    config = load_dataset_config(config_dir() / "datasets" / "grasped-slip.toml")
    rows = [row for row in config.causes if row.cause in numbers]
    shares = [numbers[row.cause] / sum(numbers.values()) for row in rows]
    told = [msgspec.structs.replace(r, share=s) for r, s in zip(rows, shares, strict=True)]
    whole = msgspec.structs.replace(
        config, seed=seed, causes=told, recordings=sum(numbers.values())
    )
    made = results(make, plan(whole), workers)
    return sorted(made, key=lambda r: r.metadata.seed if r.metadata else 0)


def judged_by(name: str, weights: Path | None, recordings: Sequence[Recording]) -> list[Judged]:
    """What one seed's weights and their tuned rule make of each recording; none: as packaged."""
    words = () if weights is None else (f"network.weights={weights}",)
    rule = None if weights is None else weights.with_suffix(".toml")
    config = load_config("can", "simulated", name, rule, words)
    return [
        judge_stream(s, config.rule, events_by_label(s.label), WARM_UP_SAMPLES,
                     blows_of(s.recording))
        for s in stream_together(config.make_detector, recordings)
    ]  # fmt: skip


def shares(recordings: Sequence[Recording], seeds: Sequence[Sequence[Judged]]) -> dict[str, Shares]:
    """Every measure of a network's seeds, each judged on the same recordings."""
    found = {}
    for name, measure in MEASURES.items():
        told = np.array([
            [measure(r, judged) for r, judged in zip(recordings, each, strict=True)]
            for each in seeds
        ], np.float64)  # fmt: skip
        found[name] = Shares(told[..., 0], told[..., 1])
    return found


def difference(tcn: Shares, gru: Shares, seed: int = 0) -> Difference:
    rng = np.random.default_rng(seed)
    recordings = tcn.of.shape[1]
    every = np.arange(recordings)
    one, both = [], []
    for _ in range(RESAMPLES):
        drawn = rng.integers(0, recordings, size=(recordings,))
        means = tcn.means(drawn), gru.means(drawn)
        one.append(means[0].mean() - means[1].mean())
        again = [rng.choice(each, len(each)).mean() for each in means]
        both.append(again[0] - again[1])
    return Difference(
        float(tcn.means(every).mean() - gru.means(every).mean()), _interval(one), _interval(both)
    )


def _interval(values: Sequence[float]) -> Interval:
    low, high = np.nanquantile(values, (LOW, HIGH))
    return float(low), float(high)


def verdict(differences: Sequence[Difference]) -> Verdict:
    """`tcn` where it is not inferior, `gru` where it is worse in any measure, otherwise a draw."""
    if all(d.interval[0] > MARGIN for d in differences):
        return "tcn"
    return "gru" if any(d.interval[1] < 0.0 for d in differences) else "draw"


def table(tcn: dict[str, Shares], gru: dict[str, Shares]) -> tuple[str, Verdict]:
    """Markdown, and what the rule says."""
    differences = {name: difference(tcn[name], gru[name]) for name in MEASURES}
    rows = [
        f"| {name} | {_seeds(tcn[name])} | {_seeds(gru[name])} | {100 * d.value:+.1f} | "
        f"{_points(d.interval)} | {_points(d.with_seeds)} |"
        for name, d in differences.items()
    ]
    head = (
        "| | `tcn`, a seed each | `gru` | `tcn` less `gru`, points | recordings drawn "
        "| seeds as well |\n|---|---|---|---|---|---|"
    )
    return "\n".join([head, *rows]), verdict(list(differences.values()))


def _seeds(of: Shares) -> str:
    told = " / ".join(f"{right:.0f}" for right in of.right.sum(1))
    return f"{told} of {of.of[0].sum():.0f}"


def _points(interval: Interval) -> str:
    return f"[{100 * interval[0]:.1f}, {100 * interval[1]:.1f}]"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    for name in ("tcn", "gru"):
        parser.add_argument(f"--{name}", type=Path, nargs="+", default=[None], metavar="FILE.onnx")
    drawn = parser.add_mutually_exclusive_group(required=True)
    drawn.add_argument("--data", type=Path, nargs="+", metavar="DIR")
    drawn.add_argument("--anew", type=int, metavar="SEED")
    parser.add_argument("--split", choices=("validation", "test"), default="validation")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    if args.anew is None:
        recordings = read_split(args.data, args.split)
    else:
        recordings = drawn_anew(args.anew, Workers(args.jobs))
    tcn, gru = (
        shares(recordings, [judged_by(name, path, recordings) for path in getattr(args, name)])
        for name in ("tcn", "gru")
    )
    text, chosen = table(tcn, gru)
    print(f"{text}\n\nby the rule: {chosen}{', which goes to the tcn' * (chosen == 'draw')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
