"""Upper bound of slip detection: a classifier that knows when the event happened.

It gets the time of a tap, or of the first motion in a lift. After a delay it predicts the class of
the object's motion. Its inputs are all counts from 0.5 s before the event on, and the outputs of
the networks. One classifier per delay is trained on other objects. Its score of a class is the
log-likelihood ratio to rest; with an ideal classifier no test of the same signal does better.
"""

import argparse
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import log_odds
from detector.recordings import Recording, read_dataset
from detector.scores.evaluation import cause_of, hand_probability
from detector.scores.impacts import impacts_of
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from drivers.errors import UsageError
from drivers.interfaces import PERIOD_S
from grasp.cli.options import decimal, need, workers
from grasp.cli.output import progress
from grasp.cli.parser import Parser
from grasp.settings import file_of
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan
from scenarios.campaign.config import load_config
from studies.robustness import COMPARED, stream_together
from studies.runner import Study, markdown

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]
Moment = tuple[int, int, int, int]  # recording, sample, samples until something else, class
DATASET, TAP = "observer", "grasped_impact"
BEFORE, AFTER = 50, 50  # samples of 10 ms
TIMES_S = (0.02, 0.03, 0.05, 0.1, 0.2, 0.5)
MEANS_S = (0.02, 0.04, 0.08)  # features: means over the last samples
FOLDS, REST_SHARE, RESAMPLES, SEED = 5, 0.05, 300, 0
MOVED_MM = (0.5, 1.0, 2.0)  # bounds of the classes of taps: lasting displacement
SPEEDS_MMPS, SPEED_S = (20.0, 50.0), 0.1  # of slipping lifts: mean speed in the first 0.1 s
TITLES = {
    "tap": ("within 0.5 mm", "0.5-1 mm", "1-2 mm", "2 mm or more"),
    "lift": ("held", "below 20 mm/s", "20-50 mm/s", "above 50 mm/s"),
}
SIMPLE = ("energy", "psd", "psd-fair")  # formulas of the counts: their output adds no information
HELD_MOMENTS = 4  # of a lift in which nothing slips
MEMBERS, WIDTH, BATCH, EPOCHS, RATE = 3, 96, 256, 30, 3e-3  # of the ensemble's networks


class Task(msgspec.Struct, frozen=True):
    """A kind of event, and the delay after it."""

    kind: str
    time_s: float
    detectors: tuple[str, ...]
    data: str


class Separation(msgspec.Struct, frozen=True):
    """Separation of one class from rest by a score."""

    detector: str
    title: str
    auc: float
    hits: float  # share of the class scored above all but 5 % of rest
    interval: tuple[float, float]  # of hits: 95 %, bootstrap over recordings
    n: int
    rest: int


class Row(msgspec.Struct, frozen=True):
    """The observer and the detectors at one time."""

    kind: str
    time_s: float
    separations: list[Separation]


class Cases(msgspec.Struct, frozen=True, eq=False):
    """Moments at which something happened, aligned."""

    counts: Floats  # (n, BEFORE + AFTER, fingers, taxels)
    lasts: Whole  # (n,) samples until something else happens
    classes: Whole  # (n,) 0: nothing slipped
    groups: Whole  # (n,) recording, so object
    outputs: dict[str, Floats]  # log-odds (n, AFTER) of each detector


def _options(parser: Parser) -> None:
    parser.add_argument("--data", type=Path, required=True, metavar="DIR",
                        help="folder of the recordings; existing ones are kept")  # fmt: skip
    parser.add_argument("--share", type=decimal(1e-3, 1), default=0.75, metavar="X")
    parser.add_argument("--detectors", nargs="+", default=COMPARED, metavar="NAME")


def first_of_each(jobs: Sequence[Job], share: float) -> list[Job]:
    """The first recordings of every cause in the plan, in that share."""
    found: list[Job] = []
    for cause in dict.fromkeys(job.metadata.cause for job in jobs):
        of_cause = [job for job in jobs if job.metadata.cause == cause]
        found += of_cause[: math.ceil(share * len(of_cause))]
    return found


def _grid(args: argparse.Namespace) -> list[Task]:
    need("train", "torch")
    config, folder = load_dataset_config(file_of("datasets", DATASET)), args.data / "run"
    jobs = first_of_each(plan(config), args.share)
    with progress("recordings") as show:
        build(jobs, config, folder, workers(args), show, "--data")
    names = tuple(args.detectors)
    return [Task(kind, time_s, names, str(folder)) for kind in TITLES for time_s in TIMES_S]


@lru_cache(maxsize=2)
def _cases(kind: str, detectors: tuple[str, ...], data: str) -> Cases:
    recordings = [r for r in read_dataset(Path(data)) if (cause_of(r) == TAP) == (kind == "tap")]
    moments = taps(recordings) if kind == "tap" else lifts(recordings)
    its = cases(recordings, moments, detectors)
    for k, title in enumerate(TITLES[kind]):
        if len(np.unique(its.groups[its.classes == k])) < FOLDS:
            raise UsageError(f"fewer than {FOLDS} recordings of {title!r}", "give a larger --share")
    return its


