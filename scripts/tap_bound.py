"""What could be heard of the last draw's own blows: the bound that its taps are held against.

    python scripts/tap_bound.py --data data/observer/run data/confusers-102 data/grasped-slip-103
    python scripts/tap_bound.py --first-seed 120000 --learnt 0 --data ...          other taps alone

The ideal observer (`grasp chart observer`, extra `train`) is asked about the very taps of
`scripts/last_draw.py`: told when each fell, it hears all counts until 50 or 100 ms after and what
`tcn` and `gru` said. It learns from the blows of the data sets, which the detectors must not
have learnt from, and from the mallet's taps on the eleven other objects, of this draw and of seeds
of their own; or from the data sets alone, and then also without the detectors' words, from all
fingers at once or from one at a time. Of the object that it is asked about it knows nothing.
Beside it the detectors on the same blows, their rules' thresholds moved so that as many idle ones
are answered; all of it once more by object. Nothing is tuned on it.
"""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from detector.blows import blows_of
from detector.decision import RuleSettings, log_odds
from detector.interface import DETECTORS
from detector.recordings import Recording
from detector.scores.evaluation import Streamed, spoken
from detector.scores.quantiles import quantile
from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGERS
from grasp.cli.options import need, whole
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.rigs.workers import Workers, results
from scenarios.studies.detectors.observer import (
    MOVED_MM,
    Cases,
    Moment,
    blow_moments,
    cases,
    features,
    heard,
)
from scenarios.studies.detectors.observer import hits as hits_of
from scripts.last_draw import FIRST_SEED as DRAW_SEED
from scripts.last_draw import OBJECTS, SEEDS, SOON_MS, Draw, Struck, all_taps

LEARNT_SEED = 120_000  # of the taps that are learnt from; no draw, campaign, figure or test has it
TIMES_S = (0.05, 0.1)
IDLE_SHARES = (0.03, 0.05, 0.08, 0.1)
OF_OBJECTS = (0.05, 0.08)
HEARD = ("tcn", "gru")  # by the observer
FAR = len(MOVED_MM)  # the class of blows that moved it 2 mm or more
RESAMPLES, SEED = 2000, 0
Floats = NDArray[np.float64]


class Scored(NamedTuple):
    """How sure of slip something is of each blow."""

    name: str
    scores: Floats  # (n,)


def recording_of(blow: Struck) -> Recording:
    """As the observer reads it; what slipped is not asked of it."""
    still = np.zeros(len(blow.t_s), dtype=np.bool_)
    return Recording(blow.t_s, blow.counts, still, None, f"a tap of {blow.object}")


def moment_of(at: int, blow: Struck) -> Moment:
    """The first sample after it struck, to the end of what is watched."""
    struck = int(np.searchsorted(blow.t_s, blow.struck_s, side="right"))
    end = int(np.searchsorted(blow.t_s, blow.until_s, side="right"))
    return Moment(at, struck, end - struck, int(np.digitize(blow.moved_mm, MOVED_MM)))


def highest_threshold(blow: Struck, streamed: Streamed, rule: RuleSettings) -> float:
    """Log-odds of the highest threshold at which a rule of consecutive samples registers the blow:
    one that moved it within 100 ms of its first motion, any other while it is watched."""
    odds = log_odds(spoken(streamed, rule))
    moved = blow.moved_mm >= MOVED_MM[0]
    last_s = min(blow.until_s, blow.onset_s + 1e-3 * SOON_MS) if moved else blow.until_s
    first, end = (int(np.searchsorted(blow.t_s, t, side="right")) for t in (blow.struck_s, last_s))
    begin = max(0, first - rule.consecutive + 1)  # of samples the last of which follows the blow
    runs = np.lib.stride_tricks.sliding_window_view(odds[begin:end], rule.consecutive)
    return float(runs.min(axis=1).max()) if len(runs) else -np.inf


def hits(scored: Scored, classes: NDArray[np.intp], kind: int, idle_share: float) -> float:
    """Share of a class above all but so much of what did not move."""
    rows = (classes == 0) | (classes == kind)
    return hits_of(scored.scores[rows], classes[rows] == kind, idle_share)


