"""How good could any detector be? An ideal observer, as nearly as a classifier comes to one.

It is told when something happened, a blow or the first motion of a lift, and asked so much later
whether what is held has moved, and in which class: an ensemble that knows all counts from half a
second before, and what the networks said of them, and that has learnt from other objects of the
same kind (`detector.training.observer`). Its score of a class is how much likelier that class is
than rest, which no other test of the same signal beats, where the classifier is as good as can be.
A detector that does better shows that it is not.
"""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.blows import blows_of
from detector.decision import log_odds, registered_events
from detector.recordings import Recording
from detector.scores.evaluation import Streamed, spoken
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from scenarios.campaign.config import load_config
from scenarios.studies.detectors.robustness import stream_together

BEFORE_S, AFTER_S = 0.5, 0.5
TIMES_S = (0.02, 0.03, 0.05, 0.1, 0.2, 0.5)
LAST_S = (0.02, 0.04, 0.08)  # means over the last so long
FOLDS = 5
IDLE_SHARE = 0.05
RESAMPLES, SEED = 300, 0
MOVED_MM = (0.5, 1.0, 2.0)  # classes of blows, by how far they moved it for good
SPEEDS_MMPS = (20.0, 50.0)  # classes of lifts that slip, by their mean speed in SPEED_S
SPEED_S = 0.1
BLOW_TITLES = ("within 0.5 mm", "0.5-1 mm", "1-2 mm", "2 mm or more")
LIFT_TITLES = ("held", "below 20 mm/s", "20-50 mm/s", "above 50 mm/s")
BASELINES = ("energy", "psd", "psd-fair")  # say nothing that counts do not
GRIPPED = 0.5  # of the load that a hand has when it holds
PER_LIFT = 4  # moments taken of a lift in which nothing slips
Floats = NDArray[np.float64]


class Cases(msgspec.Struct, frozen=True, eq=False):
    """Moments at which something happened, aligned."""

    counts: Floats  # (n, before + after, fingers, taxels)
    before: int  # samples
    period_s: float
    lasts: NDArray[np.intp]  # (n,) samples until something else happens
    classes: NDArray[np.intp]  # (n,), 0: nothing slipped
    groups: NDArray[np.intp]  # (n,) which recording, so which object
    said: dict[str, Floats]  # log-odds (n, after) of a detector, all fingers together
    answers_s: dict[str, Floats]  # (n,) from the moment to the event that its rule registers

    def samples(self, time_s: float) -> int:
        return max(1, round(time_s / self.period_s))

    def part(self, chosen: NDArray[np.intp]) -> "Cases":
        """Some of them."""
        return msgspec.structs.replace(
            self, counts=self.counts[chosen], lasts=self.lasts[chosen],
            classes=self.classes[chosen], groups=self.groups[chosen],
            said={k: v[chosen] for k, v in self.said.items()},
            answers_s={k: v[chosen] for k, v in self.answers_s.items()},
        )  # fmt: skip


class Moment(msgspec.Struct, frozen=True):
    """A sample of a recording, how many follow that are its own, and its class."""

    recording: int
    sample: int
    lasts: int
    kind: int


def blow_moments(recordings: Sequence[Recording]) -> list[Moment]:
    """Every blow, from the first sample after it struck."""
    return [
        Moment(i, b.struck, b.until - b.struck, int(np.digitize(1e3 * b.moved_m, MOVED_MM)))
        for i, r in enumerate(recordings) for b in blows_of(r)
    ]  # fmt: skip


def lift_moments(recordings: Sequence[Recording]) -> list[Moment]:
    """The first motion of each lift that slips, and moments as long after the grip of those that
    do not, drawn of the same delays."""
    rng = np.random.default_rng(SEED)
    lifted = [(i, r) for i, r in enumerate(recordings) if r.metadata and not r.metadata.acts]
    grips = {i: _gripped(r) for i, r in lifted}
    found, delays = [], []
    for i, r in lifted:
        slides = np.flatnonzero(r.slip[grips[i] :])
        if len(slides) and r.contact_speed_mps is not None:
            onset = grips[i] + int(slides[0])
            step = round(SPEED_S / _period_s(r))
            speed = 1e3 * float(np.abs(r.contact_speed_mps[onset : onset + step]).mean())
            stays = np.flatnonzero(~r.slip[onset:])
            lasts = int(stays[0]) if len(stays) else len(r.t_s) - onset
            found.append(Moment(i, onset, lasts, 1 + int(np.digitize(speed, SPEEDS_MMPS))))
            delays.append(onset - grips[i])
    for i, r in lifted:
        if not r.slip.any() and delays:
            for delay in rng.choice(delays, PER_LIFT):
                at = grips[i] + int(delay)
                found.append(Moment(i, at, len(r.t_s) - at, 0))
    return found