def trial(task: Task) -> Row:
    """Train the observer for this delay; score it and the detectors."""
    its = _cases(task.kind, task.detectors, task.data)
    lasting = its.lasts >= samples(task.time_s)
    odds = np.full((len(its.classes), len(TITLES[task.kind])), np.nan)
    known = features(its, task.time_s)[lasting]
    odds[lasting] = held_out(known, its.classes[lasting], its.groups[lasting])
    found = list[Separation]()
    for k, title in list(enumerate(TITLES[task.kind]))[1:]:
        found.append(separation(its, odds[:, k] - odds[:, 0], k, "observer", title))
        for name in task.detectors:
            highest = its.outputs[name][:, : samples(task.time_s)].max(axis=1)
            found.append(separation(its, np.where(lasting, highest, np.nan), k, name, title))
    return Row(task.kind, task.time_s, found)


def samples(time_s: float) -> int:
    return max(1, round(time_s / PERIOD_S))


def taps(recordings: Sequence[Recording]) -> list[Moment]:
    """Every tap, from the first sample after it."""
    return [
        (i, one.start, one.end - one.start, int(np.digitize(1e3 * one.moved_m, MOVED_MM)))
        for i, r in enumerate(recordings) for one in impacts_of(r)
    ]  # fmt: skip


def lifts(recordings: Sequence[Recording]) -> list[Moment]:
    """The first motion of each lift that slips. In lifts that hold: moments with the same delays
    after the grip."""
    rng, found, delays = np.random.default_rng(SEED), list[Moment](), list[int]()
    for i, r in enumerate(recordings):
        slides = np.flatnonzero(r.slip[(grip := _gripped(r)) :])
        if len(slides) and r.contact_speed_mps is not None:
            onset = grip + int(slides[0])
            speed_mps = float(np.abs(r.contact_speed_mps[onset:][: samples(SPEED_S)]).mean())
            rest = np.flatnonzero(~r.slip[onset:])
            lasts = int(rest[0]) if len(rest) else len(r.t_s) - onset
            found.append((i, onset, lasts, 1 + int(np.digitize(1e3 * speed_mps, SPEEDS_MMPS))))
            delays.append(onset - grip)
    for i, r in enumerate(recordings):
        if not r.slip.any() and delays:
            starts = _gripped(r) + rng.choice(delays, HELD_MOMENTS)
            found += [(i, int(start), len(r.t_s) - int(start), 0) for start in starts]
    return found


def _gripped(recording: Recording) -> int:
    load = -recording.counts.sum(axis=(1, 2), dtype=np.float64)
    return int(np.argmax(load > np.median(load[load > load.max() / 4]) / 2))


def cases(
    recordings: Sequence[Recording], moments: Sequence[Moment], detectors: Sequence[str]
) -> Cases:
    """The moments with at least 0.5 s of recording before them."""
    moments = [m for m in moments if m[1] >= BEFORE]

    def around(series: Sequence[Any], first: int) -> Any:
        rows = [(series[m[0]], m[1] + np.arange(first, AFTER)) for m in moments]
        return np.stack([s[np.minimum(row, len(s) - 1)] for s, row in rows]).astype(np.float64)

    outputs = {}
    for name in detectors:
        config = load_config("can", "simulated", name)
        streams = stream_together(config.make_detector, recordings)
        outputs[name] = around([log_odds(hand_probability(s, config.rule)) for s in streams], 0)
    groups, _, lasts, classes = np.array(moments).T
    counts = around([r.counts for r in recordings], -BEFORE)
    return Cases(counts, lasts, classes, groups, outputs)


def features(cases: Cases, time_s: float) -> Floats:
    """Features (n, d) at this delay: level, shift and vibration of taxels, fingers and hand, before
    and after the moment; outputs of networks."""
    n, first, k = len(cases.counts), BEFORE, samples(time_s)
    known = cases.counts[:, : first + k].reshape(n, first + k, -1)
    rest, since = known[:, :first], known[:, first:]
    level, change = rest.mean(axis=1), np.abs(np.diff(known, axis=1))
    last = [min(k, samples(s)) for s in MEANS_S]
    near = rest[:, -last[-1] :].mean(axis=1)
    shifts = [since[:, -m:].mean(axis=1) - level for m in last]
    shifts += [since[:, -last[-1] :].mean(axis=1) - near, near - level]
    windows = (slice(first - 1, None), slice(first - 1, first + 4), slice(-last[1], None),
               slice(first - 1))  # fmt: skip
    vibration = [change[:, window].mean(axis=1) for window in windows]
    vibration += [np.abs(since - level[:, None]).max(axis=1), since[:, -last[-1] :].std(axis=1)]
    taxels, fingers = [*shifts, *vibration, level], cases.counts.shape[2]
    norms = [np.sqrt((v.reshape(n, fingers, -1) ** 2).sum(axis=2)) for v in taxels]
    sums = [v.reshape(n, fingers, -1).sum(axis=2) for v in [*shifts, level]]
    hand = [np.sqrt((v**2).sum(axis=1, keepdims=True)) for v in taxels]
    outputs = [
        each for name, odds in cases.outputs.items() if name not in SIMPLE
        for each in (odds[:, :k].max(axis=1, keepdims=True), odds[:, k - 1 : k])
    ]  # fmt: skip
    parts = [np.arcsinh(v / 4.0) for v in [*taxels, *sums]]
    parts += [np.log1p(v) for v in [*norms, *hand]]
    parts += [np.log1p(20.0 * v / (hand[-1] + 1.0)) for v in hand[:-1]]
    found: Floats = np.concatenate([*parts, *outputs], axis=1)
    return found


