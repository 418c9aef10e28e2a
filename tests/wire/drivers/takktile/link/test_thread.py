"""The reader: a read always pending, young frames, and the way back after every fault."""

import contextlib
import time
from collections.abc import Callable

import pytest

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.interfaces import TactileSensor
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.link.thread import ReadingThread
from drivers.takktile.model.board import Hung
from drivers.takktile.settings import TakkTileSettings
from tests.wire.drivers.takktile.conftest import MS, PATIENCE_S, Bench, eventually

# An age bound that a busy machine does not break; that old samples are missed has its own test.
SETTINGS = TakkTileSettings(max_age_ms=1000.0)


def reader_on(bench: Bench, settings: TakkTileSettings = SETTINGS) -> TakkTileDriver:
    return TakkTileDriver(ReadingThread(bench.connect, settings), settings)


@pytest.fixture
def reader(bench: Bench):
    with reader_on(bench) as made:
        yield made


def pump_until(sensor: TactileSensor, condition: Callable[[], bool], what: str) -> None:
    """Pump every 10 ms; link trouble on the way is what the caller waits to see the end of."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.01)
        with contextlib.suppress(LinkLost, DeviceFault):
            sensor.pump(time.monotonic_ns())


def take_rest(sensor: TactileSensor) -> None:
    sensor.begin_rest()
    pump_until(sensor, lambda: sensor.rest_taken, "rest")


def failure(reader: TakkTileDriver) -> LinkLost | DeviceFault:
    """The error that pumping meets in the end."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        time.sleep(0.01)
        try:
            reader.pump(time.monotonic_ns())
        except (LinkLost, DeviceFault) as error:
            return error
    raise AssertionError("nothing failed")


def test_frames_are_raw_minus_rest(bench, reader):
    take_rest(reader)
    assert not reader.frame.counts.any()
    bench.codes = bench.codes - 30
    pump_until(reader, lambda: reader.frame.counts.max() == -30, "press")
    assert reader.frame.raw.tolist() == bench.codes.reshape(3, 6).tolist()


def test_surplus_frames_are_counted_apart_from_lost_ones(bench, reader):
    take_rest(reader)
    pump_until(reader, lambda: reader.statistics.decimated >= 20, "two frames in a tick")
    counted = reader.statistics
    assert counted.frames >= 50
    assert counted.wrong_lengths == counted.implausible == counted.reopens == 0


def test_frames_that_nobody_fetches_are_overruns(reader):
    eventually(lambda: reader.statistics.overruns > 0, "ring full")
    reader.pump(time.monotonic_ns())
    assert reader.latest_raw is not None
    assert reader.statistics.decimated == 63


def test_ticks_without_a_frame_repeat_the_last_until_stale(bench, reader):
    take_rest(reader)
    last = reader.frame
    bench.spoil("time_out", 2)
    pump_until(reader, lambda: reader.frame.stale, "stale")
    assert reader.frame.missed >= 5
    assert (reader.frame.counts == last.counts).all()
    pump_until(reader, lambda: not reader.frame.stale, "fresh again")
    assert reader.rest_taken
    assert reader.statistics.timeouts == 2
    assert reader.statistics.empty_ticks >= 5
    assert reader.statistics.restarts == 0


def test_a_sample_that_waited_too_long_is_missed(bench):
    with reader_on(bench, TakkTileSettings()) as reader:
        eventually(lambda: reader.statistics.overruns > 0, "frames")
        reader.pump(time.monotonic_ns() + 200 * MS)
        assert reader.statistics.too_old == 1
        assert reader.latest_raw is None


def test_three_timeouts_restart_the_board_and_keep_the_rest(bench, reader):
    take_rest(reader)
    bench.spoil("time_out", 3)
    pump_until(reader, lambda: reader.statistics.restarts == 1, "restart")
    pump_until(reader, lambda: reader.frame.missed == 0, "fresh again")
    assert reader.rest_taken
    assert reader.statistics.reopens == 0


def test_nine_timeouts_open_the_board_again_and_drop_the_rest(bench, reader):
    take_rest(reader)
    bench.spoil("time_out", 9)
    pump_until(reader, lambda: reader.statistics.reopens >= 1, "opened again")
    assert reader.statistics.restarts == 2
    pump_until(reader, lambda: not reader.rest_taken, "rest forgotten")
    assert reader.frame is None


