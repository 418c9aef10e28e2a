"""Reads a board frame by frame and brings it back when it fails; thread-free.

It receives and timestamps, nothing else: frames go into a bounded ring that ``driver`` empties.
Three bad reads in a row climb one rung: stop and start; clear the halt too; open again, found by
its serial number, with growing pauses and for as long as it takes. Whoever owns the time calls
``receive`` again and again: a thread in wall time, the model's link in virtual time.
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
_LONGEST_PAUSE_NS = 1_000_000_000


class UsbBoard(BoardLink, Protocol):
    """A board found on a bus and claimed; ``link.usb`` has a real one."""

    @property
    def serial(self) -> str: ...

    def clear_halt(self) -> None: ...

    def close(self) -> None: ...


Connect = Callable[[str | None], UsbBoard]  # by serial number; None: any board


class Readings(msgspec.Struct, frozen=True):
    """What came since the batch before, oldest first, and how the link stands."""

    readings: list[Reading]
    opens: int  # how often the board has been opened: rest counts do not outlive an opening
    error: GraspError | None  # why there is no link at present


class ReceiverCounts(msgspec.Struct, frozen=True):
    """Reads and recoveries since the receiver was made."""

    timeouts: int
    wrong_lengths: int
    overruns: int  # frames that nobody fetched before the ring was full
    restarts: int
    reopens: int


class Receiver:
    """One caller opens, receives and closes; ``take`` and the properties are anybody's."""

    def __init__(self, connect: Connect, conversion_ms: float, clock: Callable[[], int]) -> None:
        self._connect = connect
        self._conversion_ms = conversion_ms
        self._clock = clock
        self._usb: UsbBoard | None = None
        self._board: Board | None = None  # None while there is none
        self._serial: str | None = None
        self._layout: Layout | None = None
        self._bad = 0  # reads in a row that brought no frame
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
    def converting_ns(self) -> int:
        """What time the conversion tells of that now goes on; 0 while there is no board."""
        board = self._board
        return 0 if board is None else board.converting_ns

    def take(self) -> Readings:
        with self._lock:
            readings = list(self._ring)
            self._ring.clear()
            return Readings(readings, self._opens, self._error)

    def open(self) -> Layout:
        """Find the board, check that it is as it was, start it; raises what stands against it."""
        self._usb = self._connect(self._serial)
        with on_failure(self._disconnect):
            board = Board(self._usb, self._conversion_ms)
            layout = board.open(self._clock())
            self._check_same(layout)
            board.start(self._clock())
        self._board, self._serial, self._layout = board, self._usb.serial, layout
        self._bad, self._pause_ns = 0, _FIRST_PAUSE_NS
        with self._lock:
            self._ring.clear()
            self._opens += 1
            self._error = None
        return layout

    def close(self) -> None:
        """Stop the board and give it back; safe to call twice."""
        if self._board is not None:
            with contextlib.suppress(GraspError):
                self._board.close(self._clock())
        self._disconnect()

    def receive(self) -> int:
        """One read, or one attempt to open the board again; ns to wait before the next."""
        try:
            if self._board is None:
                self.open()
                self._count("reopens")
            else:
                self._climb(self._board, self._read(self._board))
            return 0
        except GraspError as error:
            self.report(error)
            self._disconnect()
            pause_ns = self._pause_ns
            self._pause_ns = min(2 * pause_ns, _LONGEST_PAUSE_NS)
            return pause_ns

    def pass_over(self, done_ns: int) -> None:
        """A frame was read then that a newer one follows before anybody could take it."""
        if self._board is not None:
            self._board.pass_over(done_ns)

    def report(self, error: GraspError) -> None:
        """Whoever takes will hear of it, until the board has been opened again."""
        with self._lock:
            self._error = error

    def _read(self, board: Board) -> int:
        """One read; how many in a row have now been bad."""
        try:
            reading = board.read(self._clock())
        except DeviceFault:  # a halted endpoint: waiting does not help
            return _CLEAR_AT if self._bad < _CLEAR_AT else _REOPEN_AT
        if isinstance(reading, Missed):
            self._count(reading.value)
            return self._bad + 1
        with self._lock:
            self._counts["overruns"] += len(self._ring) == RING_FRAMES
            self._ring.append(reading)
        return 0

    def _climb(self, board: Board, bad: int) -> None:
        self._bad = bad
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

    def _check_same(self, layout: Layout) -> None:
        """The board must come back as it was: otherwise every later taxel would be another."""
        if self._layout is None or self._layout == layout:
            return
        changed = sorted(set(self._layout.alive) ^ set(layout.alive))
        cells = ", ".join(f"row {row} column {column}" for row, column in changed)
        raise DeviceFault(
            f"the tactile board came back with other cells alive: {cells or 'other firmware'}",
            "check the cables of the fingertips; then restart the program",
        )

    def _count(self, what: str) -> None:
        with self._lock:
            self._counts[what] += 1

    def _disconnect(self) -> None:
        self._board = None
        if self._usb is not None:
            self._usb.close()
            self._usb = None
