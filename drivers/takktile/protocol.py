"""Byte encoding of the TakkTile USB board as a host sees it. No state, no I/O.

Source: TakkTile-usb firmware (main.c, TakkI2C.c, Descriptors.c) and, for boards that answer a scan
with 40 bytes, the takkfast firmware of takktile-boards; NXP AN3785 for the MPL115A2 conversion.
"""

from enum import IntEnum

import msgspec
import numpy as np
from numpy.typing import NDArray

VENDOR_ID = 0x59E3
PRODUCT_ID = 0x74C7
ENDPOINT_IN = 0x81
PACKET_BYTES = 64  # full-speed bulk packet: a transfer ends with the first shorter one
READ_BYTES = 512  # multiple of the packet size, so that no packet can overflow the buffer

REQUEST_TYPE = 0xC0  # IN | vendor | device: every request, even a command, is a read
SCAN_BYTES = 64  # more than the scan reply of either firmware (8 or 40)

ROWS = 8
COLUMNS = 6
CELL_BYTES = 4

CHAIN_COLUMNS = 5  # takkfast: cell = 5 * row + column
CHAIN_CELLS = 40
CHAIN_FRAME_CELLS = 80  # the master's 40 cells, then the slave's, dead cells as zeros

TICK_NS = 8_000  # 32 MHz timer clock / 256
MAX_TICKS = 32_768  # the timer's period register

_PADDING = 0x3F  # codes are left aligned: the low six bits of each word are zero

Cell = tuple[int, int]  # (row, column)
Codes = NDArray[np.int16]


class UsbRequest(IntEnum):
    """Vendor requests (bRequest) that the driver makes. 0xBB would jump to the boot loader."""

    SCAN = 0x5C  # re-scan the I2C bus; only while stopped
    TIMER = 0xC7  # wIndex != 0: start with wValue ticks, reply 1; wIndex 0: stop, reply 0


class Layout(msgspec.Struct, frozen=True):
    """Place of each live cell in a bulk frame, derived from the scan reply.

    TakkTile-usb firmware sends live cells only, so that a frame shrinks with each dead one.
    takkfast firmware always sends every place.
    """

    alive: tuple[Cell, ...]
    places: tuple[int, ...]  # place in the frame of each cell of ``alive``
    frame_cells: int  # places in a frame

    @property
    def frame_bytes(self) -> int:
        return self.frame_cells * CELL_BYTES


def timer_ticks(conversion_ms: float) -> int:
    """Ticks of 8 us for wValue of the timer request, rounded up."""
    return min(MAX_TICKS, -int(-conversion_ms * 1e6 // TICK_NS))


def parse_scan(reply: bytes) -> Layout | None:
    """Layout from a scan reply: 8 bytes, bit c of byte r, or 40 bytes, 0xFF per live cell."""
    if len(reply) == ROWS:
        alive = tuple((r, c) for r in range(ROWS) for c in range(COLUMNS) if reply[r] >> c & 1)
        return Layout(alive, tuple(range(len(alive))), len(alive))
    if len(reply) == CHAIN_CELLS:
        places = tuple(place for place, live in enumerate(reply) if live)
        alive = tuple(divmod(place, CHAIN_COLUMNS) for place in places)
        return Layout(alive, places, CHAIN_FRAME_CELLS)
    return None


def parse_frame(data: bytes, cells: int) -> tuple[Codes, Codes] | None:
    """Pressure and temperature codes, each (cells,) int16 in 0..1023, of one bulk frame.

    None when the length is wrong or a padding bit is set. The converter never sets one, but a
    disturbed I2C read does: a released bus reads as 0xFF.
    """
    if len(data) != cells * CELL_BYTES:
        return None
    words = np.frombuffer(data, ">u2")
    if np.bitwise_or.reduce(words) & _PADDING:
        return None
    codes = (words >> 6).astype(np.int16)
    return codes[0::2], codes[1::2]
