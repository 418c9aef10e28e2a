"""`grasp benchmark`: the whole protocol for some detectors."""

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import groupby
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace

from detector.decision import RuleSettings, cusum, fused
from detector.loading import DETECTORS
from detector.recordings import Recording, read
from detector.scores.evaluation import WARM_UP_SAMPLES, Streamed, scored_samples, stream
from detector.scores.figures import Figure, samples_of
from detector.scores.quantiles import quantile
from drivers.errors import UsageError
from drivers.interfaces import FINGERS, KIT_TAXELS, PERIOD_S
from grasp.files import write_whole
from scenarios.benchmark import lifts, streams
from scenarios.benchmark.lifts import LiftRow, LiftTask, run_lift
from scenarios.benchmark.protocol import Protocol, SplitName
from scenarios.benchmark.quality import BUDGET_PER_MIN, NO_TRIALS, Trials, drawn, interval, scores
from scenarios.benchmark.score_file import DetectorScores, Point, References
from scenarios.benchmark.streams import QUARTER, TAPS, Tap
from scenarios.lift.config import LiftConfig
from scenarios.rigs.workers import Workers, results

# lifts of a packaged detector with each rule that are repeated on the counts alone; else all
CHECKED = 8
# shares of the samples without slip above a threshold: of those within the budget the lowest,
# which answer soonest, are tried
EXCEEDED, TRIED = (0.02, 0.01, 0.005, 0.0025, 0.0012, 0.0005), 4
ORACLE_S = (0.0, 0.05, 0.1, 0.2)
NEVER_S = 1000.0  # delay of the oracle that never registers: longer than any lift
TIMED_UPDATES, FIRST_UPDATES = 2000, 50  # a slow detector is known after the first
TitledProgress = Callable[[str, int, int], None]
Alarms = list[tuple[int, float]]


class Benchmark(msgspec.Struct, frozen=True):
    """Where and how to run. ``quick``: the first quarter of lifts and taps."""

    protocol: Protocol
    split: SplitName
    recordings: dict[str, list[Path]]  # of the split, by set
    real: dict[str, list[Recording]]  # labelled, by name
    workers: Workers
    progress: TitledProgress
    quick: bool = False

    @property
    def tried(self) -> int:
        """Lifts with each threshold that is tried."""
        return self.protocol.lifts.number // QUARTER

    @property
    def lifts(self) -> int:
        return self.tried if self.quick else self.protocol.lifts.number

    def detector(
        self, config: LiftConfig, references: References, chosen: float | None = None
    ) -> DetectorScores:
        """Measure one detector. ``chosen``: its best threshold if that is not to be found here."""
        name, own = config.detector_label, config.rule
        sets = streams.stream_files(
            config, self.recordings, self.workers, self._shown(f"{name}, recordings")
        )
        rules = [own, *curve_rules(sets, own)]
        if chosen is not None:
            rules = [own, at_level(own, chosen)]
        alarms = {rule: alarms_of(sets, rule) for rule in rules}
        within = within_budget(alarms)[:TRIED] if chosen is None else rules[1:]
        tries = [rule for rule in within if rule != own]
        first = [t for rule in tries for t in self._tasks(config, rule)[: self.tried]]
        rows = self._lifts(name, [*self._tasks(config, own), *first])
        lifted = {own: rows[: self.lifts]}
        for i, rule in enumerate(tries):
            start = self.lifts + i * self.tried
            lifted[rule] = rows[start : start + self.tried]
        taps = {rule: streams.score_taps(sets[TAPS], rule) for rule in lifted}

        def made(rule: RuleSettings, rows: Sequence[LiftRow]) -> Point:
            return point(level(rule), rows, taps[rule], alarms[rule], *references.ends)

        curve = [made(rule, lifted[rule][: self.tried]) for rule in within]
        best = max(zip(within, curve, strict=True), key=lambda each: each[1].raw.value or 0.0)[0]
        others = self._tasks(config, best)[len(lifted[best]) :]
        whole = [*lifted[best], *self._lifts(name, others)]
        return DetectorScores(
            detector=name, detector_hash=config.detector_hash(), rule=own,
            figures=streams.score_streams(sets, own),
            point=made(own, lifted[own]), best=made(best, whole),
            curve=[replace(each, trials=NO_TRIALS) for each in curve],
            causes=dict(Counter(sorted(row.cause for row in lifted[own]))), real=self._real(config),
        )  # fmt: skip

    def references(self, config: LiftConfig, path: Path) -> References:
        """The ends of the score, from that file if it is there, else written to it. Raises
        OSError."""
        with suppress(OSError, msgspec.MsgspecError):  # a damaged file is measured again
            kept = msgspec.json.decode(path.read_bytes(), type=References)
            if len(kept.oracle) == len(ORACLE_S):
                return kept
        none = np.empty((0, FINGERS))
        taps = [Streamed(read(file), none, none) for file in self.recordings[TAPS]]
        base = replace(config, rule=lifts.ORACLE_RULE)
        numbers = {NEVER_S: self.lifts, **dict.fromkeys(ORACLE_S, self.tried), 0.0: self.lifts}
        rows = iter(self._lifts("oracle", [
            replace(task, oracle_s=delay_s)
            for delay_s, number in numbers.items() for task in self._tasks(base, base.rule)[:number]
        ]))  # fmt: skip
        tried = {
            delay_s: ([next(rows) for _ in range(number)], streams.oracle_taps(taps, 1e3 * delay_s))
            for delay_s, number in numbers.items()
        }
        ends = [trials_of(*tried[delay_s], []) for delay_s in (NEVER_S, 0.0)]
        silence, *oracle = (point(delay_s, *tried[delay_s], [], *ends) for delay_s in numbers)
        made = References(silence, oracle)
        write_whole(path, msgspec.json.encode(made), private=True)
        return made

    def _tasks(self, config: LiftConfig, rule: RuleSettings) -> list[LiftTask]:
        """The lifts of a detector with that rule."""
        checked = CHECKED if config.detector_label in DETECTORS else self.lifts
        config = replace(config, rule=rule)
        return lifts.tasks(config, self.split, checked)[: self.lifts]

    def _lifts(self, name: str, tasks: Sequence[LiftTask]) -> list[LiftRow]:
        shown = self._shown(f"{name}, lifts")
        return streams.in_order(run_lift, tasks, name, self.workers, shown)

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
) -> dict[str, float]:
    """``cost`` by detector. Raises UsageError, also for one that cannot read a recording."""
    one, found = Workers(min(1, workers.processes)), {}
    for config in configs:
        quiet = partial(streams.give_up, config.detector_label)
        (found[config.detector_label],) = results(partial(_first_use, config), [real], one, quiet)
    return found


