"""TakkTile driver on a board model: sample age, missed frames, rest counts, recovery."""

import contextlib
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from drivers.errors import DeviceFault, GraspError, LinkLost, Refused
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.board import BoardModel
from drivers.takktile.model.link import ModelLink
from drivers.takktile.protocol import UsbRequest
from drivers.takktile.receiver import UsbBoard
from drivers.takktile.settings import BoardModelSettings, TakkTileSettings

MS = 1_000_000
PERIOD_NS = 10 * MS


class Bench:
    """A driver on a board whose codes the test sets; time advances one period per poll."""

    def __init__(
        self,
        settings: TakkTileSettings | None = None,
        board: BoardModelSettings | None = None,
        wrap: Callable[[UsbBoard], UsbBoard] | None = None,
    ) -> None:
        self.codes = np.arange(440, 458, dtype=np.int16)  # board order
        self.noise = np.zeros(18, np.int16)
        self.time_as_temperature = False  # temperature codes: tenths of a millisecond, modulo 1024
        self.now_ns = 0
        self.board = BoardModel(board or BoardModelSettings(), self._sample)
        settings = settings or TakkTileSettings()
        self.link = ModelLink(self.board, settings, wrap=wrap)
        self.driver = TakkTileDriver(self.link, settings)

    def _sample(self, t_ns: int):
        sign = 1 if t_ns // PERIOD_NS % 2 else -1
        temperature = t_ns // 100_000 % 1024 if self.time_as_temperature else 500
        codes = self.codes + sign * self.noise, np.full(18, temperature, np.int16)
        return lambda: codes

    def poll(self, times: int = 1) -> None:
        for _ in range(times):
            self.now_ns += PERIOD_NS
            self.link.advance(self.now_ns)
            self.driver.poll(self.now_ns)

    def take_rest(self) -> "Bench":
        self.driver.start()
        self.driver.begin_rest()
        self.poll(51)
        return self

    def failure(self, polls: int) -> GraspError:
        """Error that the last of so many polls raises."""
        for _ in range(polls - 1):
            with contextlib.suppress(LinkLost, DeviceFault):
                self.poll()
        with pytest.raises(GraspError) as caught:
            self.poll()
        return caught.value

    @property
    def frame(self):
        return self.driver.frame


@pytest.fixture(params=[None, lambda usb: usb], ids=["codes", "bytes"])
def bench(request) -> Bench:
    """A bench whose frames pass the link as codes, and one on which they are encoded."""
    return Bench(wrap=request.param).take_rest()


def test_counts_are_raw_minus_rest_and_pressing_is_negative(bench):
    bench.codes = bench.codes - 30
    bench.poll(2)
    frame = bench.frame
    assert frame.counts.tolist() == [[-30] * 6] * 3
    assert frame.rest.tolist() == np.arange(440, 458).reshape(3, 6).tolist()
    assert (frame.raw - frame.rest == frame.counts).all()
    assert frame.temperature.tolist() == [[500] * 6] * 3
    assert {a.dtype for a in (frame.counts, frame.raw, frame.rest, frame.temperature)} == {
        np.dtype(np.int16)
    }


def test_a_frame_is_the_newest_of_the_pending_reads_and_has_its_sample_time():
    """208 frames a second: converted 4.8 to 9.6 ms before the tick, timed at mid-conversion."""
    bench = Bench()
    bench.time_as_temperature = True
    bench.take_rest()
    ages = []
    for _ in range(200):
        bench.poll()
        started_ns = bench.frame.sampled_ns - 1_500_000
        assert bench.frame.temperature[0, 0] == started_ns // 100_000 % 1024
        ages.append((bench.now_ns - bench.frame.sampled_ns) / MS)
    assert 3.3 <= min(ages) <= max(ages) <= 8.1
    assert np.median(ages) == pytest.approx(5.7, abs=0.3)


def test_a_misreported_code_stays_within_ten_bits(bench):
    bench.board.misreport(lambda codes: np.where(codes < 449, codes - 2000, codes + 2000))
    bench.poll(2)
    assert bench.frame.raw.tolist() == [[0] * 6, [0] * 3 + [1023] * 3, [1023] * 6]


def test_a_frame_that_is_too_old_counts_as_missed(bench):
    bench.link.advance(bench.now_ns + PERIOD_NS)
    bench.driver.poll(bench.now_ns + 200 * MS)
    assert bench.frame.missed == 1
    assert bench.driver.statistics.too_old == 1


