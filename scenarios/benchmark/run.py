"""`grasp benchmark`: the whole protocol for some detectors, and its result file."""

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from detector.decision import RuleSettings, cusum, fused
from detector.loading import DETECTORS, NETWORK
from detector.network_file import read_network, weights_path
from detector.recordings import Recording, read
from detector.scores.evaluation import WARM_UP_SAMPLES, Streamed, stream
from detector.scores.quantiles import quantile
from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGERS, KIT_TAXELS, PERIOD_S
from grasp.files import write_whole
from scenarios.benchmark import lifts, streams
from scenarios.benchmark.lifts import LiftRow, LiftTask, run_lift
from scenarios.benchmark.protocol import Protocol, SplitName
from scenarios.benchmark.streams import Figure, StreamScores, Tap, figure
from scenarios.lift.config import LiftConfig
from scenarios.rigs.workers import Workers, results

CHECKED = 8  # lifts of a packaged detector that are repeated on the counts alone; else all
# shares of the samples without slip above a threshold: where the curve is measured
EXCEEDED = (0.1, 0.02, 0.004, 0.0005)
ORACLE_S = (0.0, 0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.3)
TIMED_UPDATES, FIRST_UPDATES = 2000, 50  # a slow detector is known after the first
COST = "cost.json"  # beside benchmark.json: it differs between runs
Progress = Callable[[str, int, int], None]


class Point(msgspec.Struct, frozen=True):
    """A detector with one threshold, or the oracle with one delay, on lifts and taps. ``right``:
    mean of the shares of lifts and of taps done right."""

    threshold: float
    right: Figure
    lifts_right: Figure
    taps_right: Figure
    delay_p50_ms: float | None  # from the onset of slip; None: more than half were missed
    delay_p90_ms: float | None


class LiftScores(msgspec.Struct, frozen=True):
    """Lifts with the packaged rule."""

    causes: dict[str, int]
    causes_weak: dict[str, int]
    causes_fragile: dict[str, int]
    right_smooth: Figure  # of weak grips on smooth objects
    right_rough: Figure
    slip_p50_mm: float | None  # of weak grips
    slip_p90_mm: float | None
    over_least_p50: float | None  # force at the end over the least that holds, of weak grips
    over_least_p90: float | None


class TapScores(msgspec.Struct, frozen=True):
    """Taps with the packaged rule."""

    moved: int
    detected: Figure  # of those that moved the object by 2 mm or more
    detected_smooth: Figure
    detected_rough: Figure
    unmoved: int
    unanswered: Figure  # of those that moved it by less than 0.5 mm


class Cost(msgspec.Struct, frozen=True):
    """Cost of a detector; the only figures that a repeated benchmark changes."""

    update_us: float  # median, three fingers
    parameters: int | None
    bytes: int | None


class DetectorResult(msgspec.Struct, frozen=True):
    """Everything the benchmark measures of one detector, except its cost."""

    detector: str
    digest: str
    packaged: bool
    rule: RuleSettings
    point: Point
    curve: list[Point]
    streams: StreamScores
    lifts: LiftScores
    taps: TapScores
    real: dict[str, Figure]  # AUC by recording


class BenchmarkFile(msgspec.Struct, frozen=True, tag_field="kind", tag="grasp benchmark"):
    """`benchmark.json`; an infinite value is null in it."""

    version: int
    split: SplitName
    seeds: str  # digest
    layout: str
    command: str
    detectors: Annotated[list[DetectorResult], msgspec.Meta(min_length=1)]
    oracle: list[Point]


def is_benchmark(path: Path) -> bool:
    """Whether the file is a `benchmark.json`, complete or not. Raises OSError."""
    return path.read_bytes().lstrip(b"{ \n").startswith(b'"kind": "grasp benchmark"')


def read_benchmark(path: Path) -> tuple[BenchmarkFile, dict[str, Cost]]:
    """A result file, and the costs of its detectors if they are beside it. Raises BadFile and
    OSError."""
    try:
        found = msgspec.json.decode(path.read_bytes(), type=BenchmarkFile)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        problem = f"is no result of a benchmark: {error}"
        raise BadFile(path, problem, "move it away, and make it again: `grasp benchmark`") from None
    with suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
        beside = path.with_name(COST).read_bytes()
        return found, msgspec.json.decode(beside, type=dict[str, Cost])
    return found, {}


