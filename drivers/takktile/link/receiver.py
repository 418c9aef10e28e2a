"""The thread that keeps a read pending on the board, and brings the board back when it fails.

It receives and timestamps, nothing else: frames go into a bounded ring that ``reader`` empties.
Three bad reads in a row climb one rung: stop and start; clear the halt too; open again, found by
its serial number, with growing pauses and for as long as it takes.
"""

import contextlib
import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import Protocol

import msgspec

from drivers.errors import DeviceFault, GraspError
from drivers.takktile.board import Board, BoardLink, Missed, Reading
from drivers.takktile.protocol import Layout
from drivers.takktile.settings import TakkTileSettings

RING_FRAMES = 64  # 0.3 s
_RESTART_AT, _CLEAR_AT, _REOPEN_AT = 3, 6, 9  # bad reads in a row
_FIRST_PAUSE_S = 0.05
_LONGEST_PAUSE_S = 1.0
_JOIN_S = 10.0  # several control requests to a hung board, each with its time-out


class PendingLink(BoardLink, Protocol):
    """A link whose ``bulk_read`` blocks until a frame comes; ``usb_link`` has one."""

    @property
    def serial(self) -> str: ...

    def clear_halt(self) -> None: ...

    def close(self) -> None: ...


Connect = Callable[[str | None], PendingLink]  # by serial number; None: any board


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
    """Owns the link and its thread. ``take`` never waits."""

    def __init__(
        self, connect: Connect, settings: TakkTileSettings, clock: Callable[[], int]
    ) -> None:
        self._connect = connect
        self._conversion_ms = settings.conversion_ms
        self._clock = clock
        # a code tells the pressure at about the middle of its conversion
        self.conversion_delay_ns = round(settings.conversion_ms * 1e6 / 2)
        self._link: PendingLink | None = None
        self._serial: str | None = None
        self._layout: Layout | None = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
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

    def start(self) -> Layout:
        """Open the board, which may raise, and begin to read."""
        board, layout = self._open()
        self._stopping.clear()
        self._thread = threading.Thread(
            target=self._run, args=(board,), name="takktile-reader", daemon=True
        )
        self._thread.start()
        return layout

    def stop(self) -> None:
        """Stop the board and the thread; safe to call twice."""
        if self._thread is None:
            return
        self._stopping.set()
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            raise DeviceFault("a USB transfer of the tactile board does not end", "unplug it")
        self._thread = None

    def take(self) -> Readings:
        with self._lock:
            readings = list(self._ring)
            self._ring.clear()
            return Readings(readings, self._opens, self._error)

    def _run(self, board: Board) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._receive(board)
                except GraspError as error:
                    board = self._reopen(error) or board
        except Exception as bug:
            self._report(DeviceFault(f"reading the tactile board failed: {bug!r}", "report this"))
            raise
        finally:
            with contextlib.suppress(GraspError):
                board.close(self._clock())
            self._close_link()

    def _receive(self, board: Board) -> None:
        """Read until told to stop; raises when only opening again can help."""
        bad = 0  # reads in a row that brought no frame
        while not self._stopping.is_set():
            try:
                bad = 0 if self._read(board) else bad + 1
            except DeviceFault:  # a halted endpoint: waiting does not help
                bad = _CLEAR_AT if bad < _CLEAR_AT else _REOPEN_AT
            if bad >= _REOPEN_AT:
                raise DeviceFault("the tactile board sends no whole frames", "replug it")
            if bad in (_RESTART_AT, _CLEAR_AT):
                self._restart(board, clear=bad == _CLEAR_AT)

    def _read(self, board: Board) -> bool:
        reading = board.read(self._clock())
        with self._lock:
            if isinstance(reading, Missed):
                self._counts[reading.value] += 1
                return False
            self._counts["overruns"] += len(self._ring) == RING_FRAMES
            self._ring.append(reading)
            return True

    def _restart(self, board: Board, clear: bool) -> None:
        board.stop(self._clock())
        if clear and self._link is not None:
            self._link.clear_halt()
        board.start(self._clock())
        with self._lock:
            self._counts["restarts"] += 1

    def _reopen(self, error: GraspError) -> Board | None:
        """Try until the same board is back with the same cells; None when told to stop first."""
        pause_s = _FIRST_PAUSE_S
        while True:
            self._report(error)
            self._close_link()
            if self._stopping.wait(pause_s):
                return None
            try:
                board, _ = self._open()
            except GraspError as still:
                error = still
                pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
                continue
            with self._lock:
                self._counts["reopens"] += 1
            return board

    def _open(self) -> tuple[Board, Layout]:
        self._link = self._connect(self._serial)
        try:
            board = Board(self._link, self._conversion_ms, self.conversion_delay_ns)
            layout = board.open(self._clock())
            self._check_same(layout)
            board.start(self._clock())
        except BaseException:
            self._close_link()
            raise
        self._serial, self._layout = self._link.serial, layout
        with self._lock:
            self._ring.clear()
            self._opens += 1
            self._error = None
        return board, layout

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

    def _report(self, error: GraspError) -> None:
        with self._lock:
            self._error = error

    def _close_link(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
