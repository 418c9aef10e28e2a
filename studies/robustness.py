"""Detectors on recordings with one perturbation: a taxel, noise, lost samples or a stiffer pad.

Detectors and rules are the packaged ones; the scores use a part of the split `test`. A perturbation
starts with the first sample and affects every finger. A dead, stuck or swapped taxel is the most
pressed one of the first finger. For the stiffer pad each recording's plan is simulated again.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import SlipDetector
from detector.recordings import COUNTS_LIMIT, INDEX, Recording
from detector.scores.evaluation import (
    SLIDE,
    WARM_UP_SAMPLES,
    Streamed,
    cause_of,
    hand_probability,
    hand_rate,
    score_impacts,
    score_stream,
)
from detector.scores.quantiles import quantiles
from drivers.errors import BadFile
from drivers.interfaces import PERIOD_S
from grasp.cli.options import whole
from grasp.cli.parser import Parser
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import DatasetConfig, Job, plan
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.world.settings import FingertipSettings
from studies.runner import Study, add_data, markdown

Floats = NDArray[np.float64]
COMPARED = ("tcn", "gru", "energy", "psd-fair")
NOISE_COUNTS = 0.65  # RMS of a taxel before rounding (`fingertip.noise_counts`)
COUNTS_PER_K = 1.6  # of the simulated barometer
RAIL_COUNTS = -450  # code 0, the end of the range
STEP_S, RAMP_S = 4.0, 1.0  # time between temperature steps; duration of a step
PAD, STIFFNESS = "pad", "fingertip.foundation_n_per_mm3"
LATEST_MS = 600.0  # the chart shows a missed slip here
GRID: dict[str, tuple[str, float, tuple[float, ...]]] = {  # unit, amount of no change, others
    "gain": ("times", 1.0, (0.5, 0.71, 1.41, 2.0)),
    "noise": ("times the board's", 1.0, (2.0, 4.0)),
    "lost": ("of the samples", 0.0, (0.01, 0.03, 0.1)),
    "temperature": ("K every 4 s", 0.0, (2.0, 10.0)),
    "drift": ("counts a minute", 0.0, (30.0, 300.0)),
    "rate": ("samples a second", 100.0, (90.0, 110.0)),
    **dict.fromkeys(("dead", "stuck", "swapped"), ("taxel of 18", 0.0, (1.0,))),
    PAD: ("times as stiff", 1.0, (2.0,)),
}
TITLES = {
    "accuracy": "accuracy", "recall": "recall", "p90_ms": "p90 delay, ms",
    "false_per_min": "false alarms a minute", "taps": "taps of 2 mm registered",
    "no_slip_taps": "no-slip taps registered",
}  # fmt: skip
BROKEN = ("dead", "stuck", "swapped", PAD)  # share one column of the chart


class Task(msgspec.Struct, frozen=True):
    """A perturbation; kind "" is the unchanged recording."""

    kind: str
    amount: float
    detectors: tuple[str, ...]
    data: tuple[str, ...]
    recordings: int


class Score(msgspec.Struct, frozen=True):
    """Scores of one detector with its rule; None where undefined."""

    detector: str
    accuracy: float  # of samples, at the detector's threshold
    recall: float | None  # of slips outside taps
    p90_ms: float | None  # delay of slips of pressed fingertips; None also if missed
    false_per_min: float | None  # of a hand
    taps: float | None  # share of taps of 2 mm or more registered within 100 ms
    no_slip_taps: float | None  # share of taps below 0.5 mm that were registered


class Row(msgspec.Struct, frozen=True):
    """All detectors under one perturbation."""

    kind: str
    amount: float
    scores: list[Score]


def _options(parser: Parser) -> None:
    add_data(parser)
    parser.add_argument("--detectors", nargs="+", default=COMPARED, metavar="NAME")
    parser.add_argument("--recordings", type=whole(1, 100_000), default=150, metavar="N",
                        help="at most (default: %(default)s)")  # fmt: skip
    parser.add_argument("--no-pad", action="store_true", help="leave out the stiffer pad")


def _grid(args: argparse.Namespace) -> list[Task]:
    data, names = tuple(str(folder) for folder in args.data), tuple(args.detectors)
    kinds = [("", 0.0)] + [
        (kind, amount) for kind, (_, _, amounts) in GRID.items() for amount in amounts
        if kind != PAD or not args.no_pad
    ]  # fmt: skip
    return [Task(kind, amount, names, data, args.recordings) for kind, amount in kinds]


def trial(task: Task) -> Row:
    """Stream the changed recordings through every detector."""
    recordings = _recordings(task.data, task.recordings)
    if task.kind == PAD:
        jobs = {k: job for folder in task.data for k, job in stiffer(folder, task.amount).items()}
        recordings = [make(jobs[r.source]) for r in recordings]
    elif task.kind:
        recordings = [perturbed(r, task.kind, task.amount, i) for i, r in enumerate(recordings)]
    return Row(task.kind, task.amount, [score(name, recordings) for name in task.detectors])


@lru_cache(maxsize=1)
def _recordings(data: tuple[str, ...], most: int) -> list[Recording]:
    return chosen(read_split([Path(folder) for folder in data], "test"), most)


def chosen(recordings: Sequence[Recording], most: int) -> list[Recording]:
    """A selection of at most ``most``, evenly spread over the recordings ordered by cause."""
    n, ordered = len(recordings), sorted(recordings, key=cause_of)
    return ordered if n <= most else [ordered[(2 * i + 1) * n // (2 * most)] for i in range(most)]


def stream_together(
    make_detector: Callable[[int, int], SlipDetector], recordings: Sequence[Recording]
) -> list[Streamed]:
    """The result of `stream_recordings`, computed side by side as fingers of one large hand."""
    fingers = [r.fingers for r in recordings]
    longest = max(len(r.t_s) for r in recordings)
    frames = np.concatenate(
        [np.pad(r.counts, ((0, longest - len(r.t_s)), (0, 0), (0, 0)), "edge") for r in recordings],
        axis=1,
    )
    detector = make_detector(sum(fingers), recordings[0].taxels)
    outputs = np.array([detector.update(frame) for frame in frames])
    parts = np.split(outputs, np.cumsum(fingers)[:-1], axis=1)
    return [
        Streamed(r, p[: len(r.t_s)], np.empty(0)) for r, p in zip(recordings, parts, strict=True)
    ]


def score(name: str, recordings: Sequence[Recording]) -> Score:
    """Scores of a detector on recordings of one layout."""
    config = load_config("can", "simulated", name)
    rule, threshold = config.rule, config.make_detector(1).threshold
    streams = stream_together(config.make_detector, recordings)
    scored = [score_stream(s, rule, exclude_impacts=True) for s in streams]
    right = [
        ((hand_probability(s, rule) > threshold) == s.labels)[WARM_UP_SAMPLES:] for s in streams
    ]
    delays = np.concatenate([each.events.delays_ms for each in scored])
    pressed = quantiles(
        d for s, each in zip(streams, scored, strict=True) if cause_of(s.recording) == SLIDE
        for d in each.events.delays_ms.tolist()
    )  # fmt: skip
    taps = score_impacts(scored)
    return Score(
        name, float(np.concatenate(right).mean()),
        float(np.isfinite(delays).mean()) if len(delays) else None,
        pressed.p90 if pressed and np.isfinite(pressed.p90) else None,
        hand_rate(streams, [each.events for each in scored]),
        taps.far_registered / taps.far if taps and taps.far else None,
        taps.unmoved_registered / taps.unmoved if taps and taps.unmoved else None,
    )  # fmt: skip


class _Built(msgspec.Struct, frozen=True):
    dataset: DatasetConfig


def stiffer(folder: str, factor: float) -> dict[str, Job]:
    """Plans of a folder's recordings with a stiffer pad, by path. Raises BadFile."""
    path = Path(folder) / INDEX
    try:
        jobs = plan(msgspec.json.decode(path.read_bytes(), type=_Built).dataset)
    except (OSError, msgspec.MsgspecError) as error:
        raise BadFile(path, f"has no plan of the set: {error}", "build it again") from None
    found = {}
    for job in jobs:
        known = job.metadata.parameters
        value = factor * known.get(STIFFNESS, FingertipSettings().foundation_n_per_mm3)
        metadata = msgspec.structs.replace(job.metadata, parameters=known | {STIFFNESS: value})
        found[str(Path(folder) / job.path)] = msgspec.structs.replace(job, metadata=metadata)
    return found