def held_out(features: Floats, classes: Whole, groups: Whole) -> Floats:
    """Log-probabilities (n, classes) by an ensemble trained on the groups of other folds."""
    import torch

    torch.set_num_threads(1)
    fold, odds = groups % FOLDS, np.zeros((len(features), int(classes.max()) + 1))
    labels = torch.tensor(classes)
    for k in range(FOLDS):
        train, test = fold != k, fold == k
        centre, spread = features[train].mean(axis=0), features[train].std(axis=0) + 1e-6
        inputs = torch.tensor((features - centre) / spread, dtype=torch.float32)
        for member in range(MEMBERS):
            network = _trained(inputs[train], labels[train], odds.shape[1], SEED + member)
            with torch.no_grad():
                odds[test] += torch.log_softmax(network(inputs[test]), dim=1).numpy() / MEMBERS
    return odds


def _trained(inputs: Any, labels: Any, classes: int, seed: int) -> Any:
    import torch
    from torch import nn

    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network = nn.Sequential(
        nn.Dropout(0.1), nn.Linear(inputs.shape[1], WIDTH), nn.GELU(), nn.Dropout(0.3),
        nn.Linear(WIDTH, WIDTH), nn.GELU(), nn.Dropout(0.3), nn.Linear(WIDTH, classes),
    )  # fmt: skip
    batches = max(1, len(inputs) // BATCH)
    optimiser = torch.optim.AdamW(network.parameters(), RATE, weight_decay=1e-2, foreach=False)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=EPOCHS * batches)
    for _ in range(EPOCHS):
        for rows in np.array_split(rng.permutation(len(inputs)), batches):
            loss = nn.functional.cross_entropy(network(inputs[rows]), labels[rows])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    return network.eval()


def separation(cases: Cases, score: Floats, kind: int, detector: str, title: str) -> Separation:
    """Separation of a class from rest by a score (n,), without NaN."""
    chosen = np.isfinite(score) & np.isin(cases.classes, (0, kind))
    s, moved, groups = score[chosen], cases.classes[chosen] == kind, cases.groups[chosen]
    rows = [np.flatnonzero(groups == g) for g in np.unique(groups)]
    rng, hits = np.random.default_rng(SEED), []
    for _ in range(RESAMPLES):
        again = np.concatenate([rows[i] for i in rng.integers(0, len(rows), len(rows))])
        if 0 < moved[again].sum() < len(again):
            hits.append(_hits(s[again], moved[again]))
    interval = quantile(sorted(hits), 0.025), quantile(sorted(hits), 0.975)
    n = int(moved.sum())
    area, share = auc(s, moved) or 0.0, _hits(s, moved)
    return Separation(detector, title, area, share, interval, n, len(s) - n)


def _hits(score: Floats, moved: NDArray[np.bool_]) -> float:
    limit = quantile(np.sort(score[~moved]), 1.0 - REST_SHARE)
    return float((score[moved] > limit).mean())


def _table(rows: Sequence[Row]) -> str:
    """Tables by class; columns "from" and "to" are the 95 % interval."""
    parts = []
    for kind, title in ((kind, title) for kind, titles in TITLES.items() for title in titles[1:]):
        found = [
            (r.time_s, s)
            for r in rows if r.kind == kind
            for s in r.separations if s.title == title
        ]  # fmt: skip
        columns: dict[str, list[object]] = {
            "ms": [round(1e3 * t) for t, _ in found], "detector": [s.detector for _, s in found],
            "AUC": [s.auc for _, s in found], "hits": [s.hits for _, s in found],
            "from": [s.interval[0] for _, s in found], "to": [s.interval[1] for _, s in found],
        }  # fmt: skip
        counts = f"{found[0][1].n}, and {found[0][1].rest} at rest" if found else "none"
        parts.append(f"{kind}, {title}: {counts}\n\n{markdown(columns)}")
    return "\n\n".join(parts)


SUMMARY = "upper bound of slip detection: a classifier that knows the onset (extra `train`)"
STUDY = Study(SUMMARY, _grid, trial, Row, _table, None, _options)