def results_of_others(
    path: Path, same: tuple[int, SplitName, str, str], names: Sequence[str]
) -> tuple[list[DetectorResult], dict[str, Cost]]:
    """Results and costs of other detectors than ``names`` in that file, if there is one. Raises
    BadFile for a damaged file and for one whose version, split, seeds and layout are not the
    ``same``, OSError."""
    if not path.exists():
        return [], {}
    file, costs = read_benchmark(path)
    if (file.version, file.split, file.seeds, file.layout) != same:
        layout = f", layout {file.layout}" if file.layout else ""
        has = f"has results of version {file.version}, split {file.split}{layout}"
        raise BadFile(path, has, "give another --out, or move that file away")
    return [each for each in file.detectors if each.detector not in names], costs


class Benchmark(msgspec.Struct, frozen=True):
    """Where and how to run."""

    protocol: Protocol
    split: SplitName
    recordings: dict[str, list[Path]]  # of the split, by set
    real: dict[str, list[Recording]]  # labelled, by name
    workers: Workers
    progress: Progress

    def detector(self, config: LiftConfig) -> DetectorResult:
        """Measure one detector."""
        name, rule = config.detector_label, config.rule
        threshold = config.make_detector(1).threshold
        sets = streams.stream_files(
            config, self.recordings, self.workers, self._shown(f"{name}, recordings")
        )
        packaged = name in DETECTORS
        rules = [rule, *curve_rules(sets, rule)]
        rows = self._lifts(config, rules, CHECKED if packaged else self.protocol.lifts.number)
        taps = [streams.score_taps(sets["mallet"], each) for each in rules]
        points = [
            point(level(each), row, tap) for each, row, tap in zip(rules, rows, taps, strict=True)
        ]
        return DetectorResult(
            detector=name, digest=config.detector_hash(), packaged=packaged, rule=rule,
            point=points[0], curve=sorted(points[1:], key=lambda p: p.threshold),
            streams=streams.score_streams(sets, rule, threshold),
            lifts=lift_scores(rows[0]), taps=tap_scores(taps[0]), real=self._real(config),
        )  # fmt: skip

    def kept_oracle(self, config: LiftConfig, path: Path) -> list[Point]:
        """``oracle``, from that file if it is there, else written to it. Raises OSError."""
        with suppress(OSError, msgspec.MsgspecError):  # a damaged file is measured again
            kept = msgspec.json.decode(path.read_bytes(), type=list[Point])
            if len(kept) == len(ORACLE_S):
                return kept
        points = self.oracle(config)
        write_whole(path, msgspec.json.encode(points), private=True)
        return points

    def oracle(self, config: LiftConfig) -> list[Point]:
        """An ideal detector that answers after each delay of ORACLE_S."""
        base = msgspec.structs.replace(config, rule=lifts.ORACLE_RULE)
        tasks = [
            msgspec.structs.replace(task, oracle_s=delay_s)
            for delay_s in ORACLE_S for task in lifts.tasks(base, self.split, 0)
        ]  # fmt: skip
        rows = self._run(tasks, "oracle")
        none = np.empty((0, FINGERS))
        taps = [Streamed(read(file), none, none) for file in self.recordings["mallet"]]
        return [
            point(delay_s, [row for task, row in rows if task.oracle_s == delay_s],
                  streams.oracle_taps(taps, 1e3 * delay_s))
            for delay_s in ORACLE_S
        ]  # fmt: skip

    def _lifts(
        self, config: LiftConfig, rules: Sequence[RuleSettings], checked: int
    ) -> list[list[LiftRow]]:
        """Lifts by each rule; those by the first check the detector."""
        tasks = [
            task
            for i, rule in enumerate(rules)
            for task in lifts.tasks(
                msgspec.structs.replace(config, rule=rule), self.split, 0 if i else checked
            )
        ]
        found = self._run(tasks, config.detector_label)
        n = self.protocol.lifts.number
        return [[row for _, row in found[i * n : (i + 1) * n]] for i in range(len(rules))]

    def _run(self, tasks: Sequence[LiftTask], name: str) -> list[tuple[LiftTask, LiftRow]]:
        shown, found = self._shown(f"{name}, lifts"), {}
        shown(0, len(tasks))
        quiet = partial(streams.give_up, name)
        numbered = results(_numbered, list(enumerate(tasks)), self.workers, quiet)
        for done, (key, row) in enumerate(numbered, 1):
            found[key] = row
            shown(done, len(tasks))
        return [(task, found[i]) for i, task in enumerate(tasks)]

    def _real(self, config: LiftConfig) -> dict[str, Figure]:
        found = {}
        for name, recordings in self.real.items():
            parts = []
            for recording in recordings:
                made = config.make_detector(recording.fingers, recording.taxels)
                p = stream(made, recording.counts)[0]
                parts.append(streams.samples(Streamed(recording, p, np.empty(0)), config.rule))
            found[name] = streams.sample_auc(parts)
        return found

    def _shown(self, title: str) -> Callable[[int, int], None]:
        return lambda done, of: self.progress(title, done, of)


