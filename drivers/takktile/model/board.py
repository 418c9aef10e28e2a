"""What the TakkTile USB board does, at the level of USB transfers; time is an argument.

Source: TakkTile-usb firmware (main.c, TakkI2C.c). The board is host-paced: its timer interrupt
reads all cells, waits until the host has drained the frame, and only then starts the next
conversion. What a host reads was therefore converted right after its previous read.
"""

from collections.abc import Callable
from typing import Annotated

import msgspec
import numpy as np

from drivers.takktile.model import codec
from drivers.takktile.model.codec import Cell, Codes

Latched = Callable[[], tuple[Codes, Codes]]
Sample = Callable[[int], Latched]
Lie = Callable[[Codes], Codes]

# MPL115A2 coefficients of the datasheet's example; a0 is varied to tell the cells apart.
_COEFFICIENTS = bytes.fromhex("3ECEB3F9C51733C8")
_COLUMNS = 6
_ALL_CALL = (0x0C, 0x0D)
_FOR_EVER_NS = 1 << 62
_BUFFER_BYTES = 256  # the firmware indexes its calibration buffer by a byte


class Stall(Exception):
    """The endpoint answered STALL (errno 32 of a USB host)."""


class Unplugged(Exception):
    """The board is not on the bus (errno 19 of a USB host)."""


class Hung(Exception):
    """The firmware waits on its I2C bus for ever: all times out until the board is replugged."""


class BoardModelSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What differs from board to board."""

    cells: Annotated[
        tuple[Cell, ...],
        msgspec.Meta(
            min_length=1,
            description="(row, column) of the cells fitted, in row-major order; Robotiq kit: 3 x 6",
        ),
    ] = tuple((row, column) for row in range(3) for column in range(6))
    cell_read_us: Annotated[
        float,
        msgspec.Meta(
            ge=0.0, le=1000.0, description="us to read one cell by I2C; assumed, 1 MHz, 89 bits"
        ),
    ] = 100.0
    takkfast: Annotated[
        bool, msgspec.Meta(description="speak the takkfast firmware: 40-byte scan, fixed frames")
    ] = False
    hardware_version: Annotated[str, msgspec.Meta(description="string 0")] = "1.0"
    firmware_version: Annotated[str, msgspec.Meta(description="string 1, assumed")] = "model"


class _Next(msgspec.Struct):
    """What is to strike the next transfers or the next frame."""

    timeouts: int = 0
    lost_bytes: int = 0
    split: bool = False
    flip: tuple[int, int] | None = None  # byte, bit
    stall: bool = False


class BoardModel:
    """One board.

    ``sample(t_ns)`` is called when a conversion starts. What it returns gives what the cells felt
    then: pressure and temperature codes of those fitted, two (n,) int16 arrays in the order of
    ``settings.cells``. That is asked for at most once, before the next conversion starts, and
    never for a frame that nobody looks at.
    """

    def __init__(self, settings: BoardModelSettings, sample: Sample) -> None:
        self._settings = settings
        self._sample = sample
        self._read_ns = round(settings.cell_read_us * 1e3)
        self._dead: set[Cell] = set()
        self._frozen: dict[int, int] = {}  # cell index -> code
        self._lie: Lie = _truth
        self._next = _Next()
        self._ready_ns = 0
        self._pending = b""  # of a frame, what the host has not drained yet
        self._plugs = 0
        self._power_up()

    @property
    def plugged(self) -> bool:
        return self._plugged

    @property
    def plugs(self) -> int:
        """How often the board has been plugged in: what a host opened before is of no use now."""
        return self._plugs

    @property
    def ready_ns(self) -> int | None:
        """From when on a bulk read brings something; None when that takes some other event."""
        if self._next.stall:
            return 0
        if self._next.timeouts or self._hung or not self._started:
            return None
        return self._ready_ns

    @property
    def free_period_ns(self) -> int:
        """From frame to frame when each is drained at once; for ever while a fault is due."""
        if not self._started or not self._plugged or self._hung or self._pending:
            return _FOR_EVER_NS
        if self._next.stall or self._next.timeouts or self._next.split or self._next.lost_bytes:
            return _FOR_EVER_NS
        if self._next.flip is not None or self._dead:
            return _FOR_EVER_NS
        return self._period_ns

    def drain(self, now_ns: int) -> None:
        """A frame that is ready is read and thrown away."""
        self._start_conversion(now_ns)

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        """Reply to a vendor request, cut to ``length``; ``Stall`` when the request is unknown."""
        self._reach()
        if self._hung:
            raise Hung
        match request:
            case codec.GET_STRING if index in (0, 1):
                strings = (self._settings.hardware_version, self._settings.firmware_version)
                reply = strings[index].encode("ascii") + b"\0"
            case codec.CONFIGURE_TIMER:
                reply = self._configure_timer(value, index, now_ns)
            case codec.SCAN:
                reply = self._scan()
            case codec.BOTHER_ADDRESS:
                reply = self._bother(index)
            case codec.GET_CALIBRATION:
                reply = self._calibration(row=index, column=value)
            case _:
                raise Stall
        return reply[:length]

    def bulk_read(self, size: int, now_ns: int) -> bytes | None:
        """One bulk IN transfer of at most ``size`` bytes; None when it times out."""
        self._reach()
        if self._next.timeouts:
            self._next.timeouts -= 1
            return None
        if self._hung or not self._started or now_ns < self._ready_ns:
            return None
        if not self._pending:
            self._pending = self._spoil(self._frame())
            size = codec.PACKET_BYTES if self._next.split else size
            self._next.split = False
        out, self._pending = self._pending[:size], self._pending[size:]
        if not self._pending:
            self._start_conversion(now_ns)
        return out

    # Faults; those of one frame strike the next frame read.

    def kill_column(self, column: int) -> None:
        """Every cell of a column dies: the frame shrinks at once, without any notice."""
        self._dead |= {cell for cell in self._settings.cells if cell[1] == column}

    def freeze_cell(self, row: int, column: int) -> None:
        """The cell repeats its present pressure code for ever."""
        cell = self._settings.cells.index((row, column))
        self._frozen[cell] = int(self._codes()[0][cell])

    def misreport(self, lie: Lie) -> None:
        """From the next conversion on the pressure codes of all cells are what ``lie`` makes of
        them."""
        self._lie = lie

    def time_out(self, reads: int) -> None:
        """The next bulk reads bring nothing."""
        self._next.timeouts = reads

    def silence(self, until_ns: int) -> None:
        """No frame comes up to then and at that instant; what is ready waits."""
        self._ready_ns = max(self._ready_ns, until_ns + 1)

    def shorten_frame(self, lost_bytes: int) -> None:
        """The next frame lacks its last bytes."""
        self._next.lost_bytes = lost_bytes

    def split_frame(self) -> None:
        """The next frame arrives in two reads, as when the first times out half-way."""
        self._next.split = True

    def flip_bit(self, byte: int, bit: int) -> None:
        """One bit of the next frame is wrong."""
        self._next.flip = byte, bit

    def stall(self) -> None:
        """The next transfer, control or bulk, is answered with STALL."""
        self._next.stall = True

    def unplug(self) -> None:
        self._plugged = False

    def replug(self) -> None:
        """Plug the board in again: it starts anew, stopped, and without what was to strike its next
        reads."""
        self._power_up()

    def _power_up(self) -> None:
        self._plugged = True
        self._plugs += 1
        self._hung = False
        self._next = _Next()
        self._started = False
        self._period_ns = _FOR_EVER_NS  # until it is started
        self._ready_ns = 0
        self._pending = b""
        blank = np.zeros(len(self._settings.cells), np.int16)
        self._held: tuple[Codes, Codes] | None = (blank, blank)

    def _reach(self) -> None:
        if not self._plugged:
            raise Unplugged
        if self._next.stall:
            self._next.stall = False
            raise Stall

    def _alive(self) -> list[Cell]:
        return [cell for cell in self._settings.cells if cell not in self._dead]

    def _configure_timer(self, ticks: int, index: int, now_ns: int) -> bytes:
        self._pending = b""  # the firmware resets the IN pipe
        self._started = index != 0
        if self._started:
            reading_ns = self._read_ns * len(self._settings.cells)
            self._period_ns = codec.ticks_ns(ticks) + reading_ns
            self._start_conversion(now_ns)
        return bytes([self._started])

    def _scan(self) -> bytes:
        self._use_bus()
        reply = codec.chain_scan_reply if self._settings.takkfast else codec.scan_reply
        return reply(self._alive())

    def _bother(self, address: int) -> bytes:
        """Whether somebody on the I2C bus answers to an address byte: each row's ATtiny, at row
        times 16, twice the column and a low bit, and all of them at 0x0C and 0x0D. Reading from
        nobody hangs the firmware."""
        self._use_bus()
        row, column = address >> 4, address >> 1 & 7
        rows = {cell_row for cell_row, _ in self._settings.cells}
        known = address in _ALL_CALL or (row in rows and column < _COLUMNS)
        if not known and address & 1:
            self._hung = True
            raise Hung
        return bytes([known])

    def _calibration(self, row: int, column: int) -> bytes:
        """Fill the firmware's buffer as it does, byte-wide index and all, and answer from it."""
        self._use_bus()
        buffer = bytearray(_BUFFER_BYTES)
        for cell_row, cell_column in self._alive():
            at = (40 * cell_row + 8 * cell_column) % _BUFFER_BYTES
            a0 = int.from_bytes(_COEFFICIENTS[:2]) + cell_row * _COLUMNS + cell_column
            buffer[at : at + 8] = a0.to_bytes(2) + _COEFFICIENTS[2:]
        at = (40 * row + 8 * column) % _BUFFER_BYTES
        return bytes(buffer[at : at + 8])

    def _use_bus(self) -> None:
        # A scan pre-empts the sampling interrupt in the middle of its I2C transfer. That can end in
        # garbage or a hang; the model takes the worst case.
        if self._started:
            self._hung = True
            raise Hung

    def _start_conversion(self, now_ns: int) -> None:
        self._latched, self._held = self._sample(now_ns), None
        self._ready_ns = now_ns + self._period_ns

    def _codes(self) -> tuple[Codes, Codes]:
        """Of the conversion at hand."""
        if self._held is None:
            pressure, temperature = self._latched()
            if self._frozen:
                pressure = pressure.copy()
                pressure[list(self._frozen)] = list(self._frozen.values())
            self._held = self._lie(pressure), temperature
        return self._held

    def _frame(self) -> bytes:
        pressure, temperature = self._codes()
        if self._dead:
            live = [i for i, cell in enumerate(self._settings.cells) if cell not in self._dead]
            pressure, temperature = pressure[live], temperature[live]
        if self._settings.takkfast:
            return codec.chain_frame(self._alive(), pressure, temperature)
        return codec.bulk_frame(pressure, temperature)

    def _spoil(self, frame: bytes) -> bytes:
        """Apply the faults of one frame and forget them."""
        if self._next.lost_bytes:
            frame, self._next.lost_bytes = frame[: -self._next.lost_bytes], 0
        if self._next.flip is not None:
            (byte, bit), self._next.flip = self._next.flip, None
            frame = frame[:byte] + bytes([frame[byte] ^ 1 << bit]) + frame[byte + 1 :]
        return frame


def _truth(codes: Codes) -> Codes:
    return codes
