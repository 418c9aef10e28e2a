"""To what is due what the ideal observer does not hear: rate, taxels, noise, or its own learning?

What a lesser fingertip would have felt is made of the recordings as they are: fewer samples,
fewer taxels, more of the board's noise. What another one would is felt anew: objects, grips and
blows have the same seeds, and nobody answers them, so each blow moves its object as far as before.
Differences are paired, blow by blow, either way. Needs the extra `train`.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from detector.recordings import Recording, read
from detector.scores.metrics import auc
from detector.scores.perturbations import perturbed
from detector.scores.quantiles import quantile
from drivers.interfaces import PERIOD_S
from grasp.settings import file_of
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import Job, Range, first_of_each, load_dataset_config, plan
from scenarios.rigs.workers import Workers
from scenarios.studies.detectors.observer import (
    BLOW_TITLES,
    FOLDS,
    RESAMPLES,
    SEED,
    Cases,
    Floats,
    Told,
    blow_moments,
    cases,
    hits,
)
from scenarios.studies.detectors.observer_study import DATASET, STRUCK, Tell, observed
from scenarios.world.fingertip_settings import FingertipSettings

TIMES_S = (0.02, 0.05, 0.1)
AS_IT_IS = "as it is"
_TIP = FingertipSettings()
_BOARD, _HAND, _PERIOD = "fingertip.noise_counts", "fingertip.holding_share", "loop.period_s"


class Felt(msgspec.Struct, frozen=True):
    """One thing that differs: of the fingertip, or of how the observer learns."""

    title: str
    folder: str = "run"
    fixed: dict[str, float] = {}  # settings
    layout: str = ""
    taxels: tuple[int, ...] = ()  # those of a finger that are heard; none: all
    every: int = 1  # sample that is heard
    noise: float = 1.0  # times the board's own
    folds: int = FOLDS
    seed: int = 0  # of the observer


def _noise(share: float) -> dict[str, float]:
    """So many times as much of the board's noise, and of the hand's restlessness."""
    return {_BOARD: share * _TIP.noise_counts, _HAND: share * _TIP.holding_share}


LESSER = (
    Felt(AS_IT_IS),
    Felt("the same, learnt once more", seed=100),
    Felt("the same, learnt from half the objects for four fifths", folds=2),
    Felt("50 samples a second", every=2),
    Felt("three taxels a finger", taxels=(0, 2, 4)),
    Felt("twice the board's noise", noise=2.0),
    Felt("four times the board's noise", noise=4.0),
)
ANEW = (
    Felt(AS_IT_IS),
    Felt("200 samples a second", "rate", {_PERIOD: 0.005}),
    Felt("eight taxels a finger", "eight", layout="eight"),
    Felt("half the noise of board and hand", "noise-half", _noise(0.5)),
    Felt("twice the noise of board and hand", "noise-twice", _noise(2.0)),
    Felt("none of either noise", "noise-none", _noise(0.0)),
)


class Row(msgspec.Struct, frozen=True):
    """A class of blows as one fingertip tells it, and what that is more than it is as it is."""

    felt: str
    told: Told
    auc_more: tuple[float, float, float]  # with its 95 % interval; the same of hits
    hits_more: tuple[float, float, float]


def jobs_of(felt: Felt, share: float) -> list[Job]:
    """The recordings of blows, as long in seconds whatever the rate."""
    config = load_dataset_config(file_of("datasets", DATASET))
    ranges: dict[str, Range] = {key: (value, value) for key, value in felt.fixed.items()}
    config = msgspec.structs.replace(
        config, randomise=config.randomise | ranges, layout=felt.layout
    )
    longer = PERIOD_S / felt.fixed.get(_PERIOD, PERIOD_S)
    struck = [job for job in plan(config) if job.metadata.cause == STRUCK]
    return [
        msgspec.structs.replace(job, static=round(longer * job.static))
        for job in first_of_each(struck, share)
    ]


def recorded(
    felt: Felt, folder: Path, share: float, workers: Workers, tell: Tell
) -> list[Recording]:
    """What that fingertip feels, in the order of the plan; made where the folder lacks it."""
    jobs = jobs_of(felt, share)
    origin = load_dataset_config(file_of("datasets", DATASET))
    out = folder / felt.folder
    if not all((out / job.path).exists() for job in jobs):
        build(jobs, origin, out, workers, lambda n, of: tell(n, of, felt.title), "--data")
    return [lessened(read(out / job.path), felt, i) for i, job in enumerate(jobs)]


def lessened(recording: Recording, felt: Felt, seed: int) -> Recording:
    """What is heard of it: fewer samples, fewer taxels, more noise."""
    if felt.noise > 1.0:
        recording = perturbed(recording, "noise", felt.noise, seed)
    heard = {
        name: array[:: felt.every]
        for name in recording.__struct_fields__
        if isinstance(array := getattr(recording, name), np.ndarray)
    }
    if felt.taxels:
        heard["counts"] = heard["counts"][:, :, list(felt.taxels)]
    return msgspec.structs.replace(recording, **heard)


def study(
    folder: Path, share: float, share_anew: float, workers: Workers, tell: Tell
) -> list[list[Row]]:
    """Lesser fingertips at every time, then those that are recorded anew, if any."""
    parts = [(LESSER, share)] + ([(ANEW, share_anew)] if share_anew > 0.0 else [])
    return [_part(felts, folder, its_share, workers, tell) for felts, its_share in parts]


def _part(
    felts: Sequence[Felt], folder: Path, share: float, workers: Workers, tell: Tell
) -> list[Row]:
    heard = []
    for felt in felts:
        struck = recorded(felt, folder, share, workers, tell)
        heard.append((felt, cases(struck, blow_moments(struck), {})))
    found: list[Row] = []
    for time_s in TIMES_S:
        first: list[tuple[Cases, Floats]] = []  # as it is, by class
        for i, (felt, its) in enumerate(heard):
            tell(i, len(heard), f"learning, {1e3 * time_s:.0f} ms")
            each = observed(its, time_s, BLOW_TITLES, felt.folds, felt.seed)
            first = first or [(its, score) for _, score in each]
            for (told, score), base in zip(each, first, strict=True):
                found.append(_row(felt.title, told, (its, score), base))
    return found


def _row(title: str, told: Told, its: tuple[Cases, Floats], base: tuple[Cases, Floats]) -> Row:
    kind = BLOW_TITLES.index(told.title)
    more = differences(_known(*its, kind), _known(*base, kind))
    return Row(title, told, *more)


Known = tuple[Floats, np.ndarray, np.ndarray]  # scores, moved, recordings (n,)


def _known(its: Cases, score: Floats, kind: int) -> Known:
    chosen = np.flatnonzero(np.isfinite(score) & np.isin(its.classes, (0, kind)))
    return score[chosen], its.classes[chosen] == kind, its.groups[chosen]


def differences(
    one: Known, other: Known
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """AUC and hits of one less those of the other, each with its 95 % interval, by bootstrap over
    recordings, the same of both."""
    rows = [
        {g: np.flatnonzero(groups == g) for g in np.unique(groups)} for _, _, groups in (one, other)
    ]
    shared = sorted(set(rows[0]) & set(rows[1]))
    rng = np.random.default_rng(SEED)
    drawn = []
    for _ in range(RESAMPLES):
        again = [shared[i] for i in rng.integers(0, len(shared), len(shared))]
        pair = [
            _scores(score, moved, np.concatenate([of[g] for g in again]))
            for (score, moved, _), of in zip((one, other), rows, strict=True)
        ]
        drawn.append([a - b for a, b in zip(*pair, strict=True)])
    whole = [_scores(s, m, np.arange(len(s))) for s, m, _ in (one, other)]
    found = []
    for i in (0, 1):
        ordered = sorted(d[i] for d in drawn)
        limits = quantile(ordered, 0.025), quantile(ordered, 0.975)
        found.append((whole[0][i] - whole[1][i], *limits))
    return found[0], found[1]


def _scores(score: Floats, moved: np.ndarray, rows: np.ndarray) -> tuple[float, float]:
    return auc(score[rows], moved[rows]) or 0.0, hits(score[rows], moved[rows])


def tables(found: Sequence[Sequence[Row]]) -> str:
    """Markdown: a table a class of blows, the farthest first."""
    return "\n\n".join(
        _table([r for r in rows if r.told.title == title])
        for rows in found for title in BLOW_TITLES[:0:-1]
    )  # fmt: skip


def _table(rows: Sequence[Row]) -> str:
    times = sorted({r.told.time_s for r in rows})
    heads = " | ".join(f"{1e3 * t:.0f} ms: AUC | more | hits, % | more" for t in times)
    last = rows[0].told
    lines = [f"{last.title}: {last.n} blows, {last.idle} idle.", "",
             f"| fingertip | {heads} |", f"|---|{'---|' * (4 * len(times))}"]  # fmt: skip
    for title in dict.fromkeys(r.felt for r in rows):
        its = sorted((r for r in rows if r.felt == title), key=lambda r: r.told.time_s)
        cells = [
            f"{r.told.auc:.3f} | {_more(r, r.auc_more, '+.3f')} | {100 * r.told.hits:.0f} "
            f"[{100 * r.told.hits_interval[0]:.0f}, {100 * r.told.hits_interval[1]:.0f}] | "
            f"{_more(r, tuple(100 * v for v in r.hits_more), '+.0f')}"
            for r in its
        ]  # fmt: skip
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _more(row: Row, values: Sequence[float], form: str) -> str:
    if row.felt == AS_IT_IS:
        return "–"
    return "{} [{}, {}]".format(*(format(v, form) for v in values))