def costs_of(
    configs: Sequence[LiftConfig], real: dict[str, list[Recording]], workers: Workers
) -> dict[str, Cost]:
    """``cost`` by detector. Raises UsageError, also for one that cannot read a recording."""
    one, found = Workers(min(1, workers.processes)), {}
    for config in configs:
        quiet = partial(streams.give_up, config.detector_label)
        (found[config.detector_label],) = results(partial(_first_use, config), [real], one, quiet)
    return found


def _first_use(config: LiftConfig, real: dict[str, list[Recording]]) -> Cost:
    config.make_detector(1)  # the paper's recordings are of one finger
    for name, each in ((name, each) for name, parts in real.items() for each in parts):
        try:
            config.make_detector(each.fingers, each.taxels)
        except UsageError as error:
            raise UsageError(f"{name}: {error.message}", error.remedy) from None
    return cost(config)


def _numbered(task: tuple[int, LiftTask]) -> tuple[int, LiftRow]:
    return task[0], run_lift(task[1])


def level(rule: RuleSettings) -> float:
    """What the curve varies: the limit of a CUSUM, or the threshold."""
    return rule.limit if rule.kind == "cusum" else rule.threshold


def curve_rules(sets: dict[str, list[Streamed]], rule: RuleSettings) -> list[RuleSettings]:
    """The rule with levels that EXCEEDED shares of the samples without slip are above."""
    still = []
    for s in (s for each in sets.values() for s in each):
        p = fused(s.probabilities, rule)
        values = (cusum(p, rule) if rule.kind == "cusum" else p).max(axis=1)
        still.append(values[WARM_UP_SAMPLES:][~s.labels[WARM_UP_SAMPLES:]])
    ordered = np.sort(np.concatenate(still))
    levels = sorted({quantile(ordered, 1.0 - share) for share in EXCEEDED})
    if rule.kind == "cusum":
        return [msgspec.structs.replace(rule, limit=x) for x in levels if 0.0 < x <= 200.0]
    return [msgspec.structs.replace(rule, threshold=x) for x in levels if 0.0 < x < 1.0]


def point(threshold: float, rows: Sequence[LiftRow], taps: Sequence[Tap]) -> Point:
    """Lifts and taps of one rule. Taps of one recording share an object and a hand."""
    of_hand: dict[int, list[Tap]] = {}
    for tap in taps:
        of_hand.setdefault(tap.recording, []).append(tap)
    hands = list(of_hand.values())
    lifted = figure(_share, [[row.right] for row in rows])
    tapped = figure(taps_right, hands)
    delays = sorted(
        d for d in (*(r.delay_ms for r in rows), *(t.delay_ms for t in taps)) if d is not None
    )
    both = None
    if lifted.value is not None and tapped.value is not None:
        both = (lifted.value + tapped.value) / 2.0
    return Point(
        threshold, _mean_of(both, lifted, tapped), lifted, tapped,
        _finite(delays, 0.5), _finite(delays, 0.9),
    )  # fmt: skip


