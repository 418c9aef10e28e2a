"""How far a rule set without labels lies from a tuned one, at gains from a half to double.

    python scripts/unlabelled_rule.py tcn --data DIR...

Lifts of light objects are held for three minutes and set down; counts of those and of the data are
scaled. Each hold sets the detector's own rule by `detector.scores.unlabelled`. The rule it is
measured against has labels: of those that `grasp detector tune` tries on the split `validation`, of
the same kind and end, at the same gain, the one of least mean delay among those with no more false
events there than the rule without labels has, or than the packaged one, which is kept where it is
the higher. All are scored on the split `test`, and with hindsight that split is tuned on too: no
result, but what no rule that is tried exceeds at the very rate of the one that it is held against.
What a hold could do at best, a margin above its level tells that labels gave once, at gain 1.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, log_odds
from detector.recordings import COUNTS_LIMIT, Recording
from detector.scores.evaluation import Streamed, stream
from detector.scores.perturbations import gain, perturbed
from detector.scores.sweep import SweepPoint, rules, sweep
from detector.scores.unlabelled import Unlabelled, set_rule
from scenarios.benchmark.label_free import hold_in
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.studies.detectors.robustness import stream_together
from scenarios.trial.config import TrialConfig

GAINS = (0.5, 1.0, 2.0)
HELD = ("can", "foam", "ball")
HOLD = ("object.added_mass_kg=0", "controller.hold_s=180", "loop.deadline_s=400")
SEED = 66_000  # of no campaign, figure or test
Hold = tuple[NDArray[np.int16], slice, float]


def holds(folder: Path) -> Iterator[Hold]:
    """A hold of each object, as a lab would record it."""
    for i, name in enumerate(HELD):
        config = load_config(name, "simulated", None, None, HOLD).for_lift()
        lift.run(config, SEED + i, folder / name)
        (run,) = (folder / name).iterdir()
        yield hold_in(run)


def without_labels(config: TrialConfig, hold: Hold, factor: float, budget: float) -> Unlabelled:
    counts, held, load = hold
    scaled = np.rint(gain(counts, factor, np.random.default_rng(0)))
    heard, _ = stream(
        config.make_detector(counts.shape[1], counts.shape[2]),
        np.clip(scaled, -COUNTS_LIMIT, COUNTS_LIMIT).astype(np.int16),
    )
    return set_rule([heard[held]], config.rule, budget, factor * load)


def streams(config: TrialConfig, recordings: Sequence[Recording], factor: float) -> list[Streamed]:
    return stream_together(config.make_detector, [perturbed(r, "gain", factor) for r in recordings])


def tried(base: RuleSettings) -> Iterator[RuleSettings]:
    """Thresholds, samples in a row (or limits and drifts) and fusions."""
    return (r for r in rules(base) if (r.kind, r.release) == (base.kind, base.release))


def tuned(points: Sequence[SweepPoint], false_per_min: float) -> SweepPoint:
    """The quickest on average with no more false events."""
    kept = [p for p in points if p.false_per_min <= false_per_min]
    return min(kept or [min(points, key=lambda p: p.false_per_min)], key=lambda p: p.mean_delay_ms)


def margin(rule: RuleSettings, at_gain_1: Sequence[Unlabelled]) -> float:
    """By how much the packaged threshold stands above the holds' levels, in log-odds: what was
    learnt with labels."""
    return float(log_odds(np.array(rule.threshold)) - np.mean([f.level for f in at_gain_1]))


def raised(found: Unlabelled, by: float) -> RuleSettings:
    threshold = 1.0 / (1.0 + np.exp(-(found.level + by)))
    return msgspec.structs.replace(found.rule, threshold=float(threshold))


def row(factor: float, title: str, rule: RuleSettings, on_test: SweepPoint) -> str:
    level = rule.limit if rule.kind == "cusum" else rule.threshold
    words = f"{rule.fusion}, {rule.kind}" + f" {rule.consecutive}" * (rule.kind == "consecutive")
    blows = on_test.blows
    far = "–" if blows is None else f"{blows.far_registered} of {blows.far}"
    idle = "–" if blows is None else f"{blows.unmoved_registered} of {blows.unmoved}"
    return (
        f"| {factor:g} | {title} | {words}, {level:.3f} | {on_test.false_per_min:.2f} "
        f"| {on_test.delay_ms:.0f} | {on_test.recall:.3f} | {on_test.mean_delay_ms:.0f} | {far} "
        f"| {idle} |"
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("detector")
    parser.add_argument("--data", type=Path, nargs="+", required=True, metavar="DIR")
    parser.add_argument("--budget", type=float, default=1.0, help="false events a minute of a hand")
    args = parser.parse_args()
    config = load_config("can", "simulated", args.detector)
    validation, test = (read_split(args.data, split) for split in ("validation", "test"))
    with tempfile.TemporaryDirectory() as folder:
        held = list(holds(Path(folder)))
    heads = ("gain", "rule", "", "false a minute, hand", "slips: p50, ms", "recall",
             "mean delay, ms", "blows of 2 mm within 100 ms", "idle ones")  # fmt: skip
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    by_hold = {g: [without_labels(config, h, g, args.budget) for h in held] for g in GAINS}
    by = margin(config.rule, by_hold[1.0])
    for factor in GAINS:
        made = {"packaged": config.rule}
        for name, found in zip(HELD, by_hold[factor], strict=True):
            low, high = found.interval
            made[f"{name}: log-odds {found.level:.2f} [{low:.2f}, {high:.2f}]"] = found.rule
            if config.rule.kind == "consecutive":
                made[f"{name}: that and {by:.2f}"] = raised(found, by)
        known, asked = (streams(config, part, factor) for part in (validation, test))
        points, hindsight = (sweep(part, tried(config.rule)) for part in (known, asked))
        rules_of = zip(made.items(), sweep(known, made.values()), strict=True)
        for ((title, rule), on_known), p in zip(rules_of, sweep(asked, made.values()), strict=True):
            print(row(factor, title, rule, p))
            as_many = tuned(points, on_known.false_per_min).rule
            (of_them,) = sweep(asked, [as_many])
            print(row(factor, "tuned to as many", as_many, of_them))
            best = tuned(hindsight, p.false_per_min)
            print(row(factor, "to as many with hindsight", best.rule, best), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
