"""Link of a driver to a board model in this process, in virtual time."""

from collections.abc import Callable

from drivers.errors import DeviceFault, LinkLost
from drivers.takktile.board import READ_TIMEOUT_MS, Transfer, hung, stalled, unplugged
from drivers.takktile.model.board import BoardModel, Hung, Stall, Unplugged
from drivers.takktile.protocol import Layout
from drivers.takktile.receiver import Readings, Receiver, ReceiverCounts, UsbBoard
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
        wrap: Callable[[UsbBoard], UsbBoard] = lambda usb: usb,
    ) -> None:
        """``wrap`` may wrap the board, to intercept transfers."""
        self._model = model
        self._receiver = Receiver(
            lambda serial: wrap(ModelUsb(model)), settings.conversion_ms, lambda: self._now_ns
        )
        self._advance_world = advance_world
        self._now_ns = 0
        self._read_start_ns = _NEVER  # start of the pending read
        self._lost = False  # the board is gone: the next attempt to reopen is at that time

    @property
    def counts(self) -> ReceiverCounts:
        return self._receiver.counts

    @property
    def next_sample_ns(self) -> int:
        return self._receiver.next_sample_ns

    def take(self) -> Readings:
        return self._receiver.take()

    def start(self) -> Layout:
        layout = self._receiver.open()
        self._read_start_ns, self._lost = self._now_ns, False
        return layout

    def stop(self) -> None:
        self._receiver.close()
        self._read_start_ns = _NEVER

    def advance(self, now_ns: int) -> None:
        while (done_ns := self._done_ns()) <= now_ns:
            period_ns = self._model.free_period_ns
            if done_ns + period_ns <= now_ns and not self._lost:
                self._skip_frames(done_ns + ((now_ns - done_ns) // period_ns - 1) * period_ns)
            else:
                self._receive(done_ns)
        self._advance_to(now_ns)

    def _done_ns(self) -> int:
        """Time at which the pending read ends, or at which to try to reopen the board."""
        if self._lost:
            return self._read_start_ns
        ready_ns = self._model.ready_ns
        if ready_ns is None:
            return self._read_start_ns + _TIMEOUT_NS
        return ready_ns if ready_ns > self._read_start_ns else self._read_start_ns

    def _skip_frames(self, done_ns: int) -> None:
        """Skip frames up to a time, since a newer one comes before the next poll."""
        self._advance_to(done_ns)
        self._model.drain(done_ns)
        self._receiver.skip_frame(done_ns)
        self._read_start_ns = done_ns

    def _receive(self, done_ns: int) -> None:
        self._advance_to(done_ns)
        pause_ns = self._receiver.receive()
        self._lost = pause_ns > 0
        self._read_start_ns = self._now_ns + pause_ns

    def _advance_to(self, now_ns: int) -> None:
        self._advance_world(now_ns)
        self._now_ns = max(self._now_ns, now_ns)


def _explain(error: Stall | Unplugged | Hung) -> DeviceFault | LinkLost:
    match error:
        case Stall():
            return stalled()
        case Hung():
            return hung()
    return unplugged()
