"""Receiver of a board's frames, with recovery after failures; no thread.

It opens the board, receives and timestamps frames and puts them into a bounded ring, which
``driver`` empties. The board is host-paced: it converts after each read. The frame of a read was
therefore converted right after the previous read completed.

Every three bad reads in a row escalate the recovery: restart; clear the halt and restart; reopen
the board by its serial number, with growing pauses, until that succeeds. ``receive`` is called
repeatedly: by a thread in wall time, by the model's link in virtual time.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, GraspError, LinkLost, on_failure
from drivers.takktile import protocol
from drivers.takktile.protocol import Layout, UsbRequest

Codes = NDArray[np.int16]
CodePair = tuple[Codes, Codes]  # pressure, temperature
Frame = bytes | CodePair  # a board model in this process may give codes

READ_TIMEOUT_MS = 100  # a sampling board sends a frame within 10 ms
RING_FRAMES = 64  # 0.3 s
_DRAIN_READS = 8  # more than a stopped board can have in its pipe
_RESYNC_READS = 4  # the longest frame is five packets
_START = 0xFF
_RESTART_AT, _CLEAR_AT, _REOPEN_AT = 3, 6, 9  # bad reads in a row
_FIRST_PAUSE_NS = 50_000_000
_MAX_PAUSE_NS = 1_000_000_000


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


class UsbBoard(Protocol):
    """A board found on a bus and claimed; ``UsbLink`` is a real one.

    Transfers raise ``LinkLost`` when the board is unplugged and ``DeviceFault`` on STALL. A hung
    board does not reply to a control request, which raises one of the two.
    """

    @property
    def serial(self) -> str: ...

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes: ...

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        """Data of one transfer; None when it timed out without a byte."""
        ...

    def clear_halt(self) -> None: ...

    def close(self) -> None: ...


Connect = Callable[[str | None], UsbBoard]  # by serial number; None: any board


class Reading(msgspec.Struct, frozen=True):
    """A complete frame, not yet decoded."""

    frame: Frame
    sampled_ns: int  # best estimate of when it was converted

    def codes(self, cells: int) -> CodePair | None:
        """Codes of the cells in frame order; None when they are implausible."""
        frame = self.frame
        return protocol.parse_frame(frame, cells) if isinstance(frame, bytes) else frame


class Readings(msgspec.Struct, frozen=True):
    """Readings since the previous batch, oldest first, and the state of the link."""

    readings: list[Reading]
    opens: int  # number of times the board was opened: each invalidates rest counts
    error: GraspError | None  # why there is no link at present


class TakkTileStatistics(msgspec.Struct):
    """Counts since the receiver was made; the driver counts the first five."""

    frames: int = 0  # used: at most one a tick
    decimated: int = 0  # good frames that a newer one of the same tick replaced
    empty_ticks: int = 0  # ticks without a new frame
    implausible: int = 0  # a padding bit was set
    too_old: int = 0  # converted longer ago than max_age_ms
    timeouts: int = 0
    wrong_lengths: int = 0
    overruns: int = 0  # frames lost because the ring was full
    restarts: int = 0  # recoveries by stopping and starting
    reopens: int = 0  # recoveries by opening again: the rest counts were lost


class Receiver:
    """Receives frames. One caller opens, receives and closes; any thread may use the rest."""

    def __init__(self, connect: Connect, conversion_ms: float, clock: Callable[[], int]) -> None:
        self._connect = connect
        self._clock = clock
        self._ticks = protocol.timer_ticks(conversion_ms)
        # a code is the pressure at about the middle of its conversion
        self._delay_ns = round(conversion_ms * 1e6 / 2)
        self._usb: UsbBoard | None = None  # None while no board is open
        self._serial: str | None = None
        self._layout: Layout | None = None
        self._frame_bytes = 0
        self.conversion_start_ns = 0  # when the last read, good or bad, completed
        self._bad_reads = 0  # reads in a row without a valid frame
        self._pause_ns = _FIRST_PAUSE_NS
        self.statistics = TakkTileStatistics()
        self._lock = threading.Lock()  # guards the three below
        self._ring: deque[Reading] = deque(maxlen=RING_FRAMES)
        self._opens = 0
        self._error: GraspError | None = None

    @property
    def is_open(self) -> bool:
        return self._usb is not None

    @property
    def next_sample_ns(self) -> int:
        """Sample time of the running conversion, which the latest read started; 0 while no board
        is open."""
        return 0 if self._usb is None else self.conversion_start_ns + self._delay_ns

    def take(self) -> Readings:
        with self._lock:
            readings = list(self._ring)
            self._ring.clear()
            return Readings(readings, self._opens, self._error)

    def open(self) -> Layout:
        """Find the board, check that its layout is unchanged, start it. Raises ``LinkLost`` or
        ``DeviceFault``.

        A board that is still sampling is stopped first: a scan would disturb its sampling on the
        I2C bus, and the pipe may hold an old frame.
        """
        usb = self._connect(self._serial)
        with on_failure(usb.close):
            self._stop(usb)
            self._drain(usb)
            layout = self._scan(usb)
            self._check_layout_unchanged(layout)
            self._start(usb)
        self._usb, self._serial, self._layout = usb, usb.serial, layout
        self._frame_bytes = layout.frame_bytes
        self._bad_reads, self._pause_ns = 0, _FIRST_PAUSE_NS
        with self._lock:
            self._ring.clear()
            self._opens += 1
            self._error = None
        return layout

    def close(self) -> None:
        """Stop the board and release it; safe to call twice."""
        if self._usb is not None:
            with contextlib.suppress(GraspError):
                self._stop(self._usb)
        self._disconnect()

    def receive(self) -> int:
        """Read once, or try once to reopen the board; returns ns to wait before the next call."""
        try:
            if self._usb is None:
                self.open()
                self.statistics.reopens += 1
            else:
                self._read(self._usb)
            return 0
        except GraspError as error:
            self.report(error)
            self._disconnect()
            pause_ns = self._pause_ns
            self._pause_ns = min(2 * pause_ns, _MAX_PAUSE_NS)
            return pause_ns

    def accept(self, frame: Frame, done_ns: int) -> None:
        """Take a complete frame whose read ended at ``done_ns``; it ends a series of bad reads."""
        reading = Reading(frame, self.conversion_start_ns + self._delay_ns)
        self.conversion_start_ns = done_ns
        self._bad_reads = 0
        with self._lock:
            self.statistics.overruns += len(self._ring) == RING_FRAMES
            self._ring.append(reading)

    def report(self, error: GraspError) -> None:
        """Report an error in every batch until the board has been reopened."""
        with self._lock:
            self._error = error

    def _disconnect(self) -> None:
        if self._usb is not None:
            self._usb.close()
            self._usb = None

    # Reading and recovery

    def _read(self, usb: UsbBoard) -> None:
        """Read once, and recover after bad reads in a row."""
        now_ns = self._clock()
        try:
            transfer = usb.bulk_read(protocol.READ_BYTES, now_ns)
            if transfer is not None and len(transfer.data) == self._frame_bytes:
                self.accept(transfer.data, transfer.done_ns)
                return
            if transfer is not None:
                self._resync(usb, transfer, now_ns)
        except DeviceFault:  # a halted endpoint: waiting does not help
            self._escalate(usb, _CLEAR_AT if self._bad_reads < _CLEAR_AT else _REOPEN_AT)
            return
        self.statistics.timeouts += transfer is None
        self.statistics.wrong_lengths += transfer is not None
        self._escalate(usb, self._bad_reads + 1)

    def _resync(self, usb: UsbBoard, part: Transfer | None, now_ns: int) -> None:
        """Discard the rest of a frame that was cut off between packets, up to its short packet.
        Otherwise every later read would start in the middle of a frame."""
        for _ in range(_RESYNC_READS):
            if part is None:
                return
            self.conversion_start_ns = part.done_ns
            if not part.data or len(part.data) % protocol.PACKET_BYTES:
                return
            part = usb.bulk_read(protocol.READ_BYTES, now_ns)

    def _escalate(self, usb: UsbBoard, bad: int) -> None:
        self._bad_reads = bad
        if bad >= _REOPEN_AT:
            raise DeviceFault("the tactile board sends no whole frames", "replug it")
        if bad in (_RESTART_AT, _CLEAR_AT):
            self._stop(usb)
            if bad == _CLEAR_AT:
                usb.clear_halt()
            self._start(usb)
            self.statistics.restarts += 1

    def _check_layout_unchanged(self, layout: Layout) -> None:
        """Raise ``DeviceFault`` when a reopened board has other live cells, since taxels would then
        be assigned wrongly."""
        if self._layout is None or self._layout == layout:
            return
        changed = sorted(set(self._layout.alive) ^ set(layout.alive))
        cells = ", ".join(f"row {row} column {column}" for row, column in changed)
        raise DeviceFault(
            f"the reopened tactile board has other live cells: {cells or 'other firmware'}",
            "check the cables of the fingertips; then restart the program",
        )

    # Requests

    def _start(self, usb: UsbBoard) -> None:
        """Start sampling; the pipe is emptied."""
        now_ns = self._clock()
        if usb.control(UsbRequest.TIMER, self._ticks, _START, 1, now_ns) != b"\x01":
            raise DeviceFault("the tactile board did not start sampling", "replug it, open again")
        self.conversion_start_ns = now_ns

    def _stop(self, usb: UsbBoard) -> None:
        """Stop sampling."""
        usb.control(UsbRequest.TIMER, 0, 0, 1, self._clock())

    def _drain(self, usb: UsbBoard) -> None:
        for _ in range(_DRAIN_READS):
            if usb.bulk_read(protocol.READ_BYTES, self._clock()) is None:
                return
        raise DeviceFault("the tactile board keeps sending after a stop", "replug it, open again")

    def _scan(self, usb: UsbBoard) -> Layout:
        reply = usb.control(UsbRequest.SCAN, 0, 0, protocol.SCAN_BYTES, self._clock())
        layout = protocol.parse_scan(reply)
        if layout is None:
            raise DeviceFault(
                f"the tactile board replied to a scan with {len(reply)} bytes instead of 8 or 40",
                "update the board's firmware, or check that this is a TakkTile USB board",
            )
        return layout
