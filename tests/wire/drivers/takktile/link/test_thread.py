"""Reading thread: a read always pending, recent frames, and recovery after every fault."""

import contextlib
import time
from collections.abc import Callable

import pytest

from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import TactileSensor
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.link import ReadingThread
from drivers.takktile.settings import TakkTileSettings
from tests.wire.drivers.takktile.conftest import Bench
from tests.wire.waiting import PATIENCE_S, until

# An age limit that holds on a busy machine; missed old samples have their own test.
SETTINGS = TakkTileSettings(max_age_ms=1000.0)


def reader_on(bench: Bench, settings: TakkTileSettings = SETTINGS) -> TakkTileDriver:
    return TakkTileDriver(ReadingThread(bench.connect, settings), settings)


@pytest.fixture
def reader(bench: Bench):
    with reader_on(bench) as made:
        yield made


def poll_until(sensor: TactileSensor, condition: Callable[[], bool], what: str) -> None:
    """Poll every 10 ms until a condition holds; link errors are ignored."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.01)
        with contextlib.suppress(LinkLost, DeviceFault):
            sensor.poll(time.monotonic_ns())


def take_rest(sensor: TactileSensor) -> None:
    sensor.begin_rest()
    poll_until(sensor, lambda: sensor.rest_taken, "rest")


def failure(reader: TakkTileDriver) -> LinkLost | DeviceFault:
    """First error that polling raises."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        time.sleep(0.01)
        try:
            reader.poll(time.monotonic_ns())
        except (LinkLost, DeviceFault) as error:
            return error
    raise AssertionError("nothing failed")


def test_frames_that_are_not_polled_are_overruns(reader):
    until(lambda: reader.statistics.overruns > 0, "ring full")
    reader.poll(time.monotonic_ns())
    assert reader.latest_raw is not None
    assert reader.statistics.decimated == 63


def test_a_board_unplugged_during_a_read_reconnects_after_replugging(bench, reader):
    take_rest(reader)
    bench.inject("unplug")
    assert isinstance(failure(reader), LinkLost)
    poll_until(reader, lambda: reader.frame.stale, "stale")
    bench.inject("replug")
    poll_until(reader, lambda: reader.statistics.reopens == 1, "found again")
    poll_until(reader, lambda: not reader.rest_taken, "rest forgotten")
    assert reader.frame is None
    take_rest(reader)
    assert not reader.frame.counts.any()


def test_stopping_the_driver_stops_the_board(bench):
    for _ in range(3):
        with reader_on(bench) as reader:
            poll_until(reader, lambda: reader.latest_raw is not None, "a frame")
        assert bench.board.ready_ns is None
        assert reader.statistics.wrong_lengths == 0


def test_a_board_left_running_by_a_crashed_program_is_restarted(bench):
    link = bench.connect()
    link.control(0xC7, 100, 0xFF, 1, 0)
    link.close()
    with reader_on(bench) as reader:
        take_rest(reader)
        assert reader.statistics.wrong_lengths == 0


def test_starting_without_a_board_fails_at_once(bench):
    bench.inject("unplug")
    reader = reader_on(bench)
    with pytest.raises(LinkLost, match="no TakkTile board"):
        reader.start()
    reader.stop()


def test_a_server_that_ends_is_a_lost_link_and_the_driver_can_be_stopped():
    bench = Bench()
    with bench.server:
        reader = reader_on(bench).start()
        take_rest(reader)
    assert isinstance(failure(reader), LinkLost)
    reader.stop()
    reader.stop()
