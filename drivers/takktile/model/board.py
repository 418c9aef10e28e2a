"""Simulation model of the TakkTile USB board at the level of USB transfers; time is an argument.

Source: TakkTile-usb firmware (main.c, TakkI2C.c). The board is host-paced: its timer interrupt
reads all cells, waits until the host has read the frame, and only then starts the next conversion.
A frame was therefore converted right after the previous read.

Bytes are encoded here, separately from the driver's ``protocol``, so that tests reveal a mistake in
either. A link in this process may take a frame's codes instead, while no fault is pending.
"""

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.takktile.settings import BoardModelSettings

Cell = tuple[int, int]  # (row, column)
Codes = NDArray[np.int16]
CodePair = tuple[Codes, Codes]  # pressure, temperature
Latched = Callable[[], CodePair]
Sample = Callable[[int], Latched]
Corruption = Callable[[Codes], Codes]

SCAN, CONFIGURE_TIMER = 0x5C, 0xC7  # bRequest of the vendor requests
CONVERTER_MAX: Final = 1023  # ten bits, sent as the upper ten of a word, high byte first
PACKET_BYTES: Final = 64
CELL_READ_NS: Final = 100_000  # to read one cell by I2C; assumed, 1 MHz and 89 bits
_WORD_STEP: Final = 1 << 6  # one code in a word
_NEVER_NS: Final = 1 << 62


def ticks_ns(ticks: int) -> int:
    """Period of the conversion timer: 32 MHz divided by 256."""
    return ticks * 256 * 1000 // 32


def scan_reply(alive: Sequence[Cell]) -> bytes:
    """Eight bytes, one per row: bit c is column c."""
    return bytes(sum(1 << c for r, c in alive if r == row) for row in range(8))


def bulk_frame(pressure: Codes, temperature: Codes) -> bytes:
    """Four bytes per cell, pressure before temperature; (n,) codes in 0..1023."""
    words = np.empty((len(pressure), 2), ">u2")
    words[:, 0], words[:, 1] = pressure, temperature
    words *= _WORD_STEP
    return words.tobytes()


class Stall(Exception):
    """The endpoint replied with STALL (errno 32 of a USB host)."""


class Unplugged(Exception):
    """The board is not on the bus (errno 19 of a USB host)."""


class Hung(Exception):
    """The firmware waits on its I2C bus: transfers time out until the board is replugged."""


class _PendingFaults(msgspec.Struct):
    """Faults to inject into the next transfers or the next frame."""

    timeouts: int = 0
    lost_bytes: int = 0
    split: bool = False
    stall: bool = False