def _gripped(recording: Recording) -> int:
    load = -recording.counts.sum(axis=(1, 2), dtype=np.float64)
    held = load[load > load.max() / 4]
    return int(np.argmax(load > GRIPPED * np.median(held))) if len(held) else 0


def _period_s(recording: Recording) -> float:
    return float(recording.t_s[-1] - recording.t_s[0]) / (len(recording.t_s) - 1)


def heard(names: Sequence[str], recordings: Sequence[Recording]) -> dict[str, list[Streamed]]:
    """What the named detectors say of every recording."""
    return {
        name: stream_together(load_config("can", "simulated", name).make_detector, recordings)
        for name in names
    }


def cases(
    recordings: Sequence[Recording], moments: Sequence[Moment],
    streams: Mapping[str, Sequence[Streamed]],
) -> Cases:  # fmt: skip
    """The moments that have half a second before them, with what detectors said of them."""
    period_s = float(np.median([_period_s(r) for r in recordings]))
    before, after = round(BEFORE_S / period_s), round(AFTER_S / period_s)
    moments = [m for m in moments if m.sample >= before]
    rows = np.array([m.sample for m in moments])[:, None] + np.arange(-before, after)
    counts = np.stack([
        recordings[m.recording].counts[np.minimum(row, len(recordings[m.recording].t_s) - 1)]
        for m, row in zip(moments, rows, strict=True)
    ]).astype(np.float64)  # fmt: skip
    said, answers = {}, {}
    for name, every in streams.items():
        rule = load_config("can", "simulated", name).rule
        odds = [log_odds(spoken(s, rule)) for s in every]
        events = [registered_events(s.probabilities, rule)[:, 0] for s in every]
        said[name] = np.stack([
            odds[m.recording][np.minimum(row[before:], len(odds[m.recording]) - 1)]
            for m, row in zip(moments, rows, strict=True)
        ])  # fmt: skip
        answers[name] = np.array([_answer_s(events[m.recording], m, period_s) for m in moments])
    return Cases(
        counts=counts, before=before, period_s=period_s,
        lasts=np.array([m.lasts for m in moments]), classes=np.array([m.kind for m in moments]),
        groups=np.array([m.recording for m in moments]), said=said, answers_s=answers,
    )  # fmt: skip


def _answer_s(events: NDArray[np.intp], moment: Moment, period_s: float) -> float:
    own = events[(events >= moment.sample) & (events < moment.sample + moment.lasts)]
    return float(own[0] - moment.sample + 1) * period_s if len(own) else np.inf