def test_a_stall_is_cleared_and_keeps_the_rest(bench, reader):
    take_rest(reader)
    bench.spoil("stall")
    pump_until(reader, lambda: reader.statistics.restarts == 1, "cleared")
    pump_until(reader, lambda: reader.frame.missed == 0, "fresh again")
    assert reader.rest_taken


@pytest.mark.parametrize(("fault", "args"), [("split_frame", ()), ("shorten_frame", (4,))])
def test_a_frame_that_is_not_whole_is_dropped_and_the_next_one_read_in_step(
    bench, reader, fault, args
):
    take_rest(reader)
    bench.spoil(fault, *args)
    pump_until(reader, lambda: reader.statistics.wrong_lengths == 1, "dropped")
    used = reader.statistics.frames
    pump_until(reader, lambda: reader.statistics.frames > used + 5, "more frames")
    assert not reader.frame.counts.any()
    assert reader.statistics.wrong_lengths == 1


def test_a_frame_with_a_flipped_padding_bit_never_gets_through(bench, reader):
    take_rest(reader)
    bench.spoil("flip_bit", 1, 2)
    used = reader.statistics.frames
    pump_until(reader, lambda: reader.statistics.frames > used + 5, "more frames")
    assert not reader.frame.counts.any()


def test_unplugged_while_a_read_is_pending_and_plugged_in_again(bench, reader):
    take_rest(reader)
    bench.spoil("unplug")
    assert isinstance(failure(reader), LinkLost)
    pump_until(reader, lambda: reader.frame.stale, "stale")
    bench.spoil("replug")
    pump_until(reader, lambda: reader.statistics.reopens == 1, "found again")
    pump_until(reader, lambda: not reader.rest_taken, "rest forgotten")
    assert reader.frame is None
    take_rest(reader)
    assert not reader.frame.counts.any()


def test_the_error_names_the_board_that_is_missed(bench, reader):
    bench.spoil("unplug")
    eventually(lambda: "serial number" in failure(reader).message, "looked for by serial")


def test_a_board_that_comes_back_with_a_dead_column_is_refused(bench, reader):
    take_rest(reader)
    bench.spoil("unplug")
    failure(reader)
    bench.spoil("kill_column", 2)
    bench.spoil("replug")
    eventually(lambda: "other cells alive" in failure(reader).message, "map compared")
    assert "row 0 column 2, row 1 column 2" in failure(reader).message


def test_a_column_that_dies_is_named_in_the_end_and_never_shifts_taxels(bench, reader):
    take_rest(reader)
    before = reader.frame.counts
    bench.spoil("kill_column", 2)
    eventually(lambda: "row 0 column 2" in failure(reader).message, "dead column named")
    assert (reader.frame.counts == before).all()
    assert reader.frame.stale


def test_a_hung_board_is_a_device_fault_until_it_is_replugged(bench, reader):
    with bench.lock, pytest.raises(Hung):
        bench.board.control(0x5C, 0, 0, 64, time.monotonic_ns())
    eventually(lambda: "hangs" in failure(reader).message, "hung")
    bench.spoil("replug")
    pump_until(reader, lambda: reader.statistics.reopens == 1, "back")


def test_a_loaded_fingertip_is_refused_by_name(bench, reader):
    bench.codes[9] = 380
    with pytest.raises(Refused, match="finger B taxel 3 rests at code 380"):
        take_rest(reader)


def test_stopping_stops_the_board_so_that_the_next_start_is_clean(bench):
    for _ in range(3):
        with reader_on(bench) as reader:
            pump_until(reader, lambda: reader.latest_raw is not None, "a frame")
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


def test_a_map_that_names_a_dead_cell_is_refused_at_start(bench):
    bench.spoil("kill_column", 3)
    with pytest.raises(DeviceFault, match="finger A taxel 3"):
        reader_on(bench).start()
    bench.connect().close()  # given back


def test_a_server_that_ends_is_a_lost_link_and_stopping_still_works():
    bench = Bench()
    with bench.server:
        reader = reader_on(bench).start()
        take_rest(reader)
    assert isinstance(failure(reader), LinkLost)
    reader.stop()
    reader.stop()
