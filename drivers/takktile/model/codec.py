"""Bytes of the board as its firmware makes them, apart from the driver's ``protocol``.

Nothing is shared, so that a mistake in one shows as a wrong code at the other end. Source:
TakkTile-usb firmware (main.c, TakkI2C.c) and the takkfast firmware of takktile-boards.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Cell = tuple[int, int]  # (row, column)
Codes = NDArray[np.int16]

# bRequest of the vendor requests
GET_STRING, SCAN, GET_CALIBRATION, CONFIGURE_TIMER = 0x00, 0x5C, 0x6C, 0xC7
BOTHER_ADDRESS = 0xBA

CONVERTER_MAX = 1023  # ten bits, sent as the upper ten of a word, most significant byte first
PACKET_BYTES = 64
CHAIN_ROW_CELLS = 5  # takkfast
CHAIN_CELLS = 40  # of one board of a chain; a frame has those of two
_WORD_STEP = 1 << 6  # one code in a word


def ticks_ns(ticks: int) -> int:
    """Period of the conversion timer: 32 MHz divided by 256."""
    return ticks * 256 * 1000 // 32


def scan_reply(alive: Sequence[Cell]) -> bytes:
    """Eight bytes, one a row: bit c stands for column c."""
    return bytes(sum(1 << c for r, c in alive if r == row) for row in range(8))


def chain_scan_reply(alive: Sequence[Cell]) -> bytes:
    """A takkfast board's: 40 bytes, 0xFF where a cell answers."""
    there = {CHAIN_ROW_CELLS * row + column for row, column in alive}
    return bytes(0xFF if place in there else 0 for place in range(CHAIN_CELLS))


def bulk_frame(pressure: Codes, temperature: Codes) -> bytes:
    """Four bytes a cell, pressure before temperature; (n,) codes beyond the converter saturate."""
    codes = np.empty((len(pressure), 2), np.int16)
    codes[:, 0], codes[:, 1] = pressure, temperature
    words = np.minimum(np.maximum(codes, 0), CONVERTER_MAX).view(np.uint16)
    words *= _WORD_STEP
    return words.astype(">u2").tobytes()


def chain_frame(alive: Sequence[Cell], pressure: Codes, temperature: Codes) -> bytes:
    """A takkfast board's: every place of the chain, zeros where no cell answers."""
    places = [CHAIN_ROW_CELLS * row + column for row, column in alive]
    codes = np.zeros((2, 2 * CHAIN_CELLS), np.int16)
    codes[:, places] = pressure, temperature
    return bulk_frame(codes[0], codes[1])