def interval(
    one: Scored, other: Scored | None, classes: NDArray[np.intp], kind: int, idle_share: float
) -> tuple[float, float]:
    """95 % of its hits, or of its hits less the other's on the same blows: bootstrap over blows,
    each of which has a hand of its own; the thresholds are found anew."""
    rng = np.random.default_rng(SEED)
    found = []
    for _ in range(RESAMPLES):
        rows = rng.integers(0, len(classes), len(classes))
        drawn = [Scored(s.name, s.scores[rows]) for s in (one, other) if s is not None]
        each = [hits(s, classes[rows], kind, idle_share) for s in drawn]
        found.append(each[0] - sum(each[1:]))
    found.sort()
    return quantile(found, 0.025), quantile(found, 0.975)


def table(every: Sequence[Scored], against: Scored, classes: NDArray[np.intp]) -> str:
    """Hits of blows of 2 mm, and of 1-2 mm, at each share of idle ones; then by how much."""
    titles = ("2 mm or more", f"less `{against.name}`", "1-2 mm")
    shares = _percents(IDLE_SHARES)
    heads = ("what hears", *(f"{title}, at {s}" for title in titles for s in shares))
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for scored in every:
        far = [_share(scored, None, classes, FAR, s) for s in IDLE_SHARES]
        less = [_share(scored, against, classes, FAR, s) for s in IDLE_SHARES]
        near = [f"{100 * hits(scored, classes, 2, s):.0f}" for s in IDLE_SHARES]
        same = ["–"] * len(less) if scored is against else less
        lines.append(f"| {' | '.join((f'`{scored.name}`', *far, *same, *near))} |")
    return "\n".join(lines)


def _share(
    one: Scored, other: Scored | None, classes: NDArray[np.intp], kind: int, idle_share: float
) -> str:
    less = hits(other, classes, kind, idle_share) if other else 0.0
    value = 100 * (hits(one, classes, kind, idle_share) - less)
    low, high = (100 * x for x in interval(one, other, classes, kind, idle_share))
    return f"{value:{'+' if other else ''}.0f} [{low:.0f}, {high:.0f}]"


def by_object(every: Sequence[Scored], objects: Sequence[str], classes: NDArray[np.intp]) -> str:
    """How many of each object's blows of 2 mm are heard, at thresholds that are one for all objects
    and answer so much of their idle ones together."""
    far = classes == FAR
    heads = ("object", *(f"`{s.name}`, at {of}" for s in every for of in _percents(OF_OBJECTS)))
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    above = [
        s.scores > quantile(np.sort(s.scores[classes == 0]), 1.0 - share)
        for s in every
        for share in OF_OBJECTS
    ]
    for name in sorted(set(objects)):
        its = far & (np.array(objects) == name)
        cells = (f"{int(a[its].sum())} of {int(its.sum())}" for a in above)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _percents(shares: Sequence[float]) -> list[str]:
    return [f"{100 * s:.0f} %" for s in shares]


class Known(NamedTuple):
    """The taps, those that are asked about first, and the blows of the data sets."""

    taps: Cases
    drawn: Cases
    asked: int

    def bare(self) -> "Known":
        """Without what detectors said of them."""
        taps, drawn = (replace(c, said={}) for c in (self.taps, self.drawn))
        return Known(taps, drawn, self.asked)

    def finger(self, which: int) -> "Known":
        """As one finger feels them."""
        both = (self.taps, self.drawn)
        taps, drawn = (replace(c, counts=c.counts[:, :, [which]]) for c in both)
        return Known(taps, drawn, self.asked)

    def features(self, time_s: float) -> Floats:
        return np.concatenate([features(c, time_s) for c in (self.taps, self.drawn)])


def struck_in(folders: Sequence[Path]) -> list[Recording]:
    """Recordings of a hand that is struck; ends the program where there are none."""
    try:
        found = [r for r in read_split(folders, "all") if r.fingers == FINGERS and blows_of(r)]
    except BadFile as error:
        raise SystemExit(str(error)) from None
    if not found:
        raise SystemExit("--data: no recording of a hand that is struck")
    return found


def struck_by(draw: Draw, workers: Workers) -> list[Struck]:
    """All its taps, in one order whoever is done first."""
    found = [b for taps in results(partial(all_taps, draw), OBJECTS, workers) for b in taps]
    return sorted(found, key=lambda b: OBJECTS.index(b.object))


def known_of(
    blows: Sequence[Struck], others: Sequence[Struck], drawn: Sequence[Recording]
) -> Known:
    struck = [*blows, *others]
    taps = [recording_of(b) for b in struck]
    at_taps = cases(taps, [moment_of(i, b) for i, b in enumerate(struck)], heard(HEARD, taps))
    if len(at_taps.classes) != len(struck):
        raise SystemExit("a tap has less than half a second before its blow")
    at_drawn = cases(drawn, blow_moments(drawn), heard(HEARD, drawn))
    print(f"learnt from {len(at_drawn.classes)} blows of {len(drawn)} recordings", flush=True)
    return Known(at_taps, at_drawn, len(blows))


