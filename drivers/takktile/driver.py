"""Driver core of the fingertips: ``TactileSensor`` on any ``FrameLink``; no thread.

The board is host-paced: it converts after each read, so a read every 10 ms would return frames 10
ms old. Every link therefore keeps a read pending, and ``poll`` takes the newest frame received.
"""

from types import TracebackType
from typing import Protocol, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, Refused, on_failure
from drivers.interfaces import FINGER_NAMES, FINGERS, TactileFrame
from drivers.takktile.protocol import Layout
from drivers.takktile.receiver import Codes, Reading, Receiver
from drivers.takktile.settings import (
    REST_REFERENCE_TOLERANCE_COUNTS,
    REST_SAMPLES,
    TakkTileSettings,
)


def _frame_order(layout: Layout, settings: TakkTileSettings) -> NDArray[np.intp]:
    """(3, taxels) places of the taxels in a frame; ``DeviceFault`` when a mapped cell is dead."""
    place = dict(zip(layout.alive, layout.places, strict=True))
    for finger, cells in zip(FINGER_NAMES, settings.cells, strict=True):
        for taxel, cell in enumerate(cells):
            if cell not in place:
                raise DeviceFault(
                    f"finger {finger} taxel {taxel} (row {cell[0]}, column {cell[1]}) does not "
                    f"answer; {len(place)} cells do",
                    f"check the cable of finger {finger}, or correct `cells` in the settings",
                )
    return np.array([[place[cell] for cell in cells] for cells in settings.cells], np.intp)


def _check_rest(rest: Codes, std: NDArray[np.float64], settings: TakkTileSettings) -> None:
    """Raise ``Refused``, naming the worst taxel, when rest counts are implausible."""
    s = settings
    _refuse_worst(
        std - s.rest_max_std_counts,
        std,
        f"is unsteady at rest: std {{:.1f}} counts, above {s.rest_max_std_counts}",
        "keep the hand still and untouched, or raise rest_max_std_counts",
    )
    _refuse_worst(
        np.maximum(s.rest_min_counts - rest, rest - s.rest_max_counts),
        rest,
        f"rests at code {{}}, outside {s.rest_min_counts}..{s.rest_max_counts}",
        "open the hand so that nothing touches it, or adjust rest_min_counts and rest_max_counts",
    )
    if s.rest_reference is not None:
        shift = rest - np.array(s.rest_reference)
        _refuse_worst(
            abs(shift) - REST_REFERENCE_TOLERANCE_COUNTS,
            shift,
            "rests {:+d} counts from rest_reference, "
            f"more than {REST_REFERENCE_TOLERANCE_COUNTS:g}",
            "open the hand so that nothing touches it, or renew rest_reference",
        )


def _refuse_worst(
    excess: NDArray[np.generic], values: NDArray[np.generic], what: str, remedy: str
) -> None:
    worst = np.unravel_index(np.argmax(excess), excess.shape)
    if excess[worst] > 0:
        finger, taxel = worst
        raise Refused(
            f"finger {FINGER_NAMES[finger]} taxel {taxel} {what.format(values[worst])}",
            f"{remedy}; then take the rest again",
        )


class FrameLink(Protocol):
    """Source of a board's frames: ``ReadingThread`` in wall time, ``ModelLink`` in virtual time."""

    @property
    def receiver(self) -> Receiver: ...

    def start(self) -> Layout:
        """Find and open the board and start reading; raises ``LinkLost`` or ``DeviceFault``."""
        ...

    def stop(self) -> None:
        """Stop reading and stop the board; safe to call twice."""
        ...


