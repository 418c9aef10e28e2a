"""TakkTile board on a link: opening, starting, and reading complete frames.

The board is host-paced: it converts after each read. The frame of a read was therefore converted
right after the previous read completed.
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
CodePair = tuple[Codes, Codes]  # pressure, temperature
Frame = bytes | CodePair  # a board model in this process may give codes

READ_TIMEOUT_MS = 100  # a sampling board sends a frame within 10 ms
_DRAIN_READS = 8  # more than a stopped board can have in its pipe
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
        "the tactile board hangs: its firmware waits on the sensor bus forever",
        "unplug the board, plug it in again, open it again",
    )


class Transfer(msgspec.Struct, frozen=True):
    """Data of one bulk read, and when it completed."""

    data: bytes
    done_ns: int


class BoardLink(Protocol):
    """The two USB transfers that the driver needs.

    They raise ``LinkLost`` when the board is unplugged and ``DeviceFault`` on STALL. A hung board
    does not reply to a control request, which raises one of the two.
    """

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes: ...

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        """Data of one transfer; None when it timed out without a byte."""
        ...


class Missed(Enum):
    """Reason why a tick has no sample."""

    TIMEOUT = "timeouts"
    WRONG_LENGTH = "wrong_lengths"
    IMPLAUSIBLE = "implausible"
    TOO_OLD = "too_old"


class Reading(msgspec.Struct, frozen=True):
    """A complete frame, not yet decoded."""

    frame: Frame
    sampled_ns: int  # best estimate of when it was converted

    def codes(self, cells: int) -> CodePair | None:
        """Codes of the cells in frame order; None when they are implausible."""
        frame = self.frame
        return protocol.parse_frame(frame, cells) if isinstance(frame, bytes) else frame


class Board:
    """A board that is opened, read and closed by one caller at a time."""

    def __init__(self, link: BoardLink, conversion_ms: float) -> None:
        self._link = link
        self._ticks = protocol.timer_ticks(conversion_ms)
        # a code is the pressure at about the middle of its conversion
        self._delay_ns = round(conversion_ms * 1e6 / 2)
        self._layout: Layout | None = None  # by the scan; None while the board is closed
        self.conversion_start_ns = 0  # when the last read, good or bad, completed

    @property
    def next_sample_ns(self) -> int:
        """Sample time of the running conversion, which the latest read started."""
        return self.conversion_start_ns + self._delay_ns

    def open(self, now_ns: int) -> Layout:
        """Stop, drain and scan; ``start`` comes next.

        A board that is still sampling must be stopped first: a scan would disturb its sampling on
        the I2C bus, and the pipe may hold an old frame.
        """
        self.close(now_ns)
        self._drain(now_ns)
        reply = self._link.control(UsbRequest.SCAN, 0, 0, protocol.SCAN_BYTES, now_ns)
        layout = protocol.parse_scan(reply)
        if layout is None:
            raise DeviceFault(
                f"the tactile board replied to a scan with {len(reply)} bytes instead of 8 or 40",
                "update the board's firmware, or check that this is a TakkTile USB board",
            )
        self._layout = layout
        return layout

    def start(self, now_ns: int) -> None:
        """Start sampling; the pipe is emptied."""
        if self._link.control(UsbRequest.TIMER, self._ticks, _START, 1, now_ns) != b"\x01":
            raise DeviceFault("the tactile board did not start sampling", "replug it, open again")
        self.conversion_start_ns = now_ns

    def stop(self, now_ns: int) -> None:
        """Stop sampling; ``start`` resumes it."""
        self._link.control(UsbRequest.TIMER, 0, 0, 1, now_ns)

    def close(self, now_ns: int) -> None:
        """Stop sampling and forget the layout."""
        self._layout = None
        self.stop(now_ns)

    def read(self, now_ns: int) -> Reading | Missed:
        """Read one complete frame; returns the reason if there is none."""
        if self._layout is None:
            raise Refused("the tactile board is not open", "call open() before poll()")
        transfer = self._link.bulk_read(protocol.READ_BYTES, now_ns)
        if transfer is None:
            return Missed.TIMEOUT
        if len(transfer.data) != self._layout.frame_bytes:
            self._resync(transfer, now_ns)
            return Missed.WRONG_LENGTH
        return self.reading(transfer.data, transfer.done_ns)

    def reading(self, frame: Frame, done_ns: int) -> Reading:
        """The reading of a complete frame whose read ended at ``done_ns``."""
        started_ns, self.conversion_start_ns = self.conversion_start_ns, done_ns
        return Reading(frame, started_ns + self._delay_ns)

    def _resync(self, part: Transfer | None, now_ns: int) -> None:
        """Discard the rest of a frame that was cut off between packets, up to its short packet.
        Otherwise every later read would start in the middle of a frame."""
        for _ in range(_RESYNC_READS):
            if part is None:
                return
            self.conversion_start_ns = part.done_ns
            if not part.data or len(part.data) % protocol.PACKET_BYTES:
                return
            part = self._link.bulk_read(protocol.READ_BYTES, now_ns)

    def _drain(self, now_ns: int) -> None:
        for _ in range(_DRAIN_READS):
            if self._link.bulk_read(protocol.READ_BYTES, now_ns) is None:
                return
        raise DeviceFault("the tactile board keeps sending after a stop", "replug it, open again")