def observed(known: Known, objects: NDArray[np.intp], mallet: bool) -> list[Scored]:
    """The observer, on the taps that are asked about; ``objects`` of all taps. With ``mallet`` it
    learns from the taps on other objects too."""
    of_none = np.full(len(known.drawn.classes), len(OBJECTS))
    of_sets = np.concatenate([np.zeros_like(objects), np.ones_like(of_none)])
    bare = known.bare()
    found = []
    for time_s in TIMES_S:
        title = f"observer, {1e3 * time_s:.0f} ms, data sets"
        each = [bare.finger(i).features(time_s) for i in range(FINGERS)]
        found += [
            Scored(title, _moved(known, [known.features(time_s)], of_sets, 2)),
            Scored(f"{title}, counts alone", _moved(known, [bare.features(time_s)], of_sets, 2)),
            Scored(f"{title}, a finger at a time, counts alone", _moved(known, each, of_sets, 2)),
        ]
        if mallet:
            groups = np.concatenate([objects, of_none])
            told = _moved(known, [known.features(time_s)], groups, len(OBJECTS) + 1)
            found.append(Scored(f"{title} and mallet", told))
    return found


def _moved(known: Known, every: Sequence[Floats], groups: NDArray[np.intp], folds: int) -> Floats:
    """How much likelier each tap (n,) moved it a millimetre than nothing, by an observer that has
    learnt from other groups; of several views, which it learns as so many cases, the mean."""
    from detector.training.observer import held_out  # noqa: PLC0415  (torch only where asked)

    classes = np.concatenate([known.taps.classes, known.drawn.classes])
    views = len(every)
    told = held_out(np.concatenate(every), np.tile(classes, views), np.tile(groups, views), folds)
    likelier: Floats = (np.logaddexp(told[:, 2], told[:, 3]) - told[:, 0]).reshape(views, -1)
    mean: Floats = likelier.mean(axis=0)[: known.asked]
    return mean


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument(
        "--detectors", nargs="+", choices=sorted(DETECTORS), default=["tcn", "gru", "energy"]
    )
    parser.add_argument("--taps", type=whole(1, 8), default=8, help="of an object and strength")
    parser.add_argument("--learnt", type=whole(0, 20), default=4, help="draws to learn from")
    parser.add_argument("--first-seed", type=whole(0, 10**9), default=DRAW_SEED, help="asked about")
    parser.add_argument("--jobs", type=whole(1, 64), default=2)
    args = parser.parse_args()
    if args.learnt and args.first_seed >= LEARNT_SEED:
        parser.error(f"--first-seed: below {LEARNT_SEED}, or --learnt 0: those are learnt from")
    try:
        need("train", "torch")
    except UsageError as error:
        parser.error(str(error))
    rules, drawn = {name: _rule(name) for name in args.detectors}, struck_in(args.data)
    draws = [Draw(args.first_seed, args.taps, 0)]
    draws += [
        Draw(LEARNT_SEED + i * SEEDS * len(OBJECTS), args.taps, 0) for i in range(args.learnt)
    ]
    blows, *more = (struck_by(draw, Workers(args.jobs)) for draw in draws)
    others = [b for taps in more for b in taps]
    classes = np.digitize([b.moved_mm for b in blows], MOVED_MM)
    streams = heard(args.detectors, [recording_of(b) for b in blows])
    scored = [
        Scored(name, np.array([highest_threshold(b, s, rules[name])
                               for b, s in zip(blows, streams[name], strict=True)]))
        for name in args.detectors
    ]  # fmt: skip
    known = known_of(blows, others, drawn)
    objects = np.array([OBJECTS.index(b.object) for b in (*blows, *others)])
    scored += observed(known, objects, bool(others))
    print(f"{table(scored, scored[0], classes)}\n")
    print(by_object(scored, [b.object for b in blows], classes))
    return 0


def _rule(name: str) -> RuleSettings:
    rule = load_config("can", "simulated", name).rule
    if rule.kind != "consecutive":
        raise SystemExit(f"{name}: its rule is not of consecutive samples")
    return rule


if __name__ == "__main__":
    raise SystemExit(main())
