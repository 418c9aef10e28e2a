"""`grasp benchmark`: the whole protocol for some detectors."""

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from detector.decision import RuleSettings, cusum, fused
from detector.loading import DETECTORS, NETWORK
from detector.network_file import read_network, weights_path
from detector.recordings import Recording, read
from detector.scores.evaluation import WARM_UP_SAMPLES, Streamed, scored_samples, stream
from detector.scores.figures import Figure, figure, samples_of
from detector.scores.quantiles import quantile
from drivers.errors import UsageError
from drivers.interfaces import FINGERS, KIT_TAXELS, PERIOD_S
from grasp.files import write_whole
from scenarios.benchmark import lifts, streams
from scenarios.benchmark.lifts import LiftRow, LiftTask, run_lift
from scenarios.benchmark.protocol import Protocol, SplitName
from scenarios.benchmark.score_file import Cost, DetectorScores, Point
from scenarios.benchmark.streams import Tap
from scenarios.lift.config import LiftConfig
from scenarios.rigs.workers import Workers, results

CHECKED = 8  # lifts of a packaged detector that are repeated on the counts alone; else all
# shares of the samples without slip above a threshold: where the curve is measured
EXCEEDED = (0.1, 0.02, 0.004, 0.0005)
ORACLE_S = (0.0, 0.02, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.3)
TIMED_UPDATES, FIRST_UPDATES = 2000, 50  # a slow detector is known after the first
TitledProgress = Callable[[str, int, int], None]


class Trials(msgspec.Struct, frozen=True):
    """Every lift and tap of a detector with one rule, or of the oracle with one delay. They are the
    same ones in the same order for every detector."""

    level: float  # threshold or limit of the rule, or delay in seconds
    lifts: list[LiftRow]
    taps: list[Tap]


class Benchmark(msgspec.Struct, frozen=True):
    """Where and how to run."""

    protocol: Protocol
    split: SplitName
    recordings: dict[str, list[Path]]  # of the split, by set
    real: dict[str, list[Recording]]  # labelled, by name
    workers: Workers
    progress: TitledProgress

    def detector(self, config: LiftConfig) -> DetectorScores:
        """Measure one detector."""
        name, rule = config.detector_label, config.rule
        threshold = config.make_detector(1).threshold
        sets = streams.stream_files(
            config, self.recordings, self.workers, self._shown(f"{name}, recordings")
        )
        checked = CHECKED if name in DETECTORS else self.protocol.lifts.number
        rules = [rule, *curve_rules(sets, rule)]
        rows = self._lifts(name, [
            task for i, each in enumerate(rules)
            for task in lifts.tasks(
                msgspec.structs.replace(config, rule=each), self.split, 0 if i else checked
            )
        ])  # fmt: skip
        own, *others = (
            Trials(level(each), lifted, streams.score_taps(sets["mallet"], each))
            for each, lifted in zip(rules, rows, strict=True)
        )
        figures = streams.score_streams(sets, rule, threshold)
        return DetectorScores(
            detector=name, detector_hash=config.detector_hash(), rule=rule,
            figures=figures | lift_figures(own.lifts) | tap_figures(own.taps),
            point=point(own), curve=sorted(map(point, others), key=lambda p: p.threshold),
            causes=causes_of(own.lifts), real=self._real(config),
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
        none = np.empty((0, FINGERS))
        taps = [Streamed(read(file), none, none) for file in self.recordings["mallet"]]
        return [
            point(Trials(delay_s, lifted, streams.oracle_taps(taps, 1e3 * delay_s)))
            for delay_s, lifted in zip(ORACLE_S, self._lifts("oracle", tasks), strict=True)
        ]

    def _lifts(self, name: str, tasks: Sequence[LiftTask]) -> list[list[LiftRow]]:
        """Results of the lifts, in groups of all lifts of the split."""
        shown = self._shown(f"{name}, lifts")
        rows = streams.in_order(run_lift, tasks, name, self.workers, shown)
        n = self.protocol.lifts.number
        return [rows[i : i + n] for i in range(0, len(rows), n)]

    def _real(self, config: LiftConfig) -> dict[str, Figure]:
        found = {}
        for name, recordings in self.real.items():
            parts = []
            for recording in recordings:
                made = config.make_detector(recording.fingers, recording.taxels)
                p = stream(made, recording.counts)[0]
                parts.append(scored_samples(Streamed(recording, p, np.empty(0)), config.rule))
            found[name] = samples_of(parts).auc()
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


def point(trials: Trials) -> Point:
    """Shares done right, and delays."""
    rows, taps = trials.lifts, trials.taps
    lifted = figure(_share, [[row.right] for row in rows])
    tapped = figure(taps_right, by_hand(taps))
    delays = sorted(
        d for d in (*(r.delay_ms for r in rows), *(t.delay_ms for t in taps)) if d is not None
    )
    both = None
    if lifted.value is not None and tapped.value is not None:
        both = (lifted.value + tapped.value) / 2.0
    return Point(
        trials.level, _mean_of(both, lifted, tapped), lifted, tapped,
        _finite(delays, 0.5), _finite(delays, 0.9),
    )  # fmt: skip


def by_hand(taps: Sequence[Tap]) -> list[list[Tap]]:
    """The taps of each recording, which share an object and a hand."""
    of_hand: dict[int, list[Tap]] = {}
    for tap in taps:
        of_hand.setdefault(tap.recording, []).append(tap)
    return list(of_hand.values())


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


def causes_of(rows: Sequence[LiftRow]) -> dict[str, dict[str, int]]:
    """Number of lifts by result: of all, of those with a weak grip, of fragile objects."""
    kinds = {"all": rows, "weak": [row for row in rows if row.weak],
             "fragile": [row for row in rows if row.fragile]}  # fmt: skip
    return {
        name: dict(sorted(Counter(row.cause for row in chosen).items()))
        for name, chosen in kinds.items()
    }


def lift_figures(rows: Sequence[LiftRow]) -> dict[str, Figure]:
    """Figures of the lifts with a weak grip."""
    weak = [row for row in rows if row.weak]
    slips = sorted(row.slip_mm for row in weak if row.slip_mm is not None)
    over = sorted(row.over_least for row in weak if row.over_least is not None)
    return {
        "right_smooth": figure(_share, [[row.right] for row in weak if row.smooth]),
        "right_rough": figure(_share, [[row.right] for row in weak if not row.smooth]),
        "slip_p50_mm": Figure(_finite(slips, 0.5)), "slip_p90_mm": Figure(_finite(slips, 0.9)),
        "over_least_p50": Figure(_finite(over, 0.5)), "over_least_p90": Figure(_finite(over, 0.9)),
    }  # fmt: skip


def tap_figures(taps: Sequence[Tap]) -> dict[str, Figure]:
    """Figures of the taps that moved the object, and of those that did not."""
    moved = [tap for tap in taps if tap.moved]
    unmoved = [tap for tap in taps if not tap.moved]

    def right(chosen: Sequence[Tap]) -> Figure:
        return figure(_share, [[t.right for t in hand] for hand in by_hand(chosen)])

    return {
        "moved": Figure(len(moved)), "unmoved": Figure(len(unmoved)),
        "detected": right(moved),
        "detected_smooth": right([t for t in moved if t.smooth]),
        "detected_rough": right([t for t in moved if not t.smooth]),
        "unanswered": right(unmoved),
    }  # fmt: skip


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
