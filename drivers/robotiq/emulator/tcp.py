"""A gripper on Modbus TCP: the model behind a real socket, with framing of its own.

Every unit number is answered and echoed, as the hardware does. Requests that arrive together are
all answered, in order, two of a client before others have their turn. A header that is none
(another protocol, an absurd length) closes its connection and no other. A client for whom there is
no place is closed.
"""

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Final, Self

from drivers.fairness import Places
from drivers.robotiq.emulator.pdu import (
    Guard,
    Hand,
    TcpGripper,
    Trouble,
    Unanswerable,
    WireFault,
    WireFaults,
    damaged,
)
from drivers.robotiq.model.gripper import GripperModel, HandSettings

__all__ = ["GripperEmulator", "Hand", "Trouble", "WireFault", "WireFaults"]

_HEADER: Final = 7  # transaction, protocol, length, unit
_LONGEST: Final = 254  # unit and request
_CLIENTS: Final = 16
_AT_ONCE: Final = 2  # requests of one client, before others have their turn
_UNREAD: Final = 65536  # bytes of replies that a client may leave lying
_KEEP_UP_S: Final = 0.01
_JOIN_S: Final = 5.0
_TURNS: Final = 4  # of the loop, more than it takes to end an aborted connection

OnFrame = Callable[[bytes], None]


def compile_motors() -> None:
    """Have the compiled motor functions ready before a client waits for a reply."""
    model = GripperModel(HandSettings(command_latency_s=0.0), 0, active=True)
    model.write(0, (0x0900, 9), 0)  # activated, go to: all fingers to count 9
    model.advance(100_000_000)


def hand_of(
    model: GripperModel | HandSettings,
    clock: Callable[[], int],
    lock: Guard | None = None,
    advance: Callable[[int], None] | None = None,
) -> Hand:
    """A hand made of settings powers up now, on its own; a model belongs to whoever gives it."""
    compile_motors()
    if isinstance(model, HandSettings):
        model = GripperModel(model, clock())
    return Hand(model, clock, lock, advance)