def test_a_missed_sample_repeats_the_last_frame_and_counts_up_until_stale(bench):
    before = bench.frame
    bench.board.time_out(1)
    for missed in range(1, 9):
        bench.poll()
        frame = bench.frame
        assert frame.missed == missed
        assert frame.stale == (missed >= 5)
        assert frame.t_ns == bench.now_ns
        assert frame.sampled_ns == before.sampled_ns
        assert frame.seq == before.seq + missed
        assert frame.counts is before.counts
    bench.poll(3)
    assert bench.driver.statistics.timeouts == 1
    assert bench.driver.statistics.empty_ticks >= 8
    assert bench.frame.missed == 0
    assert not bench.frame.stale


def test_three_timeouts_restart_the_board_and_keep_the_rest(bench):
    bench.board.time_out(3)
    bench.poll(32)
    assert bench.driver.statistics.restarts == 1
    assert bench.driver.rest_taken
    assert bench.frame.missed == 0


def test_a_short_frame_never_shifts_taxels_and_dead_cells_are_named(bench):
    before = bench.frame.counts
    bench.board.kill_column(2)
    bench.codes = bench.codes - 100
    with pytest.raises(DeviceFault, match="no whole frames"):
        bench.poll(6)
    assert bench.frame.counts is before
    assert "other live cells: row 0 column 2, row 1 column 2" in bench.failure(20).message
    assert bench.driver.statistics.wrong_lengths == 9


@pytest.mark.parametrize(("fault", "args"), [("split_frame", ()), ("shorten_frame", (4,))])
def test_an_incomplete_frame_is_dropped_and_the_next_one_is_read_correctly(bench, fault, args):
    getattr(bench.board, fault)(*args)
    bench.poll()
    assert bench.frame.missed == 0
    assert bench.frame.raw.tolist() == np.arange(440, 458).reshape(3, 6).tolist()
    assert bench.driver.statistics.wrong_lengths == 1


def test_a_board_left_running_is_stopped_before_it_is_scanned():
    bench = Bench()
    bench.board.control(UsbRequest.TIMER, 100, 0xFF, 1, 0)
    bench.now_ns = PERIOD_NS
    bench.driver.start()  # a scan while sampling would hang the board
    bench.poll(2)
    assert bench.driver.statistics.frames == 2


def test_opening_names_the_finger_and_taxel_whose_cell_is_dead():
    bench = Bench()
    bench.board.kill_column(3)
    with pytest.raises(DeviceFault, match=r"finger A taxel 3 .*15 cells do") as caught:
        bench.driver.start()
    assert "cable of finger A" in caught.value.remedy


def test_the_rest_is_the_median_so_one_outlier_has_no_effect():
    bench = Bench()
    bench.driver.start()
    bench.driver.begin_rest()
    bench.poll(20)
    bench.codes = bench.codes - 8
    bench.poll()
    bench.codes = bench.codes + 8
    bench.poll(30)
    assert bench.frame.rest[0, 0] == 440


def test_a_sample_converted_before_begin_rest_is_not_part_of_it():
    bench = Bench()
    bench.codes[9] = 380
    bench.driver.start()
    bench.poll(3)
    bench.codes[9] = 449  # the hand has opened, and the rest is taken at once
    bench.driver.begin_rest()
    bench.poll(51)
    assert bench.frame.rest[1, 3] == 449


def test_a_loaded_fingertip_is_refused_by_name_and_rest_can_be_taken_again():
    bench = Bench()
    bench.codes[9] = 380
    with pytest.raises(Refused, match=r"finger B taxel 3 rests at code 380") as caught:
        bench.take_rest()
    assert "nothing touches" in caught.value.remedy
    assert not bench.driver.rest_taken
    assert bench.frame is None
    bench.codes[9] = 449
    bench.driver.begin_rest()
    bench.poll(51)
    assert bench.driver.rest_taken


def test_a_rest_far_from_the_stored_reference_is_refused():
    reference = [[440 + 6 * finger + taxel for taxel in range(6)] for finger in range(3)]
    settings = msgspec.convert({"rest_reference": reference}, TakkTileSettings)
    assert Bench(settings).take_rest().driver.rest_taken
    bench = Bench(settings)
    bench.codes[1] -= 25  # half a newton: still a plausible code
    with pytest.raises(Refused, match=r"finger A taxel 1 rests -25 counts from rest_reference"):
        bench.take_rest()


def test_an_unplugged_board_is_a_lost_link_and_returns_without_rest(bench):
    bench.board.unplug()
    for _ in range(10):
        with pytest.raises(LinkLost, match="unplugged"):
            bench.poll()
    assert bench.frame.stale
    bench.board.replug()
    for _ in range(100):
        with contextlib.suppress(LinkLost):
            bench.poll()
    assert bench.driver.statistics.reopens == 1
    assert not bench.driver.rest_taken
    assert bench.frame is None
    bench.driver.begin_rest()
    bench.poll(51)
    assert bench.frame.missed == 0
