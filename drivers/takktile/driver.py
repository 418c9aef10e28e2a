"""Thread-free client of the TakkTile USB board: implements ``TactileSensor``.

The board is host-paced (see ``model``): the frame that a read brings was converted right after the
previous read, so at 100 Hz every sample is 10 ms old, and says so in ``sampled_ns``.
"""

from enum import Enum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.interfaces import FINGER_NAMES, FINGERS, TAXELS, TactileFrame
from drivers.takktile import protocol
from drivers.takktile.model import BoardModel, Hung, Stall, Unplugged
from drivers.takktile.protocol import Layout, Request
from drivers.takktile.settings import TakkTileSettings

Codes = NDArray[np.int16]  # (3, 6): finger, taxel

_DRAIN_READS = 8  # more than a stopped board can still have in its pipe
_RESYNC_READS = 4  # the longest frame is five packets
_START = 0xFF


class Link(Protocol):
    """The two USB transfers that the driver needs.

    They raise ``LinkLost`` when the board is unplugged or hung and ``DeviceFault`` on STALL.
    """

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes: ...

    def bulk_read(self, size: int, now_ns: int) -> bytes | None:
        """One transfer; None when it timed out without a byte."""
        ...


class Missed(Enum):
    """Why a tick brought no sample."""

    TIMEOUT = "timeouts"
    WRONG_LENGTH = "wrong_lengths"
    IMPLAUSIBLE = "implausible"
    TOO_OLD = "too_old"


class TakkTileStatistics(msgspec.Struct, frozen=True):
    """Reads since the driver was made, by outcome."""

    frames: int
    timeouts: int
    wrong_lengths: int
    implausible: int  # a padding bit was set
    too_old: int  # converted longer ago than max_age_ms: nobody had read for a while


class ModelLink:
    """A ``Link`` to a board model in this process."""

    def __init__(self, model: BoardModel) -> None:
        self._model = model

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            return self._model.control(request, value, index, length, now_ns)
        except (Stall, Unplugged, Hung) as error:
            raise _explain(error) from error

    def bulk_read(self, size: int, now_ns: int) -> bytes | None:
        try:
            return self._model.bulk_read(size, now_ns)
        except (Stall, Unplugged) as error:
            raise _explain(error) from error