def features(cases: Cases, time_s: float) -> Floats:
    """What is known so long after the moment, (n, d): of every taxel its level before, how far it
    has shifted, how it is shaken and was; the same of fingers and of the hand; what networks
    said."""
    n, first, k = len(cases.counts), cases.before, cases.samples(time_s)
    known = cases.counts[:, : first + k].reshape(n, first + k, -1)
    rest, since = known[:, :first], known[:, first:]
    level, change = rest.mean(axis=1), np.abs(np.diff(known, axis=1))
    lately = [min(k, cases.samples(s)) for s in LAST_S]
    shifts = [since[:, -m:].mean(axis=1) - level for m in lately]
    near = rest[:, -lately[-1] :].mean(axis=1)
    shifts += [since[:, -lately[-1] :].mean(axis=1) - near, near - level]
    shaken = [
        change[:, first - 1 :].mean(axis=1), change[:, first - 1 : first + 4].mean(axis=1),
        change[:, -lately[1] :].mean(axis=1), np.abs(since - level[:, None]).max(axis=1),
        since[:, -lately[-1] :].std(axis=1), change[:, : first - 1].mean(axis=1),
    ]  # fmt: skip
    every = [*shifts, *shaken, level]
    fingers = cases.counts.shape[2]
    of_fingers = [np.sqrt((v.reshape(n, fingers, -1) ** 2).sum(axis=2)) for v in every]
    sums = [v.reshape(n, fingers, -1).sum(axis=2) for v in [*shifts, level]]
    of_hand = [np.sqrt((v**2).sum(axis=1, keepdims=True)) for v in every]
    load = np.sqrt((level**2).sum(axis=1, keepdims=True)) + 1.0
    said = [
        each for name, odds in cases.said.items() if name not in BASELINES
        for each in (odds[:, :k].max(axis=1, keepdims=True), odds[:, k - 1 : k])
    ]  # fmt: skip
    parts = [np.arcsinh(v / 4.0) for v in [*every, *sums]]
    parts += [np.log1p(v) for v in [*of_fingers, *of_hand]]
    parts += [np.log1p(20.0 * v / load) for v in of_hand[:-1]]
    out: Floats = np.concatenate([*parts, *said], axis=1)
    return out


class Told(msgspec.Struct, frozen=True):
    """How well one class is told from rest so long after the moment."""

    title: str
    time_s: float
    auc: float
    auc_interval: tuple[float, float]
    hits: float  # at IDLE_SHARE of rest
    hits_interval: tuple[float, float]
    n: int
    idle: int


def told(cases: Cases, score: Floats, kind: int, time_s: float, titles: Sequence[str]) -> Told:
    """How well a score (n,) tells a class from rest; nan is left out. Intervals: 95 %, by bootstrap
    over recordings."""
    chosen = np.flatnonzero(np.isfinite(score) & np.isin(cases.classes, (0, kind)))
    s, moved, groups = score[chosen], cases.classes[chosen] == kind, cases.groups[chosen]
    rows = [np.flatnonzero(groups == g) for g in np.unique(groups)]
    rng = np.random.default_rng(SEED)
    drawn = []
    for _ in range(RESAMPLES):
        again = np.concatenate([rows[i] for i in rng.integers(0, len(rows), len(rows))])
        if 0 < moved[again].sum() < len(again):
            drawn.append((_auc(s[again], moved[again]), hits(s[again], moved[again])))
    limits = [_interval([d[i] for d in drawn]) for i in (0, 1)]
    return Told(
        titles[kind], time_s, _auc(s, moved), limits[0], hits(s, moved), limits[1],
        int(moved.sum()), int((~moved).sum()),
    )  # fmt: skip


def _auc(score: Floats, moved: NDArray[np.bool_]) -> float:
    return auc(score, moved) or 0.0


def hits(score: Floats, moved: NDArray[np.bool_], idle_share: float = IDLE_SHARE) -> float:
    """Share of what moved that scores above all but so much of what did not."""
    limit = quantile(np.sort(score[~moved]), 1.0 - idle_share)
    return float((score[moved] > limit).mean())


def _interval(values: Sequence[float]) -> tuple[float, float]:
    ordered = sorted(values)
    return quantile(ordered, 0.025), quantile(ordered, 0.975)


def loudest(cases: Cases, name: str, time_s: float) -> Floats:
    """The most (n,) that a detector said until then, which a threshold of one sample compares."""
    most: Floats = cases.said[name][:, : cases.samples(time_s)].max(axis=1)
    return np.where(cases.lasts >= cases.samples(time_s), most, np.nan)


class Point(msgspec.Struct, frozen=True):
    """A detector by its own rule: what it registers of a class, and of what did not move."""

    detector: str
    title: str
    hits: float  # within `within_s`
    idle: float  # within AFTER_S
    within_s: float


def point(cases: Cases, name: str, kind: int, within_s: float, titles: Sequence[str]) -> Point:
    answers = cases.answers_s[name]
    moved, idle = cases.classes == kind, cases.classes == 0
    return Point(
        name, titles[kind], float((answers[moved] <= within_s).mean()),
        float((answers[idle] <= AFTER_S).mean()), within_s,
    )  # fmt: skip