class TakkTileDriver:
    """Fingertips on one board; ``start`` and ``stop``, or use it as a context manager.

    Call ``poll`` every 10 ms.
    """

    def __init__(self, link: FrameLink, settings: TakkTileSettings) -> None:
        self.frame: TactileFrame | None = None
        # (3, taxels) codes of the last good sample, also before rest; None before that
        self.latest_raw: Codes | None = None
        self._link, self._receiver, self._settings = link, link.receiver, settings
        self.statistics = link.receiver.statistics
        self._max_age_ns = round(settings.max_age_ms * 1e6)
        self._cells = 0
        self._order = np.zeros((FINGERS, settings.taxels), np.intp)  # of taxels in the bulk frame
        self._opens = 0
        self._rest: Codes | None = None
        self._rest_samples: list[Codes] | None = None  # while rest is being taken
        self._rest_start_ns = 0
        self._seq = 0

    def start(self) -> Self:
        """Open the board, check the taxel map, start reading; raises ``LinkLost`` or
        ``DeviceFault``."""
        layout = self._link.start()
        self._opens = self._receiver.take().opens
        with on_failure(self._link.stop):
            self._order = _frame_order(layout, self._settings)
        self._cells = layout.frame_cells
        return self

    def stop(self) -> None:
        """Stop the board; safe to call twice."""
        self._link.stop()
        self._clear_rest()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self.stop()

    @property
    def rest_taken(self) -> bool:
        return self._rest is not None

    def begin_rest(self) -> None:
        self._clear_rest()
        self._rest_samples = []
        self._rest_start_ns = self._receiver.next_sample_ns

    def poll(self, now_ns: int) -> None:
        """Take the newest sample; a tick without one repeats the last frame.

        Raises ``LinkLost`` or ``DeviceFault`` while the board is being recovered, and ``Refused``
        when the sample completes implausible rest counts. After the board has been reopened there
        is no frame until the rest has been taken again.
        """
        batch = self._receiver.take()
        if batch.opens != self._opens:
            self._opens = batch.opens
            self._clear_rest()
        self._seq += 1
        readings = batch.readings
        self.statistics.decimated += len(readings[1:])
        self.statistics.empty_ticks += not readings
        if not readings or not self._use(readings[-1], now_ns):
            self._repeat_frame(now_ns)
        if batch.error is not None:
            raise type(batch.error)(batch.error.message, batch.error.remedy)

    def _use(self, reading: Reading, now_ns: int) -> bool:
        """Make the frame of a sample; returns whether it can be used."""
        if now_ns - reading.sampled_ns > self._max_age_ns:
            self.statistics.too_old += 1
            return False
        codes = reading.codes(self._cells)
        if codes is None:
            self.statistics.implausible += 1
            return False
        raw, temperature = codes[0].take(self._order), codes[1].take(self._order)
        raw.setflags(write=False)
        temperature.setflags(write=False)
        self.statistics.frames += 1
        self.latest_raw = raw
        # A conversion that began before begin_rest may have measured a moving hand.
        if self._rest_samples is not None and reading.sampled_ns > self._rest_start_ns:
            self._take_rest(raw, self._rest_samples)
        if self._rest is not None:
            counts = raw - self._rest
            counts.setflags(write=False)
            self.frame = TactileFrame(
                now_ns, reading.sampled_ns, self._seq, counts, raw, self._rest, temperature
            )
        return True

    def _repeat_frame(self, now_ns: int) -> None:
        if self.frame is None:
            return
        missed = self.frame.missed + 1
        self.frame = msgspec.structs.replace(
            self.frame,
            t_ns=now_ns,
            seq=self._seq,
            missed=missed,
            stale=missed >= self._settings.stale_after_missed,
        )

    def _clear_rest(self) -> None:
        self._rest = self._rest_samples = self.frame = None

    def _take_rest(self, raw: Codes, samples: list[Codes]) -> None:
        samples.append(raw)
        if len(samples) < REST_SAMPLES:
            return
        self._rest_samples = None
        taken = np.stack(samples)
        rest = np.rint(np.median(taken, axis=0)).astype(np.int16)
        _check_rest(rest, taken.std(axis=0), self._settings)
        rest.setflags(write=False)
        self._rest = rest