class TakkTileDriver:
    """Fingertips on one board. Call ``open`` once, then ``pump`` every 10 ms."""

    def __init__(self, link: Link, settings: TakkTileSettings) -> None:
        self._link = link
        self._settings = settings
        self._max_age_ns = round(settings.max_age_ms * 1e6)
        self._frame_bytes: int | None = None  # None until the board has been opened
        self._cells = 0
        self._order = np.zeros((FINGERS, TAXELS), np.intp)  # place in the frame of each taxel
        self._converted_ns = 0
        self._frame: TactileFrame | None = None
        self._latest_raw: Codes | None = None
        self._rest: Codes | None = None
        self._resting: list[Codes] | None = None  # samples so far, while rest is being taken
        self._rest_begun_ns = 0  # the last read before
        self._seq = 0
        self._frames = 0
        self._missed = dict.fromkeys(Missed, 0)

    @property
    def frame(self) -> TactileFrame | None:
        return self._frame

    @property
    def latest_raw(self) -> Codes | None:
        """(3, 6) int16 codes of the last good sample, rest or not; None before the first one."""
        return self._latest_raw

    @property
    def rest_taken(self) -> bool:
        return self._rest is not None

    @property
    def statistics(self) -> TakkTileStatistics:
        missed = {cause.value: count for cause, count in self._missed.items()}
        return TakkTileStatistics(frames=self._frames, **missed)

    def open(self, now_ns: int) -> None:
        """Stop, drain, scan, check the map, start; forgets rest counts, also on re-opening.

        A board that some earlier program left running must be stopped first: a scan would disturb
        its sampling on the I2C bus, and the pipe may hold an old frame.
        """
        self.close(now_ns)
        self._drain(now_ns)
        reply = self._link.control(Request.SCAN, 0, 0, protocol.SCAN_BYTES, now_ns)
        layout = protocol.parse_scan(reply)
        if layout is None:
            raise DeviceFault(
                f"the tactile board answered a scan with {len(reply)} bytes instead of 8 or 40",
                "update the board's firmware, or check that this is a TakkTile USB board",
            )
        self._order = _frame_order(layout, self._settings)
        ticks = protocol.timer_ticks(self._settings.conversion_ms)
        if self._link.control(Request.TIMER, ticks, _START, 1, now_ns) != b"\x01":
            raise DeviceFault("the tactile board did not start sampling", "replug it, open again")
        self._cells = layout.frame_cells
        self._frame_bytes = layout.frame_bytes
        self._converted_ns = now_ns

    def close(self, now_ns: int) -> None:
        """Stop sampling; ``open`` starts it again."""
        self._frame_bytes = None
        self._forget_rest()
        self._link.control(Request.TIMER, 0, 0, 1, now_ns)

    def begin_rest(self) -> None:
        self._forget_rest()
        self._resting = []
        self._rest_begun_ns = self._converted_ns

    def pump(self, now_ns: int) -> None:
        """Read one sample; a missed one repeats the last frame.

        Raises ``LinkLost`` when the board is gone, ``DeviceFault`` when it stalls and ``Refused``
        when the sample completes rest counts that cannot be right.
        """
        result = self._read(now_ns)
        self._seq += 1
        if isinstance(result, Missed):
            self._missed[result] += 1
            self._repeat(now_ns)
            return
        pressure, temperature, sampled_ns = result
        self._frames += 1
        raw = pressure[self._order]
        raw.flags.writeable = False
        self._latest_raw = raw
        # The first sample after begin_rest was converted before it: the hand may still have moved.
        if self._resting is not None and sampled_ns > self._rest_begun_ns:
            self._take_rest(raw, self._resting)
        if self._rest is not None:
            counts, temperatures = raw - self._rest, temperature[self._order]
            counts.flags.writeable = temperatures.flags.writeable = False
            self._frame = TactileFrame(
                now_ns, sampled_ns, self._seq, counts, raw, self._rest, temperatures
            )

    def _read(self, now_ns: int) -> tuple[Codes, Codes, int] | Missed:
        """Pressure and temperature codes (cells,) in frame order, and when they were converted."""
        if self._frame_bytes is None:
            raise Refused("the tactile board is not open", "call open() before pump()")
        data = self._link.bulk_read(protocol.READ_BYTES, now_ns)
        if data is None:
            return Missed.TIMEOUT
        # Draining a frame, good or bad, is what makes the board convert the next one.
        sampled_ns, self._converted_ns = self._converted_ns, now_ns
        if len(data) != self._frame_bytes:
            self._resync(data, now_ns)
            return Missed.WRONG_LENGTH
        if now_ns - sampled_ns > self._max_age_ns:
            return Missed.TOO_OLD
        codes = protocol.parse_frame(data, self._cells)
        return Missed.IMPLAUSIBLE if codes is None else (*codes, sampled_ns)

    def _resync(self, data: bytes, now_ns: int) -> None:
        """Read away the rest of a frame cut off between packets, up to its short packet.

        Otherwise the next read would start in the middle of this frame, and so on for ever.
        """
        part: bytes | None = data
        for _ in range(_RESYNC_READS):
            if not part or len(part) % protocol.PACKET_BYTES:
                return
            part = self._link.bulk_read(protocol.READ_BYTES, now_ns)

    def _drain(self, now_ns: int) -> None:
        for _ in range(_DRAIN_READS):
            if self._link.bulk_read(protocol.READ_BYTES, now_ns) is None:
                return
        raise DeviceFault("the tactile board keeps sending after a stop", "replug it, open again")

    def _repeat(self, now_ns: int) -> None:
        if self._frame is None:
            return
        missed = self._frame.missed + 1
        self._frame = msgspec.structs.replace(
            self._frame,
            t_ns=now_ns,
            seq=self._seq,
            missed=missed,
            stale=missed >= self._settings.stale_after_missed,
        )

    def _forget_rest(self) -> None:
        self._rest = self._resting = self._frame = None

    def _take_rest(self, raw: Codes, samples: list[Codes]) -> None:
        samples.append(raw)
        if len(samples) < self._settings.rest_samples:
            return
        self._resting = None
        taken = np.stack(samples)
        rest = np.rint(np.median(taken, axis=0)).astype(np.int16)
        _check_rest(rest, taken.std(axis=0), self._settings)
        rest.flags.writeable = False
        self._rest = rest


def _explain(error: Stall | Unplugged | Hung) -> DeviceFault | LinkLost:
    match error:
        case Stall():
            return DeviceFault(
                "the tactile board refused a USB transfer (STALL)",
                "open it again; if that fails, update its firmware",
            )
        case Hung():
            return LinkLost(
                "the tactile board hangs: its firmware waits on the sensor bus for ever",
                "unplug the board, plug it in again, open it again",
            )
    return LinkLost("the tactile board is unplugged", "check its USB cable, then open it again")


def _frame_order(layout: Layout, settings: TakkTileSettings) -> NDArray[np.intp]:
    """(3, 6) place in the frame of each taxel; ``DeviceFault`` when a mapped cell is not alive."""
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
    """Raise ``Refused``, naming the worst taxel, when the fingertips cannot have been at rest."""
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
            abs(shift) - s.rest_reference_tolerance_counts,
            shift,
            "rests {:+d} counts from rest_reference, "
            f"more than {s.rest_reference_tolerance_counts:g}",
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
