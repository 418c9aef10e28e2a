"""Every detector, and an observer without limits, at one false event a minute of a hand.

    python scripts/one_a_minute.py --data data/paper data/confusers data/grasped-slip [--observer]

The rule of each is tuned on the split `validation` as `grasp detector tune` tunes it, and scored on
the split `test`: all sets, and those recordings of them that are of the paper's kind. A detector
that no rule keeps within the budget and within one idle blow in twenty has a row that says so, with
the best rule that keeps to the budget alone. Delays of slips that were missed are infinite.
`--tune-on paper` tunes on those recordings of `validation` alone that are of the paper's kind.

`--observer` adds an ensemble (extra `train`) that knows counts and what `tcn` and `gru` said until
each sample, has learnt from other recordings of both splits, and is given a rule in the same way;
what any finger, the mean and a head make of the three fingers of the default; and how often such
an ensemble, which hears `tcn-paper` too, is right of the paper's kind where it may answer later.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.blows import blows_of
from detector.decision import RuleSettings
from detector.interface import DETECTORS
from detector.recordings import Recording, Split
from detector.scores.evaluation import (
    SLIDE,
    WARM_UP_SAMPLES,
    Evaluation,
    Streamed,
    cause_of,
    evaluate_streams,
)
from detector.scores.intervals import HIGH, LOW
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile, quantiles
from detector.scores.sweep import SweepPoint, at_the_budget, best, rules, sweep
from scenarios.acquire.datasets.plan import BLOCKS, SEEDS
from scenarios.benchmark.evaluation_file import SlipHeard, slips_heard
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.studies.detectors.robustness import stream_together
from scenarios.trial.config import TrialConfig

SPLITS: tuple[Split, ...] = ("validation", "test")
BUDGET = 1.0  # false events a minute of a hand
HEARD = ("tcn", "gru")  # by the observer; of the paper's kind, where it may answer later, more:
HEARD_OF_SLIDES = (*HEARD, "tcn-paper")
OBSERVER, FUSED = "observer", "tcn"
FOLDS, THINNED = 3, 3  # it learns from one sample in so many
AHEAD = (0, 2, 5, 10, 20)  # samples by which it may answer later
RESAMPLES = 1000
EARLY = 3  # samples before a blow in which its slip may begin
MOVED_MM = (0.5, 1.0, 2.0)
MOVED = ("within 0.5 mm", "0.5-1 mm", "1-2 mm", "2 mm or more")


class Tuned(msgspec.Struct, frozen=True, eq=False):
    """A detector with the rule that validation gave it, and what it said of the split `test`."""

    name: str
    point: SweepPoint  # on validation
    kept: bool  # within the budget and within the share of idle blows
    streams: Sequence[Streamed]


def tuned(
    name: str, tried: Sequence[RuleSettings], known: Sequence[Streamed], asked: Sequence[Streamed]
) -> Tuned:
    """By what it said of validation."""
    points = sweep(known, tried)
    points += sweep(known, at_the_budget(points, BUDGET))
    found = best(points, BUDGET)
    if found is not None:
        return Tuned(name, found, True, asked)
    quiet = [p for p in points if p.false_per_min <= BUDGET]
    least = min(points, key=lambda p: p.false_per_min)
    return Tuned(name, min(quiet, key=lambda p: p.mean_delay_ms, default=least), False, asked)


def observed(
    recordings: Sequence[Recording], heard: Mapping[str, Sequence[Streamed]], ahead: int = 0
) -> list[Streamed]:
    """What the observer says of recordings that it has not learnt from; of hands and of single
    fingers apart."""
    from detector.training.sample_observer import (  # noqa: PLC0415  (torch only where asked)
        features,
        held_out,
    )

    found: dict[int, Streamed] = {}
    for fingers in sorted({r.fingers for r in recordings}):
        its = [i for i, r in enumerate(recordings) if r.fingers == fingers]
        known = [features(recordings[i], [heard[n][i] for n in heard], ahead) for i in its]
        said = held_out([recordings[i] for i in its], known, FOLDS, THINNED)
        found |= {
            i: Streamed(recordings[i], p, np.empty(0)) for i, p in zip(its, said, strict=True)
        }
    return [found[i] for i in range(len(recordings))]


def rows(every: Sequence[Tuned]) -> str:
    """Of all sets, then of the paper's kind."""
    heads = ("detector", "rule", "false a minute, hand: validation; test", "slips caught",
             "delay, ms, p50 / p90 / p99", "blows of 2 mm within 100 ms; idle ones",
             "paper's kind: slips caught", "delay", "false a minute")  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for t in every:
        pressed = [s for s in t.streams if _slides(s)] or t.streams
        whole, slides = sheet(t, t.streams), sheet(t, pressed)
        b = whole.blows
        blows = b and (f"{b.far_registered} of {b.far}; {b.unmoved_registered} of {b.unmoved}")
        cells = (
            f"`{t.name}`", said(t.point.rule) + _over(t),
            f"{t.point.false_per_min:.2f}; {whole.false_events_per_min_hand or 0:.2f}",
            caught(t, t.streams), _delay(whole), blows or "–", caught(t, pressed), _delay(slides),
            f"{slides.false_events_per_min_hand or 0:.2f}",
        )  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _over(t: Tuned) -> str:
    if t.kept:
        return ""
    return f", **over the {'idle blows' if t.point.false_per_min <= BUDGET else 'budget'}**"