class BoardModel:
    """Model of one board.

    ``sample(t_ns)`` is called when a conversion starts, and returns a function. That function
    returns the pressure and temperature codes of the cells at that time, two new (n,) int16 arrays
    in 0..1023 in the order of ``settings.cells``. It is called at most once, before the next
    conversion starts, and never for a frame that is not read.
    """

    def __init__(self, settings: BoardModelSettings, sample: Sample) -> None:
        self._settings = settings
        self._sample = sample
        self._dead: set[Cell] = set()
        self._corrupt: Corruption | None = None
        self._faults = _PendingFaults()
        self._ready_ns = 0
        self._pending = b""  # part of a frame that the host has not read yet
        self._plug_count = 0
        self._hung = self._started = False
        self._power_up()

    @property
    def plugged(self) -> bool:
        return self._plugged

    @property
    def plug_count(self) -> int:
        """Number of times the board was plugged in; each makes earlier USB handles invalid."""
        return self._plug_count

    @property
    def ready_ns(self) -> int | None:
        """Time from which a bulk read returns data; None when another event has to come first."""
        if self._faults.stall:
            return 0
        if self._faults.timeouts or self._hung or not self._started:
            return None
        return self._ready_ns

    @property
    def free_period_ns(self) -> int | None:
        """Period of frames that are read at once; None while stopped or with a fault pending."""
        f = self._faults
        if f.timeouts or f.lost_bytes or f.split or f.stall or self._hung or self._dead:
            return None
        free = self._started and self._plugged and not self._pending
        return self._period_ns if free else None

    def codes(self) -> CodePair:
        """Codes of the latest conversion."""
        pressure, temperature = self._latched()
        if self._corrupt is not None:
            corrupted = np.clip(self._corrupt(pressure), 0, CONVERTER_MAX)
            pressure = corrupted.astype(np.int16)
        return pressure, temperature

    def start_conversion(self, now_ns: int) -> None:
        """Start the next conversion, as reading a complete frame does."""
        self._latched = self._sample(now_ns)
        self._ready_ns = now_ns + self._period_ns

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        """Reply to a vendor request, cut to ``length``; ``Stall`` when the request is unknown."""
        self._require_present()
        if self._hung:
            raise Hung
        if request == CONFIGURE_TIMER:
            return self._configure_timer(value, index, now_ns)[:length]
        if request != SCAN:
            raise Stall
        if self._started:
            # A scan pre-empts the sampling interrupt in the middle of its I2C transfer. That may
            # corrupt data or hang the board; the model takes the worst case.
            self._hung = True
            raise Hung
        return scan_reply(self._alive())[:length]

    def bulk_read(self, size: int, now_ns: int) -> bytes | None:
        """Data of a bulk IN transfer of at most ``size`` bytes; None when it times out."""
        self._require_present()
        if self._faults.timeouts:
            self._faults.timeouts -= 1
            return None
        if self._hung or not self._started or now_ns < self._ready_ns:
            return None
        if not self._pending:
            self._pending = self._apply_frame_faults(self._frame())
            size = PACKET_BYTES if self._faults.split else size
            self._faults.split = False
        out, self._pending = self._pending[:size], self._pending[size:]
        if not self._pending:
            self.start_conversion(now_ns)
        return out

    # Fault injection; faults of one frame affect the next frame read.

    def kill_column(self, column: int) -> None:
        """Make every cell of a column dead: frames become shorter at once, without notice."""
        self._dead |= {cell for cell in self._settings.cells if cell[1] == column}

    def misreport(self, corruption: Corruption) -> None:
        """Apply ``corruption`` to pressure codes from the next conversion on, clipped to ten
        bits."""
        self._corrupt = corruption

    def time_out(self, reads: int) -> None:
        """Let the next bulk reads time out."""
        self._faults.timeouts = reads

    def silence(self, until_ns: int) -> None:
        """Send no frame up to and including a time; a ready frame waits."""
        self._ready_ns = max(self._ready_ns, until_ns + 1)

    def shorten_frame(self, lost_bytes: int) -> None:
        """Omit the last bytes of the next frame."""
        self._faults.lost_bytes = lost_bytes

    def split_frame(self) -> None:
        """Send the next frame in two reads, as when the first times out half-way."""
        self._faults.split = True

    def stall(self) -> None:
        """Reply to the next transfer, control or bulk, with STALL."""
        self._faults.stall = True

    def unplug(self) -> None:
        self._plugged = False

    def replug(self) -> None:
        """Plug the board in again: it is reset, stopped, and has no planned faults."""
        self._power_up()

    def _power_up(self) -> None:
        self._plugged = True
        self._plug_count += 1
        self._hung = False
        self._faults = _PendingFaults()
        self._started = False
        self._period_ns = _NEVER_NS  # until it is started
        self._ready_ns = 0
        self._pending = b""

    def _require_present(self) -> None:
        if not self._plugged:
            raise Unplugged
        if self._faults.stall:
            self._faults.stall = False
            raise Stall

    def _alive(self) -> list[Cell]:
        return [cell for cell in self._settings.cells if cell not in self._dead]

    def _configure_timer(self, ticks: int, index: int, now_ns: int) -> bytes:
        self._pending = b""  # the firmware resets the IN pipe
        self._started = index != 0
        if self._started:
            self._period_ns = ticks_ns(ticks) + CELL_READ_NS * len(self._settings.cells)
            self.start_conversion(now_ns)
        return bytes([self._started])

    def _frame(self) -> bytes:
        pressure, temperature = self.codes()
        if self._dead:
            live = [i for i, cell in enumerate(self._settings.cells) if cell not in self._dead]
            pressure, temperature = pressure[live], temperature[live]
        return bulk_frame(pressure, temperature)

    def _apply_frame_faults(self, frame: bytes) -> bytes:
        """Apply the planned faults of one frame, once."""
        if self._faults.lost_bytes:
            frame, self._faults.lost_bytes = frame[: -self._faults.lost_bytes], 0
        return frame
