"""The ideal observer beside the detectors.

Drawn objects are struck and lifted for it alone (config/datasets/observer.toml). Needs the extra
`train`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from detector.recordings import Recording, read_dataset
from detector.scores.quantiles import quantile
from detector.training.observer import held_out
from drivers.errors import UsageError
from grasp.settings import file_of
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import first_of_each, load_dataset_config, plan
from scenarios.rigs.workers import Workers
from scenarios.studies.detectors.observer import (
    BLOW_TITLES,
    FOLDS,
    LIFT_TITLES,
    TIMES_S,
    Cases,
    Point,
    Told,
    blow_moments,
    cases,
    features,
    heard,
    lift_moments,
    loudest,
    point,
    told,
)

DATASET = "observer"
SOON_S = 0.1  # at which detectors are compared
STRUCK = "grasped_blow"
SHARES = tuple(np.linspace(0.005, 0.3, 60).tolist())  # of idle blows registered


class Study(msgspec.Struct, frozen=True):
    """What is in the chart, and its table."""

    recordings: dict[str, int]
    blows: list[Told]
    lifts: list[Told]
    detectors: dict[str, list[Told]]  # of blows, by the most that each said, the blow's time known
    curves: dict[str, list[tuple[float, float]]]  # idle, hits of the last class, SOON_S after
    points: list[Point]
    lift_points: list[Point]


Tell = Callable[[int, int, str], None]


def drawn(folder: Path, share: float, workers: Workers, tell: Tell) -> list[Recording]:
    """So large a share of the recordings, made where the folder lacks them."""
    config, folder = load_dataset_config(file_of("datasets", DATASET)), folder / "run"
    jobs = first_of_each(plan(config), share)
    build(jobs, config, folder, workers, lambda n, of: tell(n, of, "recordings"), "--data")
    return read_dataset(folder)


def study(names: Sequence[str], folder: Path, share: float, workers: Workers, tell: Tell) -> Study:
    """Everything; recordings that lie in the folder already are read."""
    made = drawn(folder, share, workers, tell)
    struck = [r for r in made if r.metadata and r.metadata.cause == STRUCK]
    lifted = [r for r in made if r.metadata and r.metadata.cause != STRUCK]
    blows = cases(struck, blow_moments(struck), heard(names, struck))
    lifts = cases(lifted, lift_moments(lifted), heard(names, lifted))
    for its, titles in ((blows, BLOW_TITLES), (lifts, LIFT_TITLES)):
        require_every_class(its, titles)
    ends = len(TIMES_S) * 2
    found: dict[str, list[tuple[Told, Any]]] = {"blows": [], "lifts": []}
    for kind, its, titles in (("blows", blows, BLOW_TITLES), ("lifts", lifts, LIFT_TITLES)):
        for time_s in TIMES_S:
            tell(len(found["blows"]) // 3 + len(found["lifts"]) // 3, ends, "learning")
            found[kind] += observed(its, time_s, titles)
    far = len(BLOW_TITLES) - 1
    curves = {"observer": _curve(blows, _score(found["blows"], far), far)}
    curves |= {name: _curve(blows, loudest(blows, name, SOON_S), far) for name in names}
    return Study(
        recordings={"blows": len(struck), "lifts": len(lifted)},
        blows=[t for t, _ in found["blows"]],
        lifts=[t for t, _ in found["lifts"]],
        detectors={name: _detector(blows, name) for name in names},
        curves=curves,
        points=[
            point(blows, n, k, SOON_S, BLOW_TITLES) for n in names for k in range(1, far + 1)
        ],
        lift_points=[
            point(lifts, n, k, s, LIFT_TITLES)
            for n in names for k in range(1, len(LIFT_TITLES)) for s in TIMES_S
        ],
    )  # fmt: skip


def require_every_class(cases: Cases, titles: Sequence[str]) -> None:
    """Raises UsageError where a class is in too few recordings to be learnt and asked about."""
    for kind, title in enumerate(titles):
        recordings = len(np.unique(cases.groups[cases.classes == kind]))
        if recordings < FOLDS:
            text = f"{title!r} is in {recordings} recordings, of {FOLDS} at least that are needed"
            raise UsageError(text, "a greater --share, into another folder")


def observed(
    cases: Cases, time_s: float, titles: Sequence[str], folds: int = FOLDS, seed: int = 0
) -> list[tuple[Told, Any]]:
    """Of each class but rest, how well the observer tells it, with its scores (n,) of that class;
    cases that were over before so long are left out, and score nan."""
    own = np.flatnonzero(cases.lasts >= cases.samples(time_s))
    part = cases.part(own)
    odds = held_out(features(part, time_s), part.classes, part.groups, folds, seed)
    found = []
    for kind in range(1, odds.shape[1]):
        score = np.full(len(cases.classes), np.nan)
        score[own] = odds[:, kind] - odds[:, 0]
        found.append((told(cases, score, kind, time_s, titles), score))
    return found


def _score(found: Sequence[tuple[Told, Any]], kind: int) -> Any:
    return next(s for t, s in found if t.title == BLOW_TITLES[kind] and t.time_s == SOON_S)


def _detector(blows: Cases, name: str) -> list[Told]:
    return [
        told(blows, loudest(blows, name, time_s), kind, time_s, BLOW_TITLES)
        for time_s in TIMES_S for kind in range(1, len(BLOW_TITLES))
    ]  # fmt: skip


def _curve(blows: Cases, score: Any, kind: int) -> list[tuple[float, float]]:
    """Share of what moved that is registered, for each share of what did not."""
    known = np.isfinite(score)
    moved, idle = (score[known & (blows.classes == k)] for k in (kind, 0))
    ordered = np.sort(idle)
    return [(s, float((moved > quantile(ordered, 1.0 - s)).mean())) for s in SHARES]


def tables(found: Study) -> str:
    """Markdown: blows, what detectors make of them, lifts."""
    parts = [_by_time(found.blows, BLOW_TITLES[1:], "blow that moved it"), _of_detectors(found)]
    return "\n\n".join([*parts, _by_time(found.lifts, LIFT_TITLES[1:], "lift that slips")])


def _by_time(every: Sequence[Told], titles: Sequence[str], what: str) -> str:
    heads = " | ".join(f"{title}: AUC | hits" for title in titles)
    lines = [f"| ms after the {what} | {heads} |", f"|---|{'---|' * (2 * len(titles))}"]
    for time_s in sorted({t.time_s for t in every}):
        of = {t.title: t for t in every if t.time_s == time_s}
        cells = " | ".join(f"{_auc(of[t])} | {_hits(of[t])}" for t in titles if t in of)
        lines.append(f"| {1e3 * time_s:.0f} | {cells} |")
    last = {t.title: t for t in every}
    counts = ", ".join(f"{t.n} {title}" for title, t in last.items())
    idle = next(iter(last.values())).idle
    return "\n".join([*lines, "", f"{counts}; {idle} in which nothing slipped."])


def _of_detectors(found: Study) -> str:
    titles = BLOW_TITLES[1:]
    heads = [f"{t}: AUC | hits" for t in titles]
    heads += ["by its own rule: within 0.5 mm", *titles]
    lines = [f"| detector | {' | '.join(heads)} |", f"|---|{'---|' * (3 * len(titles) + 1)}"]
    for name, every in found.detectors.items():
        of = {t.title: t for t in every if t.time_s == SOON_S}
        own = {p.title: p for p in found.points if p.detector == name}
        cells = " | ".join(f"{of[t].auc:.3f} | {100 * of[t].hits:.0f}" for t in titles)
        ruled = " | ".join(f"{100 * own[t].hits:.0f}" for t in titles)
        lines.append(f"| `{name}` | {cells} | {100 * own[titles[-1]].idle:.0f} | {ruled} |")
    return "\n".join(lines)


def _auc(t: Told) -> str:
    return f"{t.auc:.3f} [{t.auc_interval[0]:.3f}, {t.auc_interval[1]:.3f}]"


def _hits(t: Told) -> str:
    low, high = (100 * v for v in t.hits_interval)
    return f"{100 * t.hits:.0f} [{low:.0f}, {high:.0f}]"
