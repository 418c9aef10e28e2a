"""What the fingertips feel beside a hand that is moved by hand: counts below their rest."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, Refused, Stale
from drivers.interfaces import PERIOD_NS, Vector3
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.link.thread import ReadingThread
from grasp.clock import Clock
from scenarios.rigs.config import AnyRigConfig
from scenarios.rigs.permission import board_address
from scenarios.rigs.wired import board_finder

REST_S = 5.0  # within which the rest is taken

Raw = NDArray[np.int16]


class Touch:
    """Fingertips that are pumped by whoever waits. ``rest``: codes of the open hand; None: not
    known, and then nothing is said of force."""

    def __init__(self, tips: TakkTileDriver, rest: Raw | None, stale_ns: int) -> None:
        self.tips = tips
        self.rest = rest
        self._stale_ns = stale_ns
        self._frames, self._fresh_ns = 0, 0

    def pump(self, now_ns: int) -> None:
        """One tick; raises what the board raises, and Stale while nothing has come from it for
        long: what was felt then says nothing of now."""
        self.tips.pump(now_ns)
        frames = self.tips.statistics.frames
        if frames != self._frames or not self._fresh_ns:
            self._frames, self._fresh_ns = frames, now_ns
        if now_ns - self._fresh_ns > self._stale_ns:
            silent_ms = (now_ns - self._fresh_ns) * 1e-6
            raise Stale(
                f"the tactile board has sent no frame for {silent_ms:.0f} ms", "check its cable"
            )

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
    reading = ReadingThread(
        board_finder(config, lambda: clock.now_ns), config.tactile, lambda: clock.now_ns
    )
    with TakkTileDriver(reading, config.tactile) as tips:
        known = config.tactile.rest_reference
        rest = taken_rest(tips, clock) if unloaded else None
        if rest is None and known is not None:
            _until(tips, clock, lambda: tips.latest_raw is not None)
            rest = np.array(known, np.int16)
        yield Touch(tips, rest, config.tactile.stale_after_missed * PERIOD_NS)


def taken_rest(tips: TakkTileDriver, clock: Clock) -> Raw:
    """Rest codes (3, taxels), taken now; raises Refused where they cannot be right."""
    tips.begin_rest()
    _until(tips, clock, lambda: tips.rest_taken)
    assert tips.frame is not None  # noqa: S101  (the rest is taken)
    return tips.frame.rest


def _until(tips: TakkTileDriver, clock: Clock, heard: Callable[[], bool]) -> None:
    end_ns = clock.now_ns + round(REST_S * 1e9)
    while not heard():
        if clock.now_ns > end_ns:
            raise DeviceFault("the tactile board sends too few frames", "unplug it, plug it in")
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        tips.pump(clock.now_ns)