def _first_use(config: LiftConfig, real: dict[str, list[Recording]]) -> float:
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


def at_level(rule: RuleSettings, value: float) -> RuleSettings:
    """The rule with that limit of a CUSUM, or threshold."""
    if rule.kind == "cusum":
        return replace(rule, limit=value)
    return replace(rule, threshold=value)


def curve_rules(sets: dict[str, list[Streamed]], rule: RuleSettings) -> list[RuleSettings]:
    """The rule with levels that EXCEEDED shares of the samples without slip are above."""
    still = []
    for s in (s for each in sets.values() for s in each):
        p = fused(s.probabilities, rule)
        values = (cusum(p, rule) if rule.kind == "cusum" else p).max(axis=1)
        still.append(values[WARM_UP_SAMPLES:][~s.labels[WARM_UP_SAMPLES:]])
    ordered = np.sort(np.concatenate(still))
    levels = sorted({quantile(ordered, 1.0 - share) for share in EXCEEDED})
    most = 200.0 if rule.kind == "cusum" else 1.0
    return [at_level(rule, x) for x in levels if 0.0 < x < most]


def alarms_of(sets: dict[str, list[Streamed]], rule: RuleSettings) -> Alarms:
    """``Trials.alarms`` of all recordings."""
    outcomes = [streams.slide_outcomes(s, rule) for each in sets.values() for s in each]
    return [(o.false, round(o.hand_s, 2)) for o in outcomes]


def within_budget(alarms: dict[RuleSettings, Alarms]) -> list[RuleSettings]:
    """Rules within BUDGET_PER_MIN, or the one with the fewest false alarms."""
    number = {rule: sum(false for false, _ in each) for rule, each in alarms.items()}
    seconds = sum(s for _, s in next(iter(alarms.values())))
    within = [rule for rule, false in number.items() if 60.0 * false <= BUDGET_PER_MIN * seconds]
    return within or [min(number, key=lambda rule: number[rule])]


def trials_of(rows: Sequence[LiftRow], taps: Sequence[Tap], alarms: Alarms) -> Trials:
    """The qualities."""
    hands = []
    for _, hand in groupby(taps, lambda tap: tap.recording):
        own = list(hand)
        moved, unmoved = ([t.quality for t in own if t.moved is m] for m in (True, False))
        hands.append((round(sum(moved), 4), len(moved), round(sum(unmoved), 4), len(unmoved)))
    return Trials([round(row.quality, 4) for row in rows], hands, alarms)


def point(
    level: float, rows: Sequence[LiftRow], taps: Sequence[Tap], alarms: Alarms,
    silence: Trials, oracle: Trials,
) -> Point:  # fmt: skip
    """Scores and delays of one row."""
    trials = trials_of(rows, taps, alarms)
    measures = drawn(trials)
    delays = sorted(
        d for d in (*(r.delay_ms for r in rows), *(t.delay_ms for t in taps)) if d is not None
    )
    return Point(
        threshold=level, score=interval(scores(trials, silence, oracle)),
        raw=interval(measures.raw), lifts=interval(measures.lifts),
        moved=interval(measures.moved), unmoved=interval(measures.unmoved),
        false_per_min=interval(measures.false_per_min), delay_p50_ms=_finite(delays, 0.5),
        delay_p90_ms=_finite(delays, 0.9), trials=trials,
    )  # fmt: skip


def _finite(ordered: Sequence[float], share: float) -> float | None:
    value = quantile(ordered, share) if ordered else math.inf
    return value if math.isfinite(value) else None


def cost(config: LiftConfig, clock_ns: Callable[[], int] = time.thread_time_ns) -> float:
    """Median time of an update of three fingers, µs. Raises UsageError for a detector that needs
    more than a sample period: it would answer late."""
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
    return median_us
