"""The board model against what the TakkTile-usb firmware does."""

import numpy as np
import pytest

from drivers.takktile import protocol
from drivers.takktile.model.board import BoardModel, BoardModelSettings, Hung
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


def test_nothing_comes_before_conversion_and_i2c_reading_are_done(board):
    start(board)
    assert board.bulk_read(512, READY_NS - 1) is None
    assert len(board.bulk_read(512, READY_NS)) == 72


def test_a_dead_column_shrinks_the_frame_and_shows_in_the_scan(board):
    board.kill_column(2)
    assert board.control(UsbRequest.SCAN, 0, 0, 64, 0) == bytes([0x3B] * 3 + [0] * 5)
    start(board)
    assert len(board.bulk_read(512, 10 * MS)) == 60


def test_a_scan_while_sampling_hangs_the_firmware_until_it_is_replugged(board):
    start(board)
    with pytest.raises(Hung):
        board.control(UsbRequest.SCAN, 0, 0, 64, MS)
    with pytest.raises(Hung):
        board.control(UsbRequest.TIMER, 0, 0, 1, MS)
    assert board.bulk_read(512, 10 * MS) is None
    board.replug()
    assert len(board.control(UsbRequest.SCAN, 0, 0, 64, 20 * MS)) == 8


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
