"""How soon force rises in lifts, threshold by threshold of a packaged rule, and what is lost.

    python scripts/lift_thresholds.py tcn gru [--thresholds .55 .65] [--lifts 10] [--jobs 2]

Lifts of the six objects and of the second half dozen with too weak a grasp, as
`scripts/last_draw.py` makes them, on seeds that no draw has, each once with every threshold and
once with the packaged one. What a threshold costs where nothing slips is told by
`scripts/tap_thresholds.py` and `grasp detector evaluate --set rule.threshold=...`. Nothing is
tuned on it.
"""

import argparse
from collections.abc import Sequence
from functools import partial

from detector.interface import DETECTORS
from detector.scores.quantiles import quantiles
from grasp.cli.options import whole
from scenarios.campaign.config import load_config
from scenarios.rigs.workers import Workers, results
from scripts.last_draw import OBJECTS, Draw, Lifted, lifts, of, reaction, share

FIRST_SEED = 160_000  # no draw, campaign, figure or test has it
THRESHOLDS = (0.55, 0.6, 0.65, 0.7)
HEADS = (
    "detector", "threshold", "held", "force rises after onset, ms, p50 / p90 / p99",
    "slipped, mm, p50 / p90 / p99", "otherwise",
)  # fmt: skip
Asked = tuple[str, float, str]  # detector, threshold, object


def all_lifts(draw: Draw, asked: Asked) -> list[Lifted]:
    """A task of a worker's."""
    detector, threshold, name = asked
    return list(lifts(draw, name, detector, [f"rule.threshold={threshold}"]))


def row(detector: str, threshold: float, every: Sequence[Lifted], packaged: bool) -> str:
    lost = [f"{r.object} {r.seed} {r.outcome}" for r in every if not r.held]
    slipped = quantiles(r.slip_mm for r in every if r.slip_mm is not None)
    told = f"**{threshold:.4f}, packaged**" if packaged else f"{threshold:.2f}"
    cells = (
        f"`{detector}`", told, share(sum(r.held for r in every), len(every)), of(reaction(every)),
        of(slipped, 1), ", ".join(lost) or "–",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("detectors", nargs="+", choices=sorted(DETECTORS))
    parser.add_argument("--thresholds", type=float, nargs="*", default=THRESHOLDS)
    parser.add_argument("--lifts", type=whole(1, 60), default=10, help="of each object")
    parser.add_argument("--jobs", type=whole(1, 64), default=2)
    args = parser.parse_args()
    draw = Draw(FIRST_SEED, 0, args.lifts)
    print(f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|", sep="\n")
    for detector in args.detectors:
        packaged = load_config("can", "simulated", detector).rule.threshold
        for threshold in (*args.thresholds, packaged):
            asked = [(detector, threshold, name) for name in OBJECTS]
            made = results(partial(all_lifts, draw), asked, Workers(args.jobs))
            every = [one for of_object in made for one in of_object]
            print(row(detector, threshold, every, threshold == packaged), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
