"""Identification of the pressed taxel, to find the undocumented wiring of a kit."""

import time
from collections.abc import Callable, Generator, Iterator

import msgspec
import numpy as np

from drivers.errors import DeviceFault
from drivers.interfaces import FINGER_NAMES
from drivers.takktile.protocol import Cell, Layout
from drivers.takktile.receiver import Codes, Receiver, UsbBoard
from drivers.takktile.settings import TakkTileSettings

REST_FRAMES = 50
_FIRST_FRAMES_S = 5.0


class TaxelPress(msgspec.Struct, frozen=True):
    """The cell with the largest fall below its rest code; finger and taxel by
    ``settings.cells``."""

    row: int
    column: int
    fall_counts: int
    finger: str | None  # None: no finger has this cell
    taxel: int | None


def watch(
    link: UsbBoard,
    settings: TakkTileSettings,
    seconds: float,
    on_rest: Callable[[], None],
    least_fall_counts: int,
    clock: Callable[[], int] = time.monotonic_ns,
) -> Generator[TaxelPress, None, None]:
    """Take the rest, call ``on_rest``, then yield each press that is stronger than the one before.
    A press is a fall of a code by ``least_fall_counts`` or more, of any live cell, mapped or not.
    Ends after ``seconds``; always stops and closes the board.
    """
    receiver = Receiver(lambda serial: link, settings.conversion_ms, clock)
    layout = receiver.open()
    try:
        if not layout.alive:
            raise DeviceFault(
                "not one cell of the tactile board answers", "check the fingers' cables"
            )
        places = _places(layout, settings)
        frames = _frames(receiver, layout, clock() + round(_FIRST_FRAMES_S * 1e9), clock)
        samples = [pressure for pressure, _ in zip(frames, range(REST_FRAMES), strict=False)]
        if len(samples) < REST_FRAMES:
            raise DeviceFault("the tactile board sends no frames", "unplug it, plug it in again")
        rest = np.median(samples, axis=0).astype(np.int16)
        on_rest()
        strongest = least_fall_counts - 1
        last: Cell | None = None
        for pressure in _frames(receiver, layout, clock() + round(seconds * 1e9), clock):
            falls = (rest - pressure)[list(layout.places)]
            worst = int(np.argmax(falls))
            cell, fall = layout.alive[worst], int(falls[worst])
            if fall < least_fall_counts:
                strongest, last = least_fall_counts - 1, None  # released
            elif cell != last or fall > strongest:
                strongest, last = fall, cell
                yield TaxelPress(*cell, fall, *places.get(cell, (None, None)))
    finally:
        receiver.close()


def _places(layout: Layout, settings: TakkTileSettings) -> dict[Cell, tuple[str, int]]:
    return {
        cell: (finger, taxel)
        for finger, cells in zip(FINGER_NAMES, settings.cells, strict=True)
        for taxel, cell in enumerate(cells)
    }


def _frames(
    receiver: Receiver, layout: Layout, until_ns: int, clock: Callable[[], int]
) -> Iterator[Codes]:
    """(cells,) pressure codes of each frame until a time, in frame order."""
    while clock() < until_ns:
        receiver.receive()
        batch = receiver.take()
        if batch.error is not None:
            raise batch.error
        for reading in batch.readings:
            codes = reading.codes(layout.frame_cells)
            if codes is not None:
                yield codes[0]
