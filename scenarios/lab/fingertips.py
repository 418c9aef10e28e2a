"""Fingertips without a run: counts, rest codes, noise, and lost frames."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, Refused, Stale
from drivers.interfaces import FINGER_NAMES, PERIOD_NS, Vector3
from drivers.takktile.driver import TakkTileDriver
from grasp.run import signals
from grasp.run.clock import Clock, WallClock
from scenarios.rigs.config import AnyRigConfig
from scenarios.rigs.permission import board_address
from scenarios.rigs.wired import open_board

REST_S = 5.0  # timeout for the rest codes
A_SECOND = 100  # samples

Raw = NDArray[np.int16]
Table = tuple[tuple[float, ...], ...]  # (3, taxels)


class TactileReader:
    """Fingertips that the caller polls. ``rest``: codes of the open hand; None: unknown, so no
    force is estimated."""

    def __init__(self, tips: TakkTileDriver, rest: Raw | None, stale_ns: int) -> None:
        self.tips = tips
        self.rest = rest
        self._stale_ns = stale_ns
        self._frames, self._fresh_ns = 0, 0

    def poll(self, now_ns: int) -> None:
        """Poll once; raises the board's errors, and Stale without a frame for too long."""
        self.tips.poll(now_ns)
        frames = self.tips.statistics.frames
        if frames != self._frames or not self._fresh_ns:
            self._frames, self._fresh_ns = frames, now_ns
        if now_ns - self._fresh_ns > self._stale_ns:
            silent_ms = (now_ns - self._fresh_ns) * 1e-6
            raise Stale(
                f"the tactile board has sent no frame for {silent_ms:.0f} ms", "check its cable"
            )

    def ticks(self, clock: Clock, count: int) -> Iterator[None]:
        """Poll ``count`` samples at 100 Hz; Ctrl-C raises."""
        tick_ns = clock.now_ns
        for _ in range(count):
            signals.check()
            tick_ns += PERIOD_NS
            clock.sleep_until_ns(tick_ns)
            self.poll(clock.now_ns)
            yield

    @property
    def counts(self) -> Raw | None:
        """(3, taxels) raw minus rest, negative under pressure; None if either is unknown."""
        raw = self.tips.latest_raw
        return None if raw is None or self.rest is None else raw - self.rest

    @property
    def counts_sum(self) -> Vector3 | None:
        """Sum of the counts over the taxels of each finger."""
        counts = self.counts
        if counts is None:
            return None
        a, b, c = counts.sum(axis=1, dtype=np.int64).tolist()
        return float(a), float(b), float(c)


@contextmanager
def open_fingertips(config: AnyRigConfig, clock: Clock, unloaded: bool) -> Iterator[TactileReader]:
    """The fingertips of the settings. The rest codes of an unloaded hand are measured now; those of
    a closed hand are `tactile.rest_reference`, if set. Raises the board's errors, and Refused for
    implausible rest codes."""
    if config.devices.fingertips:
        raise Refused("fingertips of another package cannot be read", "unset devices.fingertips")
    board_address(config)
    with open_board(config, lambda: clock.now_ns) as tips:
        rest = config.tactile.rest_reference
        reader = TactileReader(tips, None, config.tactile.stale_after_missed * PERIOD_NS)
        if unloaded:
            tips.begin_rest()
            _until(tips, clock, lambda: tips.rest_taken)
            assert tips.frame is not None  # noqa: S101  (there are rest codes)
            reader.rest = tips.frame.rest
        elif rest is not None:
            _until(tips, clock, lambda: tips.latest_raw is not None)
            reader.rest = np.array(rest, np.int16)
        yield reader


def _until(tips: TakkTileDriver, clock: Clock, done: Callable[[], bool]) -> None:
    end_ns = clock.now_ns + round(REST_S * 1e9)
    while not done():
        if clock.now_ns > end_ns:
            raise DeviceFault("the tactile board sends too few frames", "unplug it, plug it in")
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        tips.poll(clock.now_ns)


