"""A driver's link to a board model in this process: no wire, no thread, virtual time."""

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
    """A board model as ``receiver`` finds it on a bus; a transfer takes no time."""

    serial = "model"

    def __init__(self, model: BoardModel) -> None:
        """``LinkLost`` when the board is unplugged."""
        if not model.plugged:
            raise unplugged()
        self._model = model
        self._plugs = model.plugs

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            self._reach()
            return self._model.control(request, value, index, length, now_ns)
        except (Stall, Unplugged, Hung) as error:
            raise _explain(error) from error

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        try:
            self._reach()
            data = self._model.bulk_read(size, now_ns)
        except (Stall, Unplugged) as error:
            raise _explain(error) from error
        return None if data is None else Transfer(data, now_ns)

    def _reach(self) -> None:
        if self._plugs != self._model.plugs:  # found before it was plugged in again
            raise Unplugged

    def clear_halt(self) -> None:
        pass  # the model's halts last for one transfer

    def close(self) -> None:
        pass


class ModelLink:
    """A ``FrameLink`` that keeps a read pending, as ``link.thread`` does, in virtual time.

    ``advance`` is what a clock advances the world by: it brings the board and, by
    ``advance_world``, all that it senses to each instant at which a read ends, then to a time.
    """

    def __init__(
        self,
        model: BoardModel,
        settings: TakkTileSettings,
        advance_world: Callable[[int], None] = lambda now_ns: None,
        wrap: Callable[[UsbBoard], UsbBoard] = lambda usb: usb,
    ) -> None:
        """``wrap`` sees every transfer, both ways."""
        self._model = model
        self._receiver = Receiver(
            lambda serial: wrap(ModelUsb(model)), settings.conversion_ms, lambda: self._now_ns
        )
        self._advance_world = advance_world
        self._now_ns = 0
        self._asked_ns = _NEVER  # since when the read has been pending
        self._lost = False  # no board: from then on it is to be opened again

    @property
    def counts(self) -> ReceiverCounts:
        return self._receiver.counts

    @property
    def converting_ns(self) -> int:
        return self._receiver.converting_ns

    def take(self) -> Readings:
        return self._receiver.take()

    def start(self) -> Layout:
        layout = self._receiver.open()
        self._asked_ns, self._lost = self._now_ns, False
        return layout

    def stop(self) -> None:
        self._receiver.close()
        self._asked_ns = _NEVER

    def advance(self, now_ns: int) -> None:
        while (done_ns := self._done_ns()) <= now_ns:
            period_ns = self._model.free_period_ns
            if done_ns + period_ns <= now_ns and not self._lost:
                self._pass_over(done_ns + ((now_ns - done_ns) // period_ns - 1) * period_ns)
            else:
                self._receive(done_ns)
        self._world(now_ns)

    def _done_ns(self) -> int:
        """When the pending read ends, or a board that is gone is looked for again."""
        if self._lost:
            return self._asked_ns
        ready_ns = self._model.ready_ns
        if ready_ns is None:
            return self._asked_ns + _TIMEOUT_NS
        return ready_ns if ready_ns > self._asked_ns else self._asked_ns

    def _pass_over(self, done_ns: int) -> None:
        """Read what nobody will see, since a newer frame comes before anybody can take it."""
        self._world(done_ns)
        self._model.drain(done_ns)
        self._receiver.pass_over(done_ns)
        self._asked_ns = done_ns

    def _receive(self, done_ns: int) -> None:
        self._world(done_ns)
        pause_ns = self._receiver.receive()
        self._lost = pause_ns > 0
        self._asked_ns = self._now_ns + pause_ns

    def _world(self, now_ns: int) -> None:
        self._advance_world(now_ns)
        self._now_ns = max(self._now_ns, now_ns)


def _explain(error: Stall | Unplugged | Hung) -> DeviceFault | LinkLost:
    match error:
        case Stall():
            return stalled()
        case Hung():
            return hung()
    return unplugged()
