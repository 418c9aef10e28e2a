"""What more networks, or a rule chosen with hindsight, would hear at one false event a minute.

    python scripts/networks_together.py --tcn SEED.onnx... --gru SEED.onnx... --data ...

The first network of each kind, the mean log-odds of all of its kind and of all that are given. Each
has the rule that `scripts/one_a_minute.py` gives it, and beside it the rule that catches the most
slips of the split `test` within the same budget and share of idle blows. That one was chosen by
what it is scored on: no result, but more slips no rule that `tune` tries catches there. The budget
is counted as `tune` counts it, without what blows set off; the column of false events is not.
Slips are counted three ways: all of them, without those of blows that moved it less than 2 mm, and
without those of blows. Last, how often samples of the paper's kind are told right, where there are
any. Delays of missed slips are infinite.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from detector.decision import log_odds
from detector.scores.evaluation import SLIDE, Streamed, cause_of
from detector.scores.quantiles import Quantiles, quantiles
from detector.scores.sweep import SweepPoint, allowed, at_the_budget, rules, sweep
from drivers.errors import GraspError, UsageError
from grasp.cli.options import whole
from scenarios.benchmark.evaluation_file import slips_heard
from scenarios.campaign.config import load_config
from scripts.one_a_minute import (
    BUDGET,
    MOVED,
    SPLITS,
    Tuned,
    accuracies,
    heard_of,
    kind_of,
    said,
    sheet,
    some,
    tuned,
)

BLOWS = "blow"
FAR = f"blow, {MOVED[-1]}"
HEADS = ("heard by", "rule", "false a minute, hand", "slips caught", "of blows those of 2 mm alone",
         "no blows", "delay, ms, p50 / p90 / p99")  # fmt: skip


class Caught(msgspec.Struct, frozen=True):
    """Shares of the slips of some recordings that one rule caught; delays are of all slips."""

    every: float
    moved: float  # without those of blows that moved it less than 2 mm
    no_blows: float
    delay_ms: Quantiles


def together(streams: Sequence[Sequence[Streamed]]) -> list[Streamed]:
    """The mean of the networks' log-odds, recording by recording, finger by finger; of one network
    what it says, untouched."""
    if len(streams) == 1:
        return list(streams[0])
    found = []
    for each in zip(*streams, strict=True):
        odds = np.mean([log_odds(s.probabilities) for s in each], axis=0)
        found.append(msgspec.structs.replace(each[0], probabilities=1.0 / (1.0 + np.exp(-odds))))
    return found


def caught(t: Tuned) -> Caught:
    """By a rule, of what it is asked about; raises ValueError where nothing slips."""
    told = [(kind_of(s, x), x.delay_ms) for s in t.streams for x in slips_heard(s, t.point.rule)]
    delays = quantiles(d for _, d in told)
    if delays is None:
        raise ValueError("no recording slips")

    def share(kept: Sequence[float | None]) -> float:
        return sum(d is not None for d in kept) / max(len(kept), 1)

    return Caught(
        share([d for _, d in told]),
        share([d for k, d in told if k == FAR or not k.startswith(BLOWS)]),
        share([d for k, d in told if not k.startswith(BLOWS)]),
        delays,
    )


def with_hindsight(t: Tuned, points: Sequence[SweepPoint]) -> Tuned:
    """With the rule that catches the most of what it is asked about, the fewest false events among
    equals; raises ValueError where none keeps to the budget."""
    kept = [msgspec.structs.replace(t, point=p) for p in points if allowed(p, BUDGET)]
    return max(kept, key=lambda one: (caught(one).every, -one.point.false_per_min))


def row(t: Tuned, who: str) -> str:
    c, false_per_min = caught(t), sheet(t, t.streams).false_events_per_min_hand or 0.0
    d = c.delay_ms
    cells = (who, said(t.point.rule), f"{false_per_min:.2f}", f"{c.every:.3f}", f"{c.moved:.3f}",
             f"{c.no_blows:.3f}", f"{d.p50:.0f} / {d.p90:.0f} / {d.p99:.0f}")  # fmt: skip
    return f"| {' | '.join(cells)} |"


def rows(who: str, known: Sequence[Streamed], asked: Sequence[Streamed]) -> list[str]:
    """By the rule of validation, and with hindsight."""
    tried = list(rules(load_config("can", "simulated", "tcn").rule))
    chosen = tuned("tcn", tried, known, asked)
    points = sweep(asked, [*tried, chosen.point.rule])
    points += sweep(asked, at_the_budget(points, BUDGET))
    return [row(chosen, who), row(with_hindsight(chosen, points), f"{who}, with hindsight")]


def groups(given: Mapping[str, Sequence[Path]]) -> dict[str, list[tuple[str, Path]]]:
    """Who is heard together: the first of a kind, all of it, all."""
    every = [(name, path) for name, paths in given.items() for path in paths]
    found = {}
    for name, paths in given.items():
        found[f"`{name}`"] = [(name, paths[0])]
        if len(paths) > 1:
            found[f"{len(paths)} of `{name}`"] = [(name, path) for path in paths]
    return found | ({f"all {len(every)}": every} if len(given) > 1 else {})


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    for name in ("tcn", "gru"):
        parser.add_argument(f"--{name}", type=Path, nargs="+", default=[], metavar="FILE.onnx")
    parser.add_argument("--data", type=Path, nargs="+", required=True, metavar="DIR")
    parser.add_argument(
        "--every", type=whole(1, 1000), nargs="+", metavar="N",
        help="of each set one recording in so many",
    )  # fmt: skip
    args = parser.parse_args()
    given = {name: paths for name in ("tcn", "gru") if (paths := getattr(args, name))}
    every_so = args.every or [1] * len(args.data)
    if not given:
        parser.error("networks are needed: --tcn, --gru or both")
    if len(every_so) != len(args.data):
        parser.error(f"--every: {len(every_so)} numbers for {len(args.data)} sets")
    try:
        return compare(given, [*zip(args.data, every_so, strict=True)])
    except GraspError as error:
        parser.error(str(error))


def compare(given: Mapping[str, Sequence[Path]], sets: Sequence[tuple[Path, int]]) -> int:
    """Everything; ``sets``: folders, and of each one recording in so many."""
    configs = {
        (name, path): load_config("can", "simulated", name, None, (f"network.weights={path}",))
        for name, paths in given.items()
        for path in paths
    }
    recordings = [r for folder, n in sets for r in some(folder, n)]
    known, asked = (
        [i for i, r in enumerate(recordings) if r.metadata and r.metadata.split == split]
        for split in SPLITS
    )
    if not (known and asked):
        raise UsageError("a split has no recording", "other sets, or a smaller --every")
    heard = {one: heard_of(config, recordings) for one, config in configs.items()}
    lines, right = [f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|"], {}
    for who, its in groups(given).items():
        streams = together([heard[one] for one in its])
        lines += rows(who, [streams[i] for i in known], [streams[i] for i in asked])
        print(*lines[-2:], sep="\n", flush=True)
        right[who] = [streams[i] for i in asked if cause_of(recordings[i]) == SLIDE]
    print("", *lines, sep="\n")
    if all(right.values()):
        print(f"\n{accuracies(right)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
