"""Link of a driver to a board model in this process, in virtual time.

Frames pass as codes, which saves time, as long as nothing can distinguish codes from bytes: no
wrapper intercepts the transfers, and no fault is pending.
"""

from collections.abc import Callable

from drivers.errors import DeviceFault, LinkLost
from drivers.takktile.model.board import BoardModel, Hung, Stall, Unplugged
from drivers.takktile.protocol import Layout
from drivers.takktile.receiver import (
    READ_TIMEOUT_MS,
    Receiver,
    Transfer,
    UsbBoard,
    hung,
    stalled,
    unplugged,
)
from drivers.takktile.settings import TakkTileSettings

_NEVER = 1 << 62
_TIMEOUT_NS = READ_TIMEOUT_MS * 1_000_000


class ModelUsb:
    """``UsbBoard`` on a board model; a transfer takes no time."""

    serial = "model"

    def __init__(self, model: BoardModel) -> None:
        """Open the board; ``LinkLost`` when it is unplugged."""
        if not model.plugged:
            raise unplugged()
        self._model = model
        self._plug_count = model.plug_count

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            self._require_present()
            return self._model.control(request, value, index, length, now_ns)
        except (Stall, Unplugged, Hung) as error:
            raise _explain(error) from error

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        try:
            self._require_present()
            data = self._model.bulk_read(size, now_ns)
        except (Stall, Unplugged) as error:
            raise _explain(error) from error
        return None if data is None else Transfer(data, now_ns)

    def _require_present(self) -> None:
        if self._plug_count != self._model.plug_count:  # opened before it was plugged in again
            raise Unplugged

    def clear_halt(self) -> None:
        pass  # the model's halts last for one transfer

    def close(self) -> None:
        pass


class ModelLink:
    """``FrameLink`` in virtual time that keeps a read pending, as ``ReadingThread`` does.

    A virtual clock calls ``advance``. It advances the board and, through ``advance_world``, the
    simulated world to each time at which a read ends, and then to the given time.
    """

    def __init__(
        self,
        model: BoardModel,
        settings: TakkTileSettings,
        advance_world: Callable[[int], None] = lambda now_ns: None,
        wrap: Callable[[UsbBoard], UsbBoard] | None = None,
    ) -> None:
        """``wrap`` wraps the board, to intercept transfers."""
        self._model = model
        self._wrapped = wrap is not None

        def connect(serial: str | None) -> UsbBoard:
            usb = ModelUsb(model)
            return usb if wrap is None else wrap(usb)

        self.receiver = Receiver(connect, settings.conversion_ms, lambda: self._now_ns)
        self._advance_world = advance_world
        self._now_ns = 0
        self._read_start_ns = _NEVER  # start of the pending read, or of the attempt to reopen

    def start(self) -> Layout:
        layout = self.receiver.open()
        self._read_start_ns = self._now_ns
        return layout

    def stop(self) -> None:
        self.receiver.close()
        self._read_start_ns = _NEVER

    def advance(self, now_ns: int) -> None:
        while (done_ns := self._done_ns()) <= now_ns:
            period_ns = self._model.free_period_ns
            if self.receiver.is_open and period_ns is not None:
                done_ns = self._skip_frames(done_ns, period_ns, now_ns)
                if not self._wrapped:
                    self._advance_world(done_ns)
                    self.receiver.accept(self._model.codes(), done_ns)
                    self._model.start_conversion(done_ns)
                    self._read_start_ns = done_ns
                    break  # the next frame comes after now
            self._receive(done_ns)
        self._advance_world(now_ns)
        self._now_ns = now_ns

    def _done_ns(self) -> int:
        """Time at which the pending read ends, or at which to try to reopen the board."""
        if not self.receiver.is_open:
            return self._read_start_ns
        ready_ns = self._model.ready_ns
        if ready_ns is None:
            return self._read_start_ns + _TIMEOUT_NS
        return ready_ns if ready_ns > self._read_start_ns else self._read_start_ns

    def _skip_frames(self, done_ns: int, period_ns: int, now_ns: int) -> int:
        """Skip all frames but the newest up to now, since the driver uses no other; they come every
        period from ``done_ns`` on. Returns the time of the newest."""
        newer = (now_ns - done_ns) // period_ns
        if newer == 0:
            return done_ns
        skipped_ns = done_ns + (newer - 1) * period_ns
        self._advance_world(skipped_ns)
        self._model.start_conversion(skipped_ns)
        self.receiver.conversion_start_ns = skipped_ns
        return skipped_ns + period_ns

    def _receive(self, done_ns: int) -> None:
        self._advance_world(done_ns)
        self._now_ns = max(self._now_ns, done_ns)
        pause_ns = self.receiver.receive()
        self._read_start_ns = self._now_ns + pause_ns


def _explain(error: Stall | Unplugged | Hung) -> DeviceFault | LinkLost:
    match error:
        case Stall():
            return stalled()
        case Hung():
            return hung()
    return unplugged()
