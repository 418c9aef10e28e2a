"""Parts of the results that stream recordings through detectors."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from detector.scores.evaluation import WARM_UP_SAMPLES, score_stream, scored_samples
from detector.scores.events import EventOutcomes
from detector.scores.figures import Figure, figure, samples_of
from detector.scores.quantiles import quantiles
from drivers.errors import GraspError
from grasp.cli import main as cli
from scenarios.benchmark.ranking import BEST, ranked
from scenarios.benchmark.run import cost
from scenarios.benchmark.score_file import BENCHMARK, read_scores
from scenarios.benchmark.scoring import Contender, contender, read_split
from scenarios.campaign.config import load_config
from scenarios.rigs.workers import Workers, results
from studies.paper_tables import PAPER_METHODS
from studies.results_page import ACCURACY, AT_BEST, Made, Row, between, median, percent
from studies.results_run import Run

Z = 1.96


class Task(msgspec.Struct, frozen=True):
    """One detector, a data set that scores it, and one that sets its best threshold."""

    detector: str
    test: str
    thresholds: str

    def streamed(self, folder: str) -> Contender:
        return contender(self.detector, read_split([Path(folder)], "all"), "all")


def alarms(item: str, judged: Sequence[EventOutcomes]) -> Row:
    """False alarms a minute of a hand, with a Poisson interval (Byar's approximation)."""
    n, seconds = sum(j.false for j in judged), sum(j.hand_s for j in judged)
    ends = (k * (1 - 1 / (9 * k) + sign * Z / (3 * math.sqrt(k))) ** 3 if k else 0.0
            for k, sign in ((n, -1), (n + 1, 1)))  # fmt: skip
    return between(item, "false alarms a minute", n, ends, n, 60.0 / seconds)


def detectors(run: Run) -> Made:
    """The paper's Table II."""
    test, thresholds = str(run.data("paper")), str(run.data("thresholds"))
    names = run.settings.detectors
    tasks = [Task(name, test, thresholds) for name in names]
    found = dict(results(score, tasks, Workers(run.jobs)))
    rows = []
    for name in names:
        rows += found[name]
        update_us = cost(load_config("can", "simulated", name).for_lift())
        rows.append(Row(name, "one update, ms", 1e-3 * update_us))
    slip = np.concatenate([r.slip[WARM_UP_SAMPLES:] for r in read_split([Path(test)], "all")])
    static = 100 * float(np.mean(~slip))
    rows += [Row("always static", m, static, n=len(slip)) for m in (ACCURACY, AT_BEST)]
    return rows


def score(task: Task) -> tuple[str, list[Row]]:
    """Name and rows."""
    name, made = task.detector, task.streamed(task.test)
    sheet, rule, streams = made.evaluation(), made.config.rule, made.streams
    judged = [score_stream(s, rule).events for s in streams]
    samples, n = samples_of([scored_samples(s, rule) for s in streams]), sheet.confusion.n
    others = task.streamed(task.thresholds).streams
    at_best = samples.accuracy(best_threshold([scored_samples(s, rule) for s in others]))
    delays = [j.delays_ms for j in judged]
    every = np.concatenate(delays)
    rows = [
        of_figure(name, ACCURACY, sheet.figures["accuracy"], n=n),
        of_figure(name, AT_BEST, at_best, n=n),
        of_figure(name, "AUC", sheet.figures["auc"], 1.0, n),
        median(name, "delay p50, ms", quantiles(every)),
        mean_delay(name, [d[np.isfinite(d)] for d in delays]),
        percent(name, "slips missed, %", int(np.isinf(every).sum()), len(every)),
        alarms(name, judged),
    ]  # fmt: skip
    if name in PAPER_METHODS:
        rows.append(Row(name, "paper: accuracy, %", PAPER_METHODS[name][0]))
    return name, rows


def of_figure(
    item: str, measure: str, f: Figure, factor: float = 100.0, n: int | None = None
) -> Row:
    value, low, high = (None if x is None else factor * x for x in (f.value, f.low, f.high))
    return Row(item, measure, value, low, high, n)


def best_threshold(parts: Sequence[tuple[Any, Any]]) -> float:
    """The probability with the best mean recall of both classes."""
    p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
    tried, group = np.unique(p, return_inverse=True)
    slip, static = (np.cumsum(np.bincount(group, of)) for of in (labels, ~labels))
    return float(tried[int(np.argmax(static / static[-1] - slip / slip[-1]))])


def mean_delay(name: str, delays: Sequence[Any]) -> Row:
    """Mean delay of registered slips; the interval resamples recordings."""

    def mean(chosen: Sequence[Any]) -> float | None:
        every = np.concatenate(chosen)
        return float(every.mean()) if len(every) else None

    measure, n = "mean delay of registered slips, ms", sum(map(len, delays))
    return of_figure(name, measure, figure(mean, delays), 1.0, n or None)


def benchmark(run: Run) -> Made:
    """`grasp benchmark` of all detectors on the split `test`, after that on `validation`, which
    chooses thresholds."""
    real = ("--recording", str(run.real)) if run.real else ()
    words = ("benchmark", *run.settings.detectors, "--out", str(run.folder), *real)
    for split in ("validation", "test"):
        (run.folder / split / BENCHMARK).unlink(missing_ok=True)  # maybe of another version
        if cli.main([*words, "--split", split, "--jobs", str(run.jobs)]):
            raise GraspError("the benchmark did not finish", "its message is above")
    return of_scores(run.folder / "test" / BENCHMARK)


def of_scores(path: Path) -> Made:
    """Rows of a benchmark's file of scores."""
    file, costs = read_scores(path)
    rows = []
    for each in ranked(file):
        item = each.of.detector if each.point == each.of.point else f"{each.of.detector}, {BEST}"
        s, p = each.of.figures, each.point
        for measure, f, factor in (
            ("score", p.score, 100.0), ("behind the first", each.behind, 100.0),
            ("raw, %", p.raw, 100.0), ("lifts, %", p.lifts, 100.0),
            ("taps that moved, %", p.moved, 100.0), ("taps that did not, %", p.unmoved, 100.0),
            ("false alarms a minute", p.false_per_min, 1.0),
            ("lasting slip reported, %", s["sustained"], 100.0), ("AUC", s["auc"], 1.0),
            *((f"AUC, {name}", f, 1.0) for name, f in each.of.real.items()),
        ):  # fmt: skip
            rows.append(of_figure(item, measure, f, factor))
        p50, p90 = (math.inf if d is None else d for d in (p.delay_p50_ms, p.delay_p90_ms))
        rows.append(Row(item, "delay p50, ms", p50, None, p90))
        rows.append(Row(item, "update, µs", costs[each.of.detector]))
    file = msgspec.structs.replace(file, command="")  # it has paths of this machine
    return rows, msgspec.to_builtins(file)