def said(rule: RuleSettings) -> str:
    if rule.kind == "cusum":
        return f"{rule.fusion}, sum over {rule.limit:.2g} less {rule.drift:g}, {rule.release}"
    return f"{rule.fusion}, {rule.consecutive} over {rule.threshold:.3f}, {rule.release}"


def sheet(t: Tuned, streams: Sequence[Streamed]) -> Evaluation:
    """Events by the tuned rule."""
    name = t.name if t.name in DETECTORS else FUSED
    detector = load_config("can", "simulated", name).make_detector(1)
    return evaluate_streams(detector, t.point.rule, streams, "test")


def _slides(s: Streamed) -> bool:
    return cause_of(s.recording) == SLIDE


def caught(t: Tuned, streams: Sequence[Streamed]) -> str:
    """Share of slips, 95 % over recordings."""
    hits = [[s.delay_ms is not None for s in slips_heard(x, t.point.rule)] for x in streams]
    right, of = np.array([sum(h) for h in hits]), np.array([len(h) for h in hits])
    drawn = np.random.default_rng(0).integers(0, len(hits), (RESAMPLES, len(hits)))
    shares = np.sort(right[drawn].sum(1) / np.maximum(of[drawn].sum(1), 1))
    low, high = quantile(shares, LOW), quantile(shares, HIGH)
    return f"{right.sum() / max(of.sum(), 1):.3f} [{low:.3f}, {high:.3f}]"


def _delay(s: Evaluation) -> str:
    q = s.delay_ms
    return "–" if q is None else f"{q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}"


def by_kind(every: Sequence[Tuned]) -> str:
    """Slips of all sets by what made them, those of blows by how far the blow moved it for good:
    how many were caught, and their delays."""
    heads = ("slips of", "n", *(f"`{t.name}`: caught; delay, ms, p50 / p90 / p99" for t in every))
    found = [
        [(kind_of(x, s), s.delay_ms) for x in t.streams for s in slips_heard(x, t.point.rule)]
        for t in every
    ]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for kind in sorted({k for k, _ in found[0]}):
        its = [quantiles(d for k, d in each if k == kind) for each in found]
        hit = [sum(k == kind and d is not None for k, d in each) for each in found]
        told = [f"{h}; {q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}"
                for h, q in zip(hit, its, strict=True) if q is not None]  # fmt: skip
        lines.append(f"| {kind} | {sum(k == kind for k, _ in found[0])} | {' | '.join(told)} |")
    return "\n".join(lines)


def kind_of(streamed: Streamed, slip: SlipHeard) -> str:
    """The cause of its recording, or how far the blow moved it that it is of."""
    recording = streamed.recording
    at = int(np.searchsorted(recording.t_s, slip.onset_s))
    blow = next((b for b in blows_of(recording) if b.struck - EARLY <= at < b.until), None)
    if blow is None:
        return cause_of(recording)
    return f"blow, {MOVED[int(np.digitize(1e3 * blow.moved_m, MOVED_MM))]}"


def accuracies(said: Mapping[str, Sequence[Streamed]]) -> str:
    """Of samples of the paper's kind, one finger each, at even odds."""
    lines = ["| who | accuracy, % | AUC |", "|---|---|---|"]
    for name, streams in said.items():
        parts = [
            (s.probabilities[WARM_UP_SAMPLES:, 0], s.labels[WARM_UP_SAMPLES:]) for s in streams
        ]
        p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
        low, high = _drawn_again(parts)
        right = 100 * float(((p > 0.5) == labels).mean())
        area = auc(p, labels) or 0.0
        lines.append(f"| {name} | {right:.1f} [{100 * low:.1f}, {100 * high:.1f}] | {area:.3f} |")
    return "\n".join(lines)


