"""The reader: a read always pending, young frames, and the way back after every fault."""

import contextlib
import time
from collections.abc import Callable

import pytest

from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import TactileSensor
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.link import ReadingThread
from drivers.takktile.settings import TakkTileSettings
from tests.wire.drivers.takktile.conftest import PATIENCE_S, Bench, eventually

# An age bound that a busy machine does not break; that old samples are missed has its own test.
SETTINGS = TakkTileSettings(max_age_ms=1000.0)


def reader_on(bench: Bench, settings: TakkTileSettings = SETTINGS) -> TakkTileDriver:
    return TakkTileDriver(ReadingThread(bench.connect, settings), settings)


@pytest.fixture
def reader(bench: Bench):
    with reader_on(bench) as made:
        yield made


def poll_until(sensor: TactileSensor, condition: Callable[[], bool], what: str) -> None:
    """Poll every 10 ms; link trouble on the way is what the caller waits to see the end of."""
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
    """The error that polling meets in the end."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        time.sleep(0.01)
        try:
            reader.poll(time.monotonic_ns())
        except (LinkLost, DeviceFault) as error:
            return error
    raise AssertionError("nothing failed")


def test_frames_are_raw_minus_rest(bench, reader):
    take_rest(reader)
    assert not reader.frame.counts.any()
    bench.codes = bench.codes - 30
    poll_until(reader, lambda: reader.frame.counts.max() == -30, "press")
    assert reader.frame.raw.tolist() == bench.codes.reshape(3, 6).tolist()


def test_frames_that_nobody_fetches_are_overruns(reader):
    eventually(lambda: reader.statistics.overruns > 0, "ring full")
    reader.poll(time.monotonic_ns())
    assert reader.latest_raw is not None
    assert reader.statistics.decimated == 63


def test_ticks_without_a_frame_repeat_the_last_until_stale(bench, reader):
    take_rest(reader)
    last = reader.frame
    bench.spoil("time_out", 2)
    poll_until(reader, lambda: reader.frame.stale, "stale")
    assert reader.frame.missed >= 5
    assert (reader.frame.counts == last.counts).all()
    poll_until(reader, lambda: not reader.frame.stale, "fresh again")
    assert reader.rest_taken
    assert reader.statistics.timeouts == 2
    assert reader.statistics.empty_ticks >= 5
    assert reader.statistics.restarts == 0


def test_unplugged_while_a_read_is_pending_and_plugged_in_again(bench, reader):
    take_rest(reader)
    bench.spoil("unplug")
    assert isinstance(failure(reader), LinkLost)
    poll_until(reader, lambda: reader.frame.stale, "stale")
    bench.spoil("replug")
    poll_until(reader, lambda: reader.statistics.reopens == 1, "found again")
    poll_until(reader, lambda: not reader.rest_taken, "rest forgotten")
    assert reader.frame is None
    take_rest(reader)
    assert not reader.frame.counts.any()


def test_a_column_that_dies_is_named_in_the_end_and_never_shifts_taxels(bench, reader):
    take_rest(reader)
    before = reader.frame.counts
    bench.spoil("kill_column", 2)
    eventually(lambda: "row 0 column 2" in failure(reader).message, "dead column named")
    assert (reader.frame.counts == before).all()
    assert reader.frame.stale


def test_stopping_stops_the_board_so_that_the_next_start_is_clean(bench):
    for _ in range(3):
        with reader_on(bench) as reader:
            poll_until(reader, lambda: reader.latest_raw is not None, "a frame")
        assert bench.board.ready_ns is None
        assert reader.statistics.wrong_lengths == 0


def test_a_board_that_a_crashed_program_left_running_is_taken_over(bench):
    link = bench.connect()
    link.control(0xC7, 100, 0xFF, 1, 0)
    link.close()
    with reader_on(bench) as reader:
        take_rest(reader)
        assert reader.statistics.wrong_lengths == 0


def test_starting_without_a_board_fails_at_once_and_leaves_nothing(bench):
    bench.spoil("unplug")
    reader = reader_on(bench)
    with pytest.raises(LinkLost, match="no TakkTile board"):
        reader.start()
    reader.stop()


def test_a_server_that_ends_is_a_lost_link_and_stopping_still_works():
    bench = Bench()
    with bench.server:
        reader = reader_on(bench).start()
        take_rest(reader)
    assert isinstance(failure(reader), LinkLost)
    reader.stop()
    reader.stop()
