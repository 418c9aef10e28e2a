"""Receiver of a board's frames, with recovery after failures; no thread.

It receives and timestamps frames and puts them into a bounded ring, which ``driver`` empties.
Every three bad reads in a row escalate the recovery: restart; clear the halt and restart; reopen
the board by its serial number, with growing pauses, until that succeeds. ``receive`` is called
repeatedly: by a thread in wall time, by the model's link in virtual time.
"""

import contextlib
import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import Protocol

import msgspec

from drivers.errors import DeviceFault, GraspError, on_failure
from drivers.takktile.board import Board, BoardLink, Missed, Reading
from drivers.takktile.protocol import Layout

RING_FRAMES = 64  # 0.3 s
_RESTART_AT, _CLEAR_AT, _REOPEN_AT = 3, 6, 9  # bad reads in a row
_FIRST_PAUSE_NS = 50_000_000
_MAX_PAUSE_NS = 1_000_000_000


class UsbBoard(BoardLink, Protocol):
    """A board found on a bus and claimed; ``UsbLink`` is a real one."""

    @property
    def serial(self) -> str: ...

    def clear_halt(self) -> None: ...

    def close(self) -> None: ...


Connect = Callable[[str | None], UsbBoard]  # by serial number; None: any board


class Readings(msgspec.Struct, frozen=True):
    """Readings since the previous batch, oldest first, and the state of the link."""

    readings: list[Reading]
    opens: int  # number of times the board was opened: each invalidates rest counts
    error: GraspError | None  # why there is no link at present


class ReceiverCounts(msgspec.Struct, frozen=True):
    """Reads and recoveries since the receiver was made."""

    timeouts: int
    wrong_lengths: int
    overruns: int  # frames dropped because the ring was full
    restarts: int
    reopens: int


class Receiver:
    """Receives frames. One caller opens, receives and closes; any thread may use the rest."""

    def __init__(self, connect: Connect, conversion_ms: float, clock: Callable[[], int]) -> None:
        self._connect = connect
        self._conversion_ms = conversion_ms
        self._clock = clock
        self._usb: UsbBoard | None = None
        self.board: Board | None = None  # None while no board is open
        self._serial: str | None = None
        self._layout: Layout | None = None
        self._bad_reads = 0  # reads in a row without a valid frame
        self._pause_ns = _FIRST_PAUSE_NS
        self._lock = threading.Lock()  # guards the four below
        self._ring: deque[Reading] = deque(maxlen=RING_FRAMES)
        self._opens = 0
        self._error: GraspError | None = None
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> ReceiverCounts:
        with self._lock:
            names = ReceiverCounts.__struct_fields__
            return ReceiverCounts(**{name: self._counts[name] for name in names})

    @property
    def next_sample_ns(self) -> int:
        """Sample time of the running conversion; 0 while no board is open."""
        board = self.board
        return 0 if board is None else board.next_sample_ns

    def take(self) -> Readings:
        with self._lock:
            readings = list(self._ring)
            self._ring.clear()
            return Readings(readings, self._opens, self._error)

    def open(self) -> Layout:
        """Find the board, check that its layout is unchanged, start it. Raises ``LinkLost`` or
        ``DeviceFault``."""
        self._usb = self._connect(self._serial)
        with on_failure(self._disconnect):
            board = Board(self._usb, self._conversion_ms)
            layout = board.open(self._clock())
            self._check_layout_unchanged(layout)
            board.start(self._clock())
        self.board, self._serial, self._layout = board, self._usb.serial, layout
        self._bad_reads, self._pause_ns = 0, _FIRST_PAUSE_NS
        with self._lock:
            self._ring.clear()
            self._opens += 1
            self._error = None
        return layout

    def close(self) -> None:
        """Stop the board and release it; safe to call twice."""
        if self.board is not None:
            with contextlib.suppress(GraspError):
                self.board.close(self._clock())
        self._disconnect()

    def receive(self) -> int:
        """Read once, or try once to reopen the board; returns ns to wait before the next call."""
        try:
            if self.board is None:
                self.open()
                self._count("reopens")
            else:
                self._read(self.board)
            return 0
        except GraspError as error:
            self.report(error)
            self._disconnect()
            pause_ns = self._pause_ns
            self._pause_ns = min(2 * pause_ns, _MAX_PAUSE_NS)
            return pause_ns

    def accept(self, reading: Reading) -> None:
        """Take a complete frame, which ends a series of bad reads."""
        self._bad_reads = 0
        with self._lock:
            if len(self._ring) == RING_FRAMES:
                self._counts["overruns"] += 1
            self._ring.append(reading)

    def report(self, error: GraspError) -> None:
        """Report an error in every batch until the board has been reopened."""
        with self._lock:
            self._error = error

    def _read(self, board: Board) -> None:
        """Read once, and recover after bad reads in a row."""
        try:
            reading = board.read(self._clock())
        except DeviceFault:  # a halted endpoint: waiting does not help
            self._escalate(board, _CLEAR_AT if self._bad_reads < _CLEAR_AT else _REOPEN_AT)
            return
        if isinstance(reading, Missed):
            self._count(reading.value)
            self._escalate(board, self._bad_reads + 1)
        else:
            self.accept(reading)

    def _escalate(self, board: Board, bad: int) -> None:
        self._bad_reads = bad
        if bad >= _REOPEN_AT:
            raise DeviceFault("the tactile board sends no whole frames", "replug it")
        if bad in (_RESTART_AT, _CLEAR_AT):
            self._restart(board, clear=bad == _CLEAR_AT)

    def _restart(self, board: Board, clear: bool) -> None:
        board.stop(self._clock())
        if clear and self._usb is not None:
            self._usb.clear_halt()
        board.start(self._clock())
        self._count("restarts")

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

    def _count(self, what: str) -> None:
        with self._lock:
            self._counts[what] += 1

    def _disconnect(self) -> None:
        self.board = None
        if self._usb is not None:
            self._usb.close()
            self._usb = None