def taps_right(hands: Sequence[Sequence[Tap]]) -> float | None:
    """Mean of the shares done right of taps that moved the object and of those that did not."""
    shares = [_share([[t.right for t in each if t.moved is m] for each in hands])
              for m in (False, True)]  # fmt: skip
    known = [share for share in shares if share is not None]
    return sum(known) / len(known) if known else None


def _mean_of(value: float | None, one: Figure, other: Figure) -> Figure:
    """Mean of two independent figures, whose errors add as squares."""
    if value is None or one.low is None or other.low is None:
        return Figure(value)
    below = 0.5 * math.hypot(one.value - one.low, other.value - other.low)  # type: ignore[operator]
    above = 0.5 * math.hypot(one.high - one.value, other.high - other.value)  # type: ignore[operator]
    return Figure(value, value - below, value + above)


def _finite(ordered: Sequence[float], share: float) -> float | None:
    value = quantile(ordered, share) if ordered else math.inf
    return value if math.isfinite(value) else None


def _share(units: Sequence[Sequence[bool]]) -> float | None:
    every = [each for unit in units for each in unit]
    return sum(every) / len(every) if every else None


def lift_scores(rows: Sequence[LiftRow]) -> LiftScores:
    """Scores of the lifts by one rule."""
    weak = [row for row in rows if row.weak]
    slips = sorted(row.slip_mm for row in weak if row.slip_mm is not None)
    over = sorted(row.over_least for row in weak if row.over_least is not None)

    def causes(chosen: Sequence[LiftRow]) -> dict[str, int]:
        return dict(sorted(Counter(row.cause for row in chosen).items()))

    return LiftScores(
        causes(rows), causes(weak), causes([row for row in rows if row.fragile]),
        figure(_share, [[row.right] for row in weak if row.smooth]),
        figure(_share, [[row.right] for row in weak if not row.smooth]),
        _finite(slips, 0.5), _finite(slips, 0.9), _finite(over, 0.5), _finite(over, 0.9),
    )  # fmt: skip


def tap_scores(taps: Sequence[Tap]) -> TapScores:
    """Scores of the taps by one rule."""
    moved = [tap for tap in taps if tap.moved]
    unmoved = [tap for tap in taps if not tap.moved]

    def right(chosen: Sequence[Tap]) -> Figure:
        hands = sorted({tap.recording for tap in chosen})
        return figure(_share, [[t.right for t in chosen if t.recording == k] for k in hands])

    return TapScores(
        len(moved), right(moved), right([t for t in moved if t.smooth]),
        right([t for t in moved if not t.smooth]), len(unmoved), right(unmoved),
    )  # fmt: skip


def cost(config: LiftConfig, clock_ns: Callable[[], int] = time.thread_time_ns) -> Cost:
    """Median time of an update of three fingers, and the size of a network. Raises UsageError for
    a detector that needs more than a sample period: it would answer late."""
    detector = config.make_detector(FINGERS)
    taxels = config.tactile.taxels or KIT_TAXELS
    steps = np.random.default_rng(0).integers(-3, 4, (TIMED_UPDATES, FINGERS, taxels))
    walk = np.clip(np.cumsum(steps, axis=0), -400, 200).astype(np.int16)
    spent_us: list[float] = []
    for updates in (FIRST_UPDATES, TIMED_UPDATES):
        for counts in walk[len(spent_us) : updates]:
            start = clock_ns()
            detector.update(counts)
            spent_us.append((clock_ns() - start) * 1e-3)
        median_us = quantile(sorted(spent_us), 0.5)
        if median_us > 1e6 * PERIOD_S:
            raise UsageError(
                f"{config.detector_label}: one update takes {median_us / 1e3:.1f} ms",
                f"a detector has to answer within the sample period of {1e3 * PERIOD_S:g} ms",
            )
    if config.detector_section != NETWORK:
        return Cost(median_us, None, None)
    path = weights_path(config.network.weights or config.detector_name)
    card = read_network(path).card
    return Cost(median_us, card.parameters or None, path.stat().st_size)
