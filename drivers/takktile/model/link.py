"""A driver's link to a board model in this process: no wire, no thread, virtual time."""

from collections.abc import Callable

from drivers.errors import DeviceFault, LinkLost
from drivers.takktile.board import Transfer
from drivers.takktile.link import trouble
from drivers.takktile.model.board import BoardModel, Hung, Stall, Unplugged
from drivers.takktile.protocol import Layout
from drivers.takktile.receiver import Readings, Receiver, ReceiverCounts
from drivers.takktile.settings import TakkTileSettings


class ModelUsb:
    """A board model as ``receiver`` finds it on a bus; a transfer takes no time."""

    serial = "model"

    def __init__(self, model: BoardModel) -> None:
        """``LinkLost`` when the board is unplugged."""
        if not model.plugged:
            raise trouble.unplugged()
        self._model = model

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            return self._model.control(request, value, index, length, now_ns)
        except (Stall, Unplugged, Hung) as error:
            raise _explain(error) from error

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        try:
            data = self._model.bulk_read(size, now_ns)
        except (Stall, Unplugged) as error:
            raise _explain(error) from error
        return None if data is None else Transfer(data, now_ns)

    def clear_halt(self) -> None:
        pass  # the model's halts last for one transfer

    def close(self) -> None:
        pass


class ModelLink:
    """A ``FrameLink`` that reads the board whenever it is asked for frames.

    ``advance`` brings the link and, by ``advance_world``, all that the board senses to a time.
    """

    def __init__(
        self,
        model: BoardModel,
        settings: TakkTileSettings,
        advance_world: Callable[[int], None] = lambda now_ns: None,
    ) -> None:
        self._receiver = Receiver(
            lambda serial: ModelUsb(model), settings.conversion_ms, 0, lambda: self._now_ns
        )
        self._advance_world = advance_world
        self._now_ns, self._next_ns = 0, 1

    @property
    def counts(self) -> ReceiverCounts:
        return self._receiver.counts

    @property
    def converting_ns(self) -> int:
        return self._receiver.converting_ns

    def start(self) -> Layout:
        return self._receiver.open()

    def stop(self) -> None:
        self._receiver.close()

    def advance(self, now_ns: int) -> None:
        self._advance_world(now_ns)
        self._now_ns = now_ns

    def take(self) -> Readings:
        if self._now_ns >= self._next_ns:
            self._next_ns = self._now_ns + max(1, self._receiver.receive())
        return self._receiver.take()


def _explain(error: Stall | Unplugged | Hung) -> DeviceFault | LinkLost:
    match error:
        case Stall():
            return trouble.stalled()
        case Hung():
            return LinkLost(trouble.HUNG, trouble.HUNG_REMEDY)
    return trouble.unplugged()
