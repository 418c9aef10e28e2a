"""Golden bytes of the TakkTile board: codec of the model, of the driver, and both together."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.takktile import protocol
from drivers.takktile.model import board as codec

CODES = st.lists(st.integers(0, 1023), min_size=1, max_size=48)


def codes(*values: int) -> np.ndarray:
    return np.array(values, np.int16)


def test_a_frame_holds_msb_and_lsb_of_pressure_then_of_temperature():
    frame = codec.bulk_frame(codes(410, 1023), codes(507, 0))
    assert frame == bytes.fromhex("66807EC0 FFC00000")
    pressure, temperature = protocol.parse_frame(frame, 2)
    assert pressure.tolist() == [410, 1023]
    assert temperature.tolist() == [507, 0]


@given(CODES)
def test_every_code_survives_encoding_and_decoding(values):
    parsed = protocol.parse_frame(codec.bulk_frame(codes(*values), codes(*values)), len(values))
    assert parsed is not None
    assert parsed[0].tolist() == parsed[1].tolist() == values


def test_driver_and_model_use_the_same_requests_and_ticks():
    assert [*protocol.UsbRequest] == [codec.SCAN, codec.CONFIGURE_TIMER] == [0x5C, 0xC7]
    assert codec.ticks_ns(375) == 375 * protocol.TICK_NS == 3_000_000


@given(st.binary(max_size=400))
def test_a_frame_of_wrong_length_gives_none_and_never_raises(data):
    parsed = protocol.parse_frame(data, 18)
    assert parsed is None or len(data) == 72


def test_a_short_scan_has_one_byte_a_row_and_bit_c_for_column_c():
    layout = protocol.parse_scan(bytes.fromhex("3F00210000000080"))
    assert layout.alive == (*((0, c) for c in range(6)), (2, 0), (2, 5))
    assert layout.places == tuple(range(8))
    assert layout.frame_bytes == 32
    assert codec.scan_reply(layout.alive) == bytes.fromhex("3F00210000000000")


def test_a_long_scan_has_one_byte_a_cell_of_five_columns_and_frames_of_fixed_length():
    reply = bytearray(40)
    reply[0] = reply[4] = reply[5] = reply[39] = 0xFF
    layout = protocol.parse_scan(bytes(reply))
    assert layout.alive == ((0, 0), (0, 4), (1, 0), (7, 4))
    assert layout.places == (0, 4, 5, 39)
    assert layout.frame_bytes == 320


def test_a_scan_of_any_other_length_gives_none():
    for length in [0, 1, 7, 9, 39, 41, 64]:
        assert protocol.parse_scan(bytes(length)) is None, length