class _Connection(asyncio.Protocol):
    """One client: cuts the stream into requests, hands each on, sends what comes back."""

    def __init__(self, server: "GripperEmulator") -> None:
        self._server = server
        self._received = bytearray()
        self._transport: asyncio.Transport | None = None
        self._later: asyncio.TimerHandle | None = None  # work that waits

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if isinstance(transport, asyncio.Transport):
            self._transport = transport
            self._server.joined(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        if self._later is not None:
            self._later.cancel()
        self._server.left(self)

    def abort(self) -> None:
        """End; nothing is written or carried out any more."""
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        self._received += data
        if self._later is None:
            self._work()

    def _work(self) -> None:
        self._later = None
        for _ in range(_AT_ONCE):
            frozen_s = self._server.frozen_for_s()
            if frozen_s > 0:
                self._work_in(frozen_s)
                return
            frame = self._next_frame()
            if frame is None:
                break
            if not self._server.serve(frame, self):
                self._received[:0] = frame
        if frame is not None:
            self._work_in(0.0)

    def _work_in(self, seconds: float) -> None:
        """Go on then; up to then the client's bytes wait in its socket."""
        transport = self._transport
        if transport is None:
            return
        transport.pause_reading()
        self._later = asyncio.get_running_loop().call_later(seconds, self._go_on, transport)

    def _go_on(self, transport: asyncio.Transport) -> None:
        if self._transport is transport:
            transport.resume_reading()
            self._work()

    def _next_frame(self) -> bytes | None:
        """One whole request, or None where there is none yet; closes on what is no request."""
        received = self._received
        if self._transport is None or len(received) < _HEADER:
            return None
        protocol = int.from_bytes(received[2:4], "big")
        length = int.from_bytes(received[4:6], "big")
        if protocol != 0 or not 2 <= length <= _LONGEST:
            self.abort()
            return None
        if len(received) < 6 + length:
            return None
        frame = bytes(received[: 6 + length])
        del received[: 6 + length]
        return frame

    def send(self, data: bytes) -> None:
        transport = self._transport
        if transport is None:
            return
        transport.write(data)
        if transport.is_closing() or transport.get_write_buffer_size() > _UNREAD:
            self.abort()


class GripperEmulator:
    """Serves a hand on a port. ``with`` runs it in a thread, ``async with`` in the running loop.

    ``model`` may be settings of a hand of its own, or a model that somebody else moves on: then
    ``lock`` guards it and ``advance(now_ns)``, called with the lock held, brings it to a time.
    ``clock`` gives the monotonic nanoseconds of the model. Port 0 takes a free one.
    """

    def __init__(
        self,
        model: GripperModel | HandSettings,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        lock: Guard | None = None,
        advance: Callable[[int], None] | None = None,
        on_frame: OnFrame | None = None,
    ) -> None:
        self.hand = hand_of(model, clock, lock, advance)
        self.faults = WireFaults()
        self.address = (host, port)
        self.requests = 0
        self._gripper = TcpGripper(self.hand)
        self._on_frame = on_frame
        self._connections: set[_Connection] = set()
        self._places: Places[_Connection] = Places(_CLIENTS)
        self._frozen_until_s = 0.0
        self._listener: socket.socket | None = None
        self._keeper: asyncio.Task[None] | None = None
        self._joining: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

    # Life in a loop

    async def __aenter__(self) -> Self:
        listener = socket.create_server(self.address)
        listener.setblocking(False)
        host, port = listener.getsockname()[:2]
        self.address = (host, port)
        self._listener = listener
        asyncio.get_running_loop().add_reader(listener, self._accept, listener)
        self._keeper = asyncio.create_task(self._keep_up())
        return self

    async def __aexit__(self, *_: object) -> None:
        listener, keeper = self._listener, self._keeper
        self._listener = self._keeper = None
        if listener is None or keeper is None:
            return
        asyncio.get_running_loop().remove_reader(listener)
        listener.close()
        keeper.cancel()
        await asyncio.gather(keeper, *self._joining, return_exceptions=True)
        for _turn in range(_TURNS):
            self._abort_all()
            await asyncio.sleep(0)

    def _accept(self, listener: socket.socket) -> None:
        # asyncio.Server loses a client that it accepts while it closes (CPython 3.11)
        with suppress(OSError):
            client, _ = listener.accept()
            joining = asyncio.create_task(self._join(client))
            self._joining.add(joining)
            joining.add_done_callback(self._joining.discard)

    async def _join(self, client: socket.socket) -> None:
        client.setblocking(False)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD)  # not megabytes
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: _Connection(self), client)

    async def _keep_up(self) -> None:
        while True:
            self.hand.keep_up()
            await asyncio.sleep(_KEEP_UP_S)

    # Life in a thread

    def start(self) -> Self:
        """Serve in a thread; returns when the port is open. Raises OSError when it is taken."""
        loop = asyncio.new_event_loop()
        self._loop = loop
        self._thread = threading.Thread(target=loop.run_forever, name="gripper-emulator")
        self._thread.start()
        try:
            self._in_loop(self.__aenter__())
        except BaseException:
            self._end_loop()
            raise
        return self

    def stop(self) -> None:
        """Close the port and every connection, end the thread."""
        if self._loop is None:
            return
        try:
            self._in_loop(self.__aexit__(None, None, None))
        finally:
            self._end_loop()

    def _in_loop(self, work: Coroutine[Any, Any, object]) -> None:
        if self._loop is not None:
            asyncio.run_coroutine_threadsafe(work, self._loop).result(_JOIN_S)

    def _end_loop(self) -> None:
        loop, thread = self._loop, self._thread
        self._loop = self._thread = None
        if loop is not None and thread is not None:
            loop.call_soon_threadsafe(loop.stop)
            thread.join(_JOIN_S)
            loop.close()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def disconnect(self) -> None:
        """Drop every client, as a pulled plug that is put back at once; from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._abort_all)
        else:
            self._abort_all()

    def _abort_all(self) -> None:
        for connection in list(self._connections):
            connection.abort()

    # What connections ask for

    def joined(self, connection: _Connection) -> None:
        """Take in a client, or turn it away when there are too many."""
        try:
            leaves = self._places.enter(connection, time.monotonic())
        except OverflowError:
            connection.abort()
            return
        if leaves is not None:
            leaves.abort()
        self._connections.add(connection)

    def left(self, connection: _Connection) -> None:
        self._connections.discard(connection)
        self._places.leave(connection)

    def frozen_for_s(self) -> float:
        """How long nothing will be carried out."""
        return self._frozen_until_s - time.monotonic()

    def serve(self, frame: bytes, connection: _Connection) -> bool:
        """Carry out one request and answer it; False: it has to wait for the end of a freeze."""
        self._places.heard(connection, time.monotonic())
        fault = self.faults.take(frame[_HEADER], self.hand.clock())
        trouble = fault.trouble if fault is not None else None
        if fault is not None and trouble is Trouble.FREEZE:
            self._frozen_until_s = time.monotonic() + fault.seconds
            return False
        self.requests += 1
        if self._on_frame is not None:
            self._on_frame(frame)
        if fault is None:
            connection.send(self._reply(frame))
        elif trouble is Trouble.DISCONNECT:
            connection.abort()
        elif trouble is Trouble.EXCEPTION:
            connection.send(_exception(frame, fault.code))
        else:
            self._hit(frame, fault, connection)
        return True

    def _hit(self, frame: bytes, fault: WireFault, connection: _Connection) -> None:
        """Troubles of a request that is carried out all the same."""
        if fault.trouble is Trouble.DEVICE_FAULT:
            self.hand.inject_fault(fault.code)
        reply = self._reply(frame)
        loop = asyncio.get_running_loop()
        if fault.trouble is Trouble.DELAY:
            loop.call_later(fault.seconds, connection.send, reply)
        elif fault.trouble is Trouble.GARBLE:
            connection.send(damaged(reply))
        elif fault.trouble is Trouble.SPLIT:
            for at in range(len(reply)):
                loop.call_later(at * fault.seconds, connection.send, reply[at : at + 1])
        elif fault.trouble is Trouble.DEVICE_FAULT:
            connection.send(reply)

    def _reply(self, frame: bytes) -> bytes:
        try:
            answer = self._gripper.answer(frame[_HEADER:])
        except Unanswerable as why:
            return _exception(frame, why.code)
        return frame[:4] + (len(answer) + 1).to_bytes(2, "big") + frame[6:7] + answer


def _exception(frame: bytes, code: int) -> bytes:
    return frame[:4] + bytes([0, 3, frame[6], frame[_HEADER] | 0x80, code])