def _drawn_again(
    parts: Sequence[tuple[NDArray[np.float64], NDArray[np.bool_]]],
) -> tuple[float, float]:
    """Accuracy at even odds, 95 % over recordings."""
    right = np.array([((p > 0.5) == labels).sum() for p, labels in parts])
    size = np.array([len(p) for p, _ in parts])
    drawn = np.random.default_rng(0).integers(0, len(parts), (RESAMPLES, len(parts)))
    shares = np.sort(right[drawn].sum(1) / size[drawn].sum(1))
    return quantile(shares, LOW), quantile(shares, HIGH)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--data", type=Path, nargs="+", required=True, metavar="DIR")
    parser.add_argument("--detectors", nargs="+", choices=DETECTORS, default=DETECTORS)
    parser.add_argument(
        "--every", type=int, nargs="+", metavar="N", help="of each set one recording in so many"
    )
    parser.add_argument("--tune-on", choices=("all", "paper"), default="all")
    parser.add_argument("--observer", action="store_true")
    args = parser.parse_args()
    every_so = args.every or [1] * len(args.data)
    recordings = [r for folder, n in zip(args.data, every_so, strict=True) for r in some(folder, n)]
    of_split = {
        split: [i for i, r in enumerate(recordings) if r.metadata and r.metadata.split == split]
        for split in SPLITS
    }
    names = dict.fromkeys([*args.detectors, FUSED, *(HEARD if args.observer else ())])
    bases = {name: load_config("can", "simulated", name) for name in names}
    heard = {name: heard_of(config, recordings) for name, config in bases.items()}
    if args.observer:
        of = {name: heard[name] for name in HEARD}
        heard[OBSERVER] = observed(recordings, of)
    every = []
    for name in (*args.detectors, *([OBSERVER] if args.observer else [])):
        known, asked = ([heard[name][i] for i in of_split[s]] for s in SPLITS)
        known = [s for s in known if args.tune_on == "all" or _slides(s)]
        base = bases.get(name, bases[FUSED]).rule
        every.append(tuned(name, list(rules(base)), known, asked))
        print(rows(every[-1:]), flush=True)
    print(f"{rows(every)}\n\n{by_kind(every)}")
    if args.observer:
        print(f"\n{rows(together(recordings, heard[FUSED], bases[FUSED].rule, of_split))}")
    if args.observer:
        print(f"\n{later(recordings, of_split['test'])}")
    return 0


def some(folder: Path, every: int) -> list[Recording]:
    """Of both splits one recording in so many, in the order of the plan."""
    found = [r for split in SPLITS for r in read_split([folder], split)]
    numbered = {m.seed % SEEDS - BLOCKS[m.split]: r for r in found if (m := r.metadata) is not None}
    return [numbered[k] for k in sorted(numbered)[::every]]


def heard_of(config: TrialConfig, recordings: Sequence[Recording]) -> list[Streamed]:
    """Recordings of one finger and of more apart: fewer frames are heard for nothing."""
    found: dict[int, Streamed] = {}
    for fingers in {r.fingers for r in recordings}:
        its = [i for i, r in enumerate(recordings) if r.fingers == fingers]
        streams = stream_together(config.make_detector, [recordings[i] for i in its])
        found |= dict(zip(its, streams, strict=True))
    return [found[i] for i in range(len(recordings))]


def together(
    recordings: Sequence[Recording], said: Sequence[Streamed], base: RuleSettings,
    of_split: Mapping[Split, Sequence[int]],
) -> list[Tuned]:  # fmt: skip
    """Hands alone, by rules of the packaged one's kind and end: any finger, the mean of their
    log-odds, and a head that has learnt from other recordings what the three say together."""
    from detector.training.sample_observer import (  # noqa: PLC0415  (torch only where asked)
        fused_features,
        held_out,
    )

    its = {s: [i for i in of_split[s] if recordings[i].fingers > 1] for s in SPLITS}
    hands = sorted(i for of in its.values() for i in of)
    of_head = held_out([recordings[i] for i in hands], [fused_features(said[i]) for i in hands],
                       FOLDS, THINNED)  # fmt: skip
    head = {i: Streamed(recordings[i], p, np.empty(0)) for i, p in zip(hands, of_head, strict=True)}
    found = []
    for title, fusion, heard in (("any", "any", said), ("mean", "mean", said), ("head", "", head)):
        known, asked = ([heard[i] for i in its[s]] for s in SPLITS)
        tried = [r for r in rules(base) if fusion in ("", r.fusion) and _alike(r, base)]
        found.append(tuned(f"{FUSED}, {title}", tried, known, asked))
    return found


def _alike(r: RuleSettings, base: RuleSettings) -> bool:
    return (r.kind, r.release) == (base.kind, base.release)


def later(recordings: Sequence[Recording], test: Sequence[int]) -> str:
    """How often detectors are right of the paper's kind, and the observer that may answer later."""
    slides = [i for i, r in enumerate(recordings) if cause_of(r) == SLIDE]
    asked = [k for k, i in enumerate(slides) if i in set(test)]
    known = [recordings[i] for i in slides]
    heard = {n: heard_of(load_config("can", "simulated", n), known) for n in HEARD_OF_SLIDES}
    told = {f"`{n}`": [streams[k] for k in asked] for n, streams in heard.items()}
    for ahead in AHEAD:
        found = observed(known, heard, ahead)
        told[f"observer, {10 * ahead} ms later"] = [found[k] for k in asked]
    return accuracies(told)


if __name__ == "__main__":
    sys.exit(main())