class FingertipStatistics(msgspec.Struct, frozen=True):
    """Statistics of consecutive samples, (3, taxels) each: rest codes, mean counts from rest,
    standard deviation of the codes. ``lost``: ticks without a frame."""

    samples: int
    lost: int
    rest: Table
    counts: Table
    noise_counts: Table

    @property
    def codes(self) -> list[list[int]]:
        """(3, taxels) mean codes, rounded."""
        whole: list[list[int]] = np.rint(np.add(self.rest, self.counts)).astype(int).tolist()
        return whole

    @property
    def most_noise_counts(self) -> float:
        return max(map(max, self.noise_counts))

    def summary(self) -> str:
        """One line: counts of each finger, noise of the noisiest taxel, lost frames."""
        fingers = zip(FINGER_NAMES, self.counts, strict=True)
        sums = (f"{name} {sum(counts):+.0f}" for name, counts in fingers)
        return (
            f"counts {', '.join(sums)}; noise at most {self.most_noise_counts:.2f} counts; "
            f"{self.lost} of {self.samples + self.lost} frames lost"
        )

    def table(self) -> str:
        """One row per taxel: rest, counts and noise."""
        rows = [f"{'finger':>6} {'taxel':>5} {'rest':>5} {'counts':>7} {'noise':>6}"]
        fingers = zip(FINGER_NAMES, self.rest, self.counts, self.noise_counts, strict=True)
        for name, *columns in fingers:
            for taxel, (rest, counts, noise) in enumerate(zip(*columns, strict=True)):
                rows.append(f"{name:>6} {taxel:>5} {rest:5.0f} {counts:+7.1f} {noise:6.2f}")
        return "\n".join(rows)


def watch(config: AnyRigConfig, seconds: float) -> Iterator[FingertipStatistics]:
    """Statistics of each second, then of all samples. The hand must be unloaded at first, when the
    rest codes are measured. Raises the board's errors, and Refused for implausible rest codes."""
    clock = WallClock(WallClock().now_ns)
    with open_fingertips(config, clock, unloaded=True) as reader:
        every: list[Raw] = []
        seconds = max(1, round(seconds))
        for _ in range(seconds):
            frames = reader.tips.statistics.frames
            raw: list[Raw] = []
            for _ in reader.ticks(clock, A_SECOND):
                now = reader.tips.statistics.frames
                if now > frames and reader.tips.latest_raw is not None:
                    raw.append(reader.tips.latest_raw)
                frames = now
            if not raw:
                raise Stale("the tactile board has sent no frame for a second", "check its cable")
            every += raw
            yield _statistics(reader, raw, A_SECOND)
        yield _statistics(reader, every, seconds * A_SECOND)


def _statistics(reader: TactileReader, raw: list[Raw], ticks: int) -> FingertipStatistics:
    codes, rest = np.stack(raw), reader.rest
    assert rest is not None  # noqa: S101  (measured at opening)
    tables = (rest, codes.mean(axis=0) - rest, codes.std(axis=0))
    values = [tuple(tuple(map(float, row)) for row in table.tolist()) for table in tables]
    return FingertipStatistics(len(raw), ticks - len(raw), *values)


def rest_file(config: AnyRigConfig, seconds: float) -> tuple[FingertipStatistics, str]:
    """Rest codes of an unloaded hand, and the lines of a file for `--config` that state them."""
    replace = msgspec.structs.replace
    tactile = replace(config.tactile, rest_reference=None)  # it is measured again
    *_, found = watch(replace(config, tactile=tactile), seconds)
    rows = ",\n".join(f"    {row}" for row in found.codes)
    day = f"{datetime.now():%Y-%m-%d %H:%M}"  # noqa: DTZ005  (the operator's local time)
    return found, (
        f"# rest codes of an unloaded hand, {day}: mean of {found.samples} samples, noise at most "
        f"{found.most_noise_counts:.2f} counts\n[tactile]\nrest_reference = [\n{rows},\n]\n"
    )