def perturbed(recording: Recording, kind: str, amount: float, seed: int = 0) -> Recording:
    """The recording with one perturbation, a key of ``GRID``. Equal seeds give equal recordings."""
    if kind == "rate":
        return _resampled(recording, amount)
    counts, rng = recording.counts, np.random.default_rng(seed)
    t_s = np.arange(len(counts)) * PERIOD_S
    changed = counts.astype(np.float64)
    order = np.argsort(counts[:, 0].mean(axis=0), kind="stable")  # most pressed taxel first
    first, last = order[: int(amount)], order[::-1][: int(amount)]
    if kind == "gain":
        changed = np.maximum(counts * amount, np.minimum(counts, RAIL_COUNTS))
    elif kind == "noise":
        changed += NOISE_COUNTS * np.sqrt(amount**2 - 1.0) * rng.standard_normal(counts.shape)
    elif kind == "lost":  # the driver repeats the sample before
        lost = rng.random(len(counts)) < amount
        lost[0] = False
        changed = changed[np.maximum.accumulate(np.where(lost, 0, np.arange(len(counts))))]
    elif kind == "temperature":
        turn, into_s = np.divmod(t_s, STEP_S)
        ramp = np.minimum(into_s / RAMP_S, 1.0)
        warmer = np.where(turn % 2 == 0, ramp, 1.0 - ramp) * amount
        changed += COUNTS_PER_K * warmer[:, None, None]
    elif kind == "drift":
        direction = rng.choice([-1.0, 1.0], counts.shape[1:])
        changed += (t_s * amount / 60.0)[:, None, None] * direction
    elif kind == "dead":
        changed[:, 0, first] = 0.0
    elif kind == "stuck":
        changed[:, 0, first] = np.median(counts[:, 0, first], axis=0)
    else:
        changed[:, 0, first], changed[:, 0, last] = counts[:, 0, last], counts[:, 0, first]
    return msgspec.structs.replace(recording, counts=_counts(changed))


