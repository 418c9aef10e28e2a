"""One TakkTile board behind a link: opening, starting, and reading frames whole.

The board is host-paced: it converts after each read, so that the frame which a read brings was
converted right after the read before it completed.
"""

from enum import Enum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.takktile import protocol
from drivers.takktile.protocol import Layout, UsbRequest

Codes = NDArray[np.int16]

READ_TIMEOUT_MS = 100  # a board that samples answers within 10 ms
_DRAIN_READS = 8  # more than a stopped board can still have in its pipe
_RESYNC_READS = 4  # the longest frame is five packets
_START = 0xFF


def unplugged() -> LinkLost:
    return LinkLost(
        "the tactile board is unplugged", "check its USB cable and plug it in, then start again"
    )


def stalled() -> DeviceFault:
    return DeviceFault(
        "the tactile board refused a USB transfer (STALL)",
        "open it again; if that fails, update its firmware",
    )


def hung() -> DeviceFault:
    return DeviceFault(
        "the tactile board hangs: its firmware waits on the sensor bus for ever",
        "unplug the board, plug it in again, open it again",
    )


class Transfer(msgspec.Struct, frozen=True):
    """What one bulk read brought, and when it completed."""

    data: bytes
    done_ns: int


class BoardLink(Protocol):
    """The two USB transfers that the driver needs.

    They raise ``LinkLost`` when the board is unplugged and ``DeviceFault`` on STALL; a hung board
    answers no control request, which is one or the other.
    """

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes: ...

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        """One transfer; None when it timed out without a byte."""
        ...


class Missed(Enum):
    """Why a tick brought no sample."""

    TIMEOUT = "timeouts"
    WRONG_LENGTH = "wrong_lengths"
    IMPLAUSIBLE = "implausible"
    TOO_OLD = "too_old"


class Reading(msgspec.Struct, frozen=True):
    """A frame of the right length, not yet decoded."""

    data: bytes
    sampled_ns: int  # best estimate of when it was converted
    done_ns: int  # when its read completed


class Board:
    """A board that is opened, read and closed by one caller at a time."""

    def __init__(self, link: BoardLink, conversion_ms: float) -> None:
        self._link = link
        self._ticks = protocol.timer_ticks(conversion_ms)
        # a code tells the pressure at about the middle of its conversion
        self._delay_ns = round(conversion_ms * 1e6 / 2)
        self._layout: Layout | None = None  # None until the board has been opened
        self._converted_ns = 0

    @property
    def layout(self) -> Layout | None:
        """What the scan found; None while the board is closed."""
        return self._layout

    @property
    def converting_ns(self) -> int:
        """What time the conversion tells of that now goes on; the latest read started it."""
        return self._converted_ns + self._delay_ns

    def open(self, now_ns: int) -> Layout:
        """Stop, drain and scan; ``start`` comes next.

        A board that some earlier program left running must be stopped first: a scan would disturb
        its sampling on the I2C bus, and the pipe may hold an old frame.
        """
        self.close(now_ns)
        self._drain(now_ns)
        reply = self._link.control(UsbRequest.SCAN, 0, 0, protocol.SCAN_BYTES, now_ns)
        layout = protocol.parse_scan(reply)
        if layout is None:
            raise DeviceFault(
                f"the tactile board answered a scan with {len(reply)} bytes instead of 8 or 40",
                "update the board's firmware, or check that this is a TakkTile USB board",
            )
        self._layout = layout
        return layout

    def start(self, now_ns: int) -> None:
        """Start sampling; what was in the pipe is lost."""
        if self._link.control(UsbRequest.TIMER, self._ticks, _START, 1, now_ns) != b"\x01":
            raise DeviceFault("the tactile board did not start sampling", "replug it, open again")
        self._converted_ns = now_ns

    def stop(self, now_ns: int) -> None:
        """Stop sampling; ``start`` goes on."""
        self._link.control(UsbRequest.TIMER, 0, 0, 1, now_ns)

    def close(self, now_ns: int) -> None:
        """Stop sampling and forget the layout."""
        self._layout = None
        self.stop(now_ns)

    def read(self, now_ns: int) -> Reading | Missed:
        """One frame, whole or not at all."""
        if self._layout is None:
            raise Refused("the tactile board is not open", "call open() before poll()")
        transfer = self._link.bulk_read(protocol.READ_BYTES, now_ns)
        if transfer is None:
            return Missed.TIMEOUT
        # Draining a frame, good or bad, is what makes the board convert the next one.
        sampled_ns, self._converted_ns = self._converted_ns, transfer.done_ns
        if len(transfer.data) != self._layout.frame_bytes:
            self._resync(transfer, now_ns)
            return Missed.WRONG_LENGTH
        return Reading(transfer.data, sampled_ns + self._delay_ns, transfer.done_ns)

    def pass_over(self, done_ns: int) -> None:
        """A frame was read then that nobody needs: it only started the next conversion."""
        self._converted_ns = done_ns

    def _resync(self, part: Transfer | None, now_ns: int) -> None:
        """Read away the rest of a frame cut off between packets, up to its short packet.

        Otherwise the next read would start in the middle of this frame, and so on for ever.
        """
        for _ in range(_RESYNC_READS):
            if part is None:
                return
            self._converted_ns = part.done_ns
            if not part.data or len(part.data) % protocol.PACKET_BYTES:
                return
            part = self._link.bulk_read(protocol.READ_BYTES, now_ns)

    def _drain(self, now_ns: int) -> None:
        for _ in range(_DRAIN_READS):
            if self._link.bulk_read(protocol.READ_BYTES, now_ns) is None:
                return
        raise DeviceFault("the tactile board keeps sending after a stop", "replug it, open again")
