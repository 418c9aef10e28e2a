"""The board model against what the TakkTile-usb firmware does."""

import numpy as np
import pytest

from drivers.takktile import protocol
from drivers.takktile.model.board import BoardModel, BoardModelSettings, Hung, Stall, Unplugged
from drivers.takktile.protocol import UsbRequest

MS = 1_000_000
READY_NS = 3 * MS + 18 * 100_000


class Scene:
    """Pressure codes 400 + milliseconds, to read from a frame when it was converted."""

    def __init__(self) -> None:
        self.calls: list[int] = []

    def __call__(self, t_ns: int):
        self.calls.append(t_ns)
        return lambda: (np.full(18, 400 + t_ns // MS, np.int16), np.full(18, 500, np.int16))


@pytest.fixture
def scene() -> Scene:
    return Scene()


@pytest.fixture
def board(scene: Scene) -> BoardModel:
    return BoardModel(BoardModelSettings(), scene)


def start(board: BoardModel, now_ns: int = 0) -> bytes:
    return board.control(UsbRequest.TIMER, 375, 0xFF, 1, now_ns)


def read_codes(board: BoardModel, now_ns: int) -> list[int]:
    frame = board.bulk_read(512, now_ns)
    return protocol.parse_frame(frame, len(frame) // 4)[0].tolist()


def test_a_board_that_was_not_started_sends_nothing(board):
    assert board.bulk_read(512, 10 * MS) is None


def test_start_answers_one_and_stop_answers_zero_and_silences(board):
    assert start(board) == b"\x01"
    assert board.control(UsbRequest.TIMER, 0, 0, 1, MS) == b"\x00"
    assert board.bulk_read(512, 100 * MS) is None


def test_nothing_comes_before_conversion_and_i2c_reading_are_done(board):
    start(board)
    assert board.bulk_read(512, READY_NS - 1) is None
    assert len(board.bulk_read(512, READY_NS)) == 72


def test_a_frame_is_one_read_old(board, scene):
    start(board)
    assert set(read_codes(board, 10 * MS)) == {400}
    assert set(read_codes(board, 20 * MS)) == {410}
    assert set(read_codes(board, 90 * MS)) == {420}
    assert scene.calls == [0, 10 * MS, 20 * MS, 90 * MS]


def test_a_split_frame_starts_no_conversion_until_its_last_byte_is_drained(board, scene):
    start(board)
    board.split_frame()
    assert len(board.bulk_read(512, 10 * MS)) == 64
    assert scene.calls == [0]
    assert len(board.bulk_read(512, 11 * MS)) == 8
    assert scene.calls == [0, 11 * MS]


def test_a_dead_column_shrinks_the_frame_and_shows_in_the_scan(board):
    board.kill_column(2)
    assert board.control(UsbRequest.SCAN, 0, 0, 64, 0) == bytes([0x3B] * 3 + [0] * 5)
    start(board)
    assert len(board.bulk_read(512, 10 * MS)) == 60


def test_sixteen_cells_make_a_frame_of_whole_packets(scene):
    cells = tuple((row, column) for row in range(4) for column in range(4))
    board = BoardModel(
        BoardModelSettings(cells=cells), lambda t: lambda: tuple(c[:16] for c in scene(t)())
    )
    start(board)
    assert len(board.bulk_read(512, 10 * MS)) == 64


def test_a_frozen_cell_repeats_its_code(board):
    start(board)
    read_codes(board, 10 * MS)
    board.freeze_cell(1, 0)
    read_codes(board, 20 * MS)
    codes = read_codes(board, 30 * MS)
    assert codes[6] == 410
    assert codes[0] == codes[7] == 420


def test_faults_of_one_frame_strike_once(board):
    start(board)
    board.shorten_frame(3)
    assert len(board.bulk_read(512, 10 * MS)) == 69
    board.flip_bit(1, 6)
    assert read_codes(board, 20 * MS)[0] == 410 ^ 1
    assert read_codes(board, 30 * MS)[0] == 420


def test_timeouts_keep_the_frame_waiting(board):
    start(board)
    board.time_out(2)
    assert board.bulk_read(512, 10 * MS) is None
    assert board.bulk_read(512, 20 * MS) is None
    assert set(read_codes(board, 30 * MS)) == {400}


def test_what_was_to_strike_the_next_reads_is_forgotten_when_the_board_is_replugged(board):
    start(board)
    board.time_out(1_000_000_000)
    board.shorten_frame(2)
    board.split_frame()
    board.flip_bit(0, 0)
    board.stall()
    board.replug()
    start(board)
    assert set(read_codes(board, 30 * MS)) == {400}


@pytest.mark.parametrize(("request_", "index"), [(0x42, 0), (UsbRequest.STRING, 2), (0xBB, 0)])
def test_unknown_requests_stall(board, request_, index):
    with pytest.raises(Stall):
        board.control(request_, 0, index, 64, 0)


@pytest.mark.parametrize(("address", "known"), [(0x00, 1), (0x2A, 1), (0x0C, 1), (0x30, 0)])
def test_an_address_on_the_bus_is_asked_for(board, address, known):
    assert board.control(0xBA, 1, address, 64, 0) == bytes([known])


def test_reading_from_an_address_that_nobody_has_hangs_the_firmware(board):
    with pytest.raises(Hung):
        board.control(0xBA, 1, 0x31, 64, 0)
    with pytest.raises(Hung):
        board.control(0x5C, 0, 0, 64, 0)


def test_an_injected_stall_strikes_once(board):
    board.stall()
    with pytest.raises(Stall):
        board.bulk_read(512, 0)
    assert board.bulk_read(512, 0) is None


def test_version_strings_end_with_nul(board):
    assert board.control(UsbRequest.STRING, 0, 0, 64, 0) == b"1.0\0"
    assert board.control(UsbRequest.STRING, 0, 1, 3, 0) == b"mod"


def test_a_scan_while_sampling_hangs_the_firmware_until_it_is_replugged(board):
    start(board)
    with pytest.raises(Hung):
        board.control(UsbRequest.SCAN, 0, 0, 64, MS)
    with pytest.raises(Hung):
        board.control(UsbRequest.TIMER, 0, 0, 1, MS)
    assert board.bulk_read(512, 10 * MS) is None
    board.replug()
    assert len(board.control(UsbRequest.SCAN, 0, 0, 64, 20 * MS)) == 8


def test_an_unplugged_board_is_not_there_and_comes_back_stopped(board):
    start(board)
    board.unplug()
    with pytest.raises(Unplugged):
        board.bulk_read(512, 10 * MS)
    board.replug()
    assert board.bulk_read(512, 20 * MS) is None


def test_calibration_of_column_five_is_that_of_the_next_row(board):
    def coefficients(row: int, column: int) -> bytes:
        return board.control(UsbRequest.CALIBRATION, column, row, 8, 0)

    assert coefficients(0, 0) == bytes.fromhex("3ECEB3F9C51733C8")
    assert coefficients(0, 4) != coefficients(1, 0)
    assert coefficients(0, 5) == coefficients(1, 0)
    apart = [(row, column) for row in range(3) for column in range(5)] + [(2, 5)]
    a0 = [int.from_bytes(coefficients(*cell)[:2]) - 0x3ECE for cell in apart]
    assert a0 == [6 * row + column for row, column in apart]
    assert {coefficients(*cell)[2:].hex() for cell in apart} == {"b3f9c51733c8"}


def test_a_takkfast_board_sends_every_place_dead_or_alive(scene):
    cells = tuple(divmod(cell, 5) for cell in range(18))
    board = BoardModel(BoardModelSettings(cells=cells, takkfast=True), scene)
    board.kill_column(4)
    assert len(board.control(UsbRequest.SCAN, 0, 0, 64, 0)) == 40
    start(board)
    codes = read_codes(board, 10 * MS)
    assert len(codes) == 80
    assert codes[3] == 400
    assert codes[4] == 0