def _counts(values: Floats) -> NDArray[np.int16]:
    return np.clip(np.rint(values), -COUNTS_LIMIT, COUNTS_LIMIT).astype(np.int16)


def _resampled(recording: Recording, hertz: float) -> Recording:
    """Linear interpolation of the counts; all other fields from the sample before."""
    t_s = recording.t_s
    new_s = np.arange(t_s[0], t_s[-1], 1.0 / hertz)
    before = np.searchsorted(t_s, new_s, side="right") - 1
    after = np.minimum(before + 1, len(t_s) - 1)
    part = (new_s - t_s[before]) / np.maximum(t_s[after] - t_s[before], 1e-9)
    low, high = (recording.counts[k].astype(np.float64) for k in (before, after))
    changed = {
        name: value[before] for name in recording.__struct_fields__
        if isinstance(value := getattr(recording, name), np.ndarray)
    }  # fmt: skip
    changed |= {"t_s": new_s, "counts": _counts(low + (high - low) * part[:, None, None])}
    return msgspec.structs.replace(recording, **changed)


def _table(rows: Sequence[Row]) -> str:
    """Scores of samples and slips, then of taps."""
    flat = [
        (f"{row.kind}: {row.amount:g} {GRID[row.kind][0]}" if row.kind else "none", s)
        for row in rows for s in row.scores
    ]  # fmt: skip
    names = {"perturbation": [n for n, _ in flat], "detector": [s.detector for _, s in flat]}
    parts = (("accuracy", "recall", "p90_ms", "false_per_min"), ("taps", "no_slip_taps"))
    return "\n\n".join(
        markdown(names | {TITLES[key]: [getattr(s, key) for _, s in flat] for key in keys})
        for keys in parts
    )


def _chart(rows: Sequence[Row], figure: Any) -> None:
    """Panels by score (rows) and perturbation (columns), with a line per detector."""
    scores = ("accuracy", "p90_ms", "false_per_min", "taps")
    curves = [kind for kind in GRID if kind not in BROKEN]
    panels = figure.subplots(len(scores), len(curves) + 1, sharey="row", sharex="col")
    for line, key in zip(panels, scores, strict=True):
        line[0].set_ylabel(TITLES[key], fontsize=8)
        for i, name in enumerate(s.detector for s in rows[0].scores):
            values = {(r.kind, r.amount): _value(r.scores[i], key) for r in rows}
            for panel, kind in zip(line, curves, strict=False):
                at = {GRID[kind][1]: values["", 0.0]}
                at |= {amount: v for (k, amount), v in values.items() if k == kind}
                panel.plot(sorted(at), [at[a] for a in sorted(at)], "o-", ms=3, lw=1, label=name)
                panel.set_xlabel(f"{kind}, {GRID[kind][0]}" if key == "taps" else "", fontsize=8)
            broken = {k or "none": v for (k, _), v in values.items() if k in ("", *BROKEN)}
            line[-1].plot(list(broken), list(broken.values()), "o", ms=4)
    panels[0][0].legend(fontsize=7)


def _value(one: Score, key: str) -> float:
    value: float | None = getattr(one, key)
    return (LATEST_MS if key == "p90_ms" else float("nan")) if value is None else value


STUDY = Study(
    "slip detectors on perturbed recordings: gain, taxels, noise, samples, rate, pad",
    _grid, trial, Row, _table, _chart, _options, (15.0, 8.5),
)  # fmt: skip
