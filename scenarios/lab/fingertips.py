"""Fingertips read without a run: counts, rest, noise, and frames lost."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, Refused, Stale
from drivers.interfaces import FINGER_NAMES, PERIOD_NS, Vector3
from drivers.takktile.driver import TakkTileDriver
from grasp import signals
from grasp.clock import Clock, WallClock
from scenarios.rigs.config import AnyRigConfig
from scenarios.rigs.permission import board_address
from scenarios.rigs.wired import open_board

REST_S = 5.0  # within which the rest is taken
A_SECOND = 100  # samples

Raw = NDArray[np.int16]
Table = tuple[tuple[float, ...], ...]  # (3, taxels)


class Touch:
    """Fingertips that the waiting caller polls. ``rest``: codes of the open hand; None: unknown,
    so no force is reported."""

    def __init__(self, tips: TakkTileDriver, rest: Raw | None, stale_ns: int) -> None:
        self.tips = tips
        self.rest = rest
        self._stale_ns = stale_ns
        self._frames, self._fresh_ns = 0, 0

    def poll(self, now_ns: int) -> None:
        """One tick; raises what the board raises, and Stale where it has sent nothing for long."""
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
        """So many samples at 100 Hz, each polled; Ctrl-C raises."""
        tick_ns = clock.now_ns
        for _ in range(count):
            signals.check()
            tick_ns += PERIOD_NS
            clock.sleep_until_ns(tick_ns)
            self.poll(clock.now_ns)
            yield

    @property
    def counts(self) -> Raw | None:
        """(3, taxels) raw minus rest, pressing negative; None where either is not known."""
        raw = self.tips.latest_raw
        return None if raw is None or self.rest is None else raw - self.rest

    @property
    def counts_sum(self) -> Vector3 | None:
        """Over the taxels of each finger."""
        counts = self.counts
        if counts is None:
            return None
        a, b, c = counts.sum(axis=1, dtype=np.int64).tolist()
        return float(a), float(b), float(c)


@contextmanager
def open_touch(config: AnyRigConfig, clock: Clock, unloaded: bool) -> Iterator[Touch]:
    """The fingertips that the settings name. Their rest is taken now from an unloaded hand; of a
    closed one it is `tactile.rest_reference`, if there is one. Raises the board's errors, and
    Refused where the rest cannot be right."""
    if config.devices.fingertips:
        raise Refused("fingertips of another package are not read by this verb", "unset devices")
    board_address(config)
    with open_board(config, lambda: clock.now_ns) as tips:
        rest = config.tactile.rest_reference
        touch = Touch(tips, None, config.tactile.stale_after_missed * PERIOD_NS)
        if unloaded:
            tips.begin_rest()
            _until(tips, clock, lambda: tips.rest_taken)
            assert tips.frame is not None  # noqa: S101  (the rest is taken)
            touch.rest = tips.frame.rest
        elif rest is not None:
            _until(tips, clock, lambda: tips.latest_raw is not None)
            touch.rest = np.array(rest, np.int16)
        yield touch


def _until(tips: TakkTileDriver, clock: Clock, done: Callable[[], bool]) -> None:
    end_ns = clock.now_ns + round(REST_S * 1e9)
    while not done():
        if clock.now_ns > end_ns:
            raise DeviceFault("the tactile board sends too few frames", "unplug it, plug it in")
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        tips.poll(clock.now_ns)


class Listened(msgspec.Struct, frozen=True):
    """A stretch of samples, (3, taxels) each: rest codes, mean counts below or above them, and the
    standard deviation of the codes. ``lost``: ticks without a frame."""

    samples: int
    lost: int
    rest: Table
    counts: Table
    noise_counts: Table

    @property
    def codes(self) -> list[list[int]]:
        """(3, taxels) mean codes, whole."""
        whole: list[list[int]] = np.rint(np.add(self.rest, self.counts)).astype(int).tolist()
        return whole

    @property
    def most_noise_counts(self) -> float:
        return max(map(max, self.noise_counts))

    def in_words(self) -> str:
        """One line: the load on each finger, the noisiest taxel, frames lost."""
        fingers = zip(FINGER_NAMES, self.counts, strict=True)
        sums = (f"{name} {sum(counts):+.0f}" for name, counts in fingers)
        return (
            f"counts {', '.join(sums)}; noise at most {self.most_noise_counts:.2f} counts; "
            f"{self.lost} of {self.samples + self.lost} frames lost"
        )

    def table(self) -> str:
        """Every taxel: rest, counts and noise."""
        rows = [f"{'finger':>6} {'taxel':>5} {'rest':>5} {'counts':>7} {'noise':>6}"]
        fingers = zip(FINGER_NAMES, self.rest, self.counts, self.noise_counts, strict=True)
        for name, *columns in fingers:
            for taxel, (rest, counts, noise) in enumerate(zip(*columns, strict=True)):
                rows.append(f"{name:>6} {taxel:>5} {rest:5.0f} {counts:+7.1f} {noise:6.2f}")
        return "\n".join(rows)


def listen(config: AnyRigConfig, seconds: float) -> Iterator[Listened]:
    """Each second, then all of them; the hand must be unloaded to begin with, for its rest is
    taken. Raises the board's errors, and Refused for a rest that cannot be."""
    clock = WallClock(WallClock().now_ns)
    with open_touch(config, clock, unloaded=True) as touch:
        every: list[Raw] = []
        seconds = max(1, round(seconds))
        for _ in range(seconds):
            frames = touch.tips.statistics.frames
            raw: list[Raw] = []
            for _ in touch.ticks(clock, A_SECOND):
                now = touch.tips.statistics.frames
                if now > frames and touch.tips.latest_raw is not None:
                    raw.append(touch.tips.latest_raw)
                frames = now
            if not raw:
                raise Stale("the tactile board has sent no frame for a second", "check its cable")
            every += raw
            yield _listened(touch, raw, A_SECOND)
        yield _listened(touch, every, seconds * A_SECOND)


def _listened(touch: Touch, raw: list[Raw], ticks: int) -> Listened:
    codes, rest = np.stack(raw), touch.rest
    assert rest is not None  # noqa: S101  (taken when it was opened)
    tables = (rest, codes.mean(axis=0) - rest, codes.std(axis=0))
    values = [tuple(tuple(map(float, row)) for row in table.tolist()) for table in tables]
    return Listened(len(raw), ticks - len(raw), *values)


def rest_file(config: AnyRigConfig, seconds: float) -> tuple[Listened, str]:
    """The rest of an unloaded hand, and the lines of a file for `--config` that state it."""
    replace = msgspec.structs.replace
    tactile = replace(config.tactile, rest_reference=None)  # it is this that is renewed
    *_, found = listen(replace(config, tactile=tactile), seconds)
    rows = ",\n".join(f"    {row}" for row in found.codes)
    day = f"{datetime.now():%Y-%m-%d %H:%M}"  # noqa: DTZ005  (a person's local time)
    return found, (
        f"# rest codes of an unloaded hand, {day}: mean of {found.samples} samples, noise at most "
        f"{found.most_noise_counts:.2f} counts\n[tactile]\nrest_reference = [\n{rows},\n]\n"
    )
