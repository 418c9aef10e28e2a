"""Fingertips listened to: counts, rest, noise, and what was lost on the way."""

from collections.abc import Iterator
from datetime import datetime

import msgspec
import numpy as np

from drivers.errors import Stale
from drivers.interfaces import FINGER_NAMES, PERIOD_NS
from drivers.takktile.driver import TakkTileStatistics
from grasp import interruption
from grasp.clock import Clock, WallClock
from scenarios.lab.touch import Raw, Touch, open_touch
from scenarios.rigs.config import AnyRigConfig

A_SECOND = 100  # samples
LOST = ("empty_ticks", "implausible", "too_old")  # each a tick without a frame

Table = tuple[tuple[float, ...], ...]  # (3, taxels)


class Heard(msgspec.Struct, frozen=True):
    """A stretch of samples, (3, taxels) each: rest codes, mean counts below or above them, and the
    standard deviation of the codes. ``lost``: ticks without a frame, by cause."""

    ticks: int
    rest: Table
    counts: Table
    noise_counts: Table
    lost: dict[str, int]

    @property
    def dropped(self) -> int:
        return sum(self.lost.values())

    @property
    def samples(self) -> int:
        """That the means are of."""
        return self.ticks - self.dropped

    @property
    def codes(self) -> tuple[tuple[int, ...], ...]:
        """(3, taxels) mean codes, whole."""
        return tuple(
            tuple(round(rest + counts) for rest, counts in zip(*finger, strict=True))
            for finger in zip(self.rest, self.counts, strict=True)
        )

    def in_words(self) -> str:
        """One line: what each finger bears, the loudest taxel, frames lost."""
        sums = (
            f"{name} {sum(counts):+.0f}"
            for name, counts in zip(FINGER_NAMES, self.counts, strict=True)
        )
        loudest = max(max(finger) for finger in self.noise_counts)
        return (
            f"counts {', '.join(sums)}; noise at most {loudest:.2f} counts; "
            f"{self.dropped} of {self.ticks} frames lost"
        )

    def table(self) -> str:
        """Every taxel: rest, counts and noise."""
        rows = [f"{'finger':>6} {'taxel':>5} {'rest':>5} {'counts':>7} {'noise':>6}"]
        for name, *columns in zip(
            FINGER_NAMES, self.rest, self.counts, self.noise_counts, strict=True
        ):
            for taxel, (rest, counts, noise) in enumerate(zip(*columns, strict=True)):
                rows.append(f"{name:>6} {taxel:>5} {rest:5.0f} {counts:+7.1f} {noise:6.2f}")
        return "\n".join(rows)


def listen(config: AnyRigConfig, seconds: float) -> Iterator[Heard]:
    """What was heard of each second, then of all of them; the hand must be unloaded to begin with,
    for its rest is taken. Raises the board's errors, and Refused for a rest that cannot be."""
    clock = WallClock(WallClock().now_ns)
    with open_touch(config, clock, unloaded=True) as touch:
        every: list[Raw] = []
        before = first = touch.tips.statistics
        for _ in range(max(1, round(seconds))):
            raw = _samples(touch, clock)
            yield _heard(touch, raw, before)
            before = touch.tips.statistics
            every += raw
        yield _heard(touch, every, first)


def _samples(touch: Touch, clock: Clock) -> list[Raw]:
    """A second of them; what is lost is left out."""
    raw: list[Raw] = []
    tick_ns, frames = clock.now_ns, touch.tips.statistics.frames
    for _ in range(A_SECOND):
        interruption.check()
        tick_ns += PERIOD_NS
        clock.sleep_until_ns(tick_ns)
        touch.pump(clock.now_ns)
        now = touch.tips.statistics.frames
        if now > frames and touch.tips.latest_raw is not None:
            raw.append(touch.tips.latest_raw)
        frames = now
    if not raw:
        raise Stale("the tactile board has sent no frame for a second", "check its cable")
    return raw


def _heard(touch: Touch, raw: list[Raw], before: TakkTileStatistics) -> Heard:
    codes, rest = np.stack(raw), touch.rest
    assert rest is not None  # noqa: S101  (taken when it was opened)
    now = touch.tips.statistics
    lost = {name: getattr(now, name) - getattr(before, name) for name in LOST}
    return Heard(
        len(raw) + sum(lost.values()), _table(rest), _table(codes.mean(axis=0) - rest),
        _table(codes.std(axis=0)), lost,
    )  # fmt: skip


def _table(values: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> Table:
    return tuple(tuple(map(float, row)) for row in values.tolist())


def rest_file(config: AnyRigConfig, seconds: float) -> tuple[Heard, str]:
    """The rest of an unloaded hand, and what a file for `--config` would say of it."""
    replace = msgspec.structs.replace
    tactile = replace(config.tactile, rest_reference=None)  # it is this that is renewed
    *_, heard = listen(replace(config, tactile=tactile), seconds)
    rows = ",\n".join(f"    {list(row)}" for row in heard.codes)
    loudest = max(max(finger) for finger in heard.noise_counts)
    day = f"{datetime.now():%Y-%m-%d %H:%M}"  # noqa: DTZ005  (a person's local time)
    return heard, (
        f"# rest codes of an unloaded hand, {day}: mean of {heard.samples} samples, the loudest "
        f"taxel {loudest:.2f} counts\n[tactile]\nrest_reference = [\n{rows},\n]\n"
    )
