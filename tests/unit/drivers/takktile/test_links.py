"""One driver core on two links: a thread in wall time, a loop in virtual time."""

import threading
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from drivers.interfaces import TactileFrame
from drivers.takktile.board import READ_TIMEOUT_MS, Transfer
from drivers.takktile.driver import TakkTileDriver, TakkTileStatistics
from drivers.takktile.link.thread import ReadingThread
from drivers.takktile.model.board import BoardModel, BoardModelSettings
from drivers.takktile.model.link import ModelLink, ModelUsb
from drivers.takktile.settings import TakkTileSettings

MS = 1_000_000
PERIOD_NS = 10 * MS
PATIENCE_S = 20.0
SETTINGS = TakkTileSettings(max_age_ms=1000.0)

Script = dict[int, Callable[[BoardModel], None]]  # what befalls the board before a tick


def sample(t_ns: int):
    """Codes that say when they were converted, to 0.1 ms."""
    tenths = t_ns // 100_000
    pressure = (np.arange(440, 458) + (tenths > 6000) * (tenths % 97)).astype(np.int16)
    return lambda: (pressure, np.full(18, tenths % 1024, np.int16))


class HeldTime:
    """Time that a test holds; whoever waits for an instant is let go when it is reached."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._before_ns = self._now_ns = 0
        self._due: Callable[[], int] = lambda: -1  # what the other waits for; -1: it is at work
        self.reader_ns = 0  # the other's clock
        self.ends = False

    def wait_until(self, due: Callable[[], int]) -> None:
        with self._changed:
            self._due = due
            self._changed.notify_all()
            assert self._changed.wait_for(lambda: self._now_ns >= due() or self.ends, PATIENCE_S)
            self.reader_ns = max(due(), self._before_ns)  # what happens meanwhile happens now
            self._due = lambda: -1

    def reach(self, t_ns: int) -> None:
        """Go there, and stay until the other waits for a later instant."""
        with self._changed:
            self._before_ns, self._now_ns = self._now_ns, t_ns
            self._changed.notify_all()
            assert self._changed.wait_for(lambda: self._due() > t_ns, PATIENCE_S)

    def end(self) -> None:
        with self._changed:
            self.ends = True
            self._changed.notify_all()


class BlockingUsb(ModelUsb):
    """As a real board's: a read blocks until there is a frame, or until it times out."""

    def __init__(self, model: BoardModel, time: HeldTime) -> None:
        super().__init__(model)
        self._time = time

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        if threading.current_thread() is not threading.main_thread():
            self._time.wait_until(lambda: self._done_ns(now_ns))
            now_ns = self._time.reader_ns
        return None if self._time.ends else super().bulk_read(size, now_ns)

    def _done_ns(self, asked_ns: int) -> int:
        ready_ns = self._model.ready_ns
        return asked_ns + READ_TIMEOUT_MS * MS if ready_ns is None else max(ready_ns, asked_ns)


def in_a_loop(script: Script, ticks: int) -> tuple[list[TactileFrame], TakkTileStatistics]:
    board = BoardModel(BoardModelSettings(), sample)
    link = ModelLink(board, SETTINGS)
    with TakkTileDriver(link, SETTINGS) as driver:
        frames = list(play(script, ticks, board, driver, link.advance))
        return frames, driver.statistics


def in_a_thread(script: Script, ticks: int) -> tuple[list[TactileFrame], TakkTileStatistics]:
    board = BoardModel(BoardModelSettings(), sample)
    time = HeldTime()
    link = ReadingThread(lambda _: BlockingUsb(board, time), SETTINGS, lambda: time.reader_ns)
    with TakkTileDriver(link, SETTINGS) as driver:
        time.reach(0)
        frames = list(play(script, ticks, board, driver, time.reach))
        statistics = driver.statistics
        time.end()
        return frames, statistics


def play(script: Script, ticks: int, board: BoardModel, driver: TakkTileDriver, advance):
    driver.begin_rest()
    for tick in range(1, ticks + 1):
        script.get(tick, lambda board: None)(board)
        advance(tick * PERIOD_NS)
        driver.pump(tick * PERIOD_NS)
        if driver.frame is not None:
            yield driver.frame


def alike(frame: TactileFrame) -> bytes:
    fields = msgspec.structs.asdict(frame)
    return b"|".join(
        value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
        for value in fields.values()
    )


@pytest.mark.parametrize(
    "script",
    [
        {},
        {70: lambda board: board.time_out(1)},
        {70: lambda board: board.time_out(3), 110: lambda board: board.stall()},
        {
            65: lambda board: board.shorten_frame(4),
            75: lambda board: board.split_frame(),
            85: lambda board: board.flip_bit(1, 2),
        },
    ],
    ids=["no fault", "a time-out", "restarts", "broken frames"],
)
def test_core_in_a_thread_and_core_in_a_loop_give_the_same_frames_on_one_script(script):
    looped, counted = in_a_loop(script, 130)
    threaded, counted_too = in_a_thread(script, 130)
    assert len(looped) == len(threaded) > 60
    assert [alike(frame) for frame in looped] == [alike(frame) for frame in threaded]
    # frames that nobody would have seen are not made in virtual time
    assert counted_too.decimated > counted.decimated
    replace = msgspec.structs.replace
    assert replace(counted, decimated=0) == replace(counted_too, decimated=0)
