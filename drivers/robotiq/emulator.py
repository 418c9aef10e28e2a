"""The emulated gripper: the model behind Modbus TCP, or RTU on a pseudo-terminal.

Frames are cut and built by pymodbus, as in the driver; what registers mean is written twice, here
in ``model`` and there in ``protocol``, so that a mistake of one cannot hide in the other. Sources:
Robotiq 3-Finger manual, 2014 p. 59 (RTU) and p. 75 (TCP).
"""

import asyncio
import os
import socket
import threading
import time
import tty
from collections.abc import Callable, Coroutine
from contextlib import AbstractContextManager, suppress
from enum import Enum
from typing import Any, Final, Self

import msgspec
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FRAMER_NAME_TO_CLASS, FramerType
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU

from drivers.robotiq.model.gripper import FIRST_REGISTERS, GripperModel, HandSettings
from drivers.robotiq.model.hand import WORDS

SLAVE: Final = 9  # the one number that is answered over RTU, manual p. 59
_FUNCTION_AT: Final = 7  # in a TCP frame, after transaction, protocol, length and unit
_MOST_BYTES: Final = 4096
_SILENCE_S: Final = 0.05  # ends a serial frame that is not whole; far above 3.5 characters
_JOIN_S: Final = 5.0

Guard = AbstractContextManager[object]  # a lock of any kind
OnFrame = Callable[[bytes], None]


class Trouble(Enum):
    """What happens to a request that is hit."""

    DROP = "drop"  # carried out, never answered
    DELAY = "delay"  # carried out, answered ``seconds`` later
    GARBLE = "garble"  # carried out, answered with a damaged frame
    SPLIT = "split"  # answered one byte at a time, ``seconds`` apart
    DISCONNECT = "disconnect"  # connection closed instead; RTU: not carried out, no answer
    EXCEPTION = "exception"  # not carried out, answered with exception ``code``; RTU: no answer
    FREEZE = "freeze"  # this and all that follow wait ``seconds``, then are carried out
    DEVICE_FAULT = "device_fault"  # the hand shows fault ``code`` from the next refresh on


class WireFault(msgspec.Struct, frozen=True, kw_only=True):
    """One planned trouble: it hits requests that meet all its conditions."""

    trouble: Trouble
    function: int | None = None  # requests with this function; None: all
    from_ns: int = 0  # not before this time of the emulator's clock
    skip: int = 0  # spare so many requests first
    times: int = 1  # then hit so many
    seconds: float = 0.0  # of a delay or a freeze, or between bytes
    code: int = 4  # of an exception, or of a fault of the hand


class WireFaults:
    """The plan. Any thread may add to it; a request takes the first fault that hits it."""

    def __init__(self) -> None:
        self._planned: list[tuple[WireFault, list[int]]] = []  # with what is left to skip and hit
        self._lock = threading.Lock()

    def add(self, fault: WireFault) -> None:
        with self._lock:
            self._planned.append((fault, [fault.skip, fault.times]))

    def take(self, function: int, now_ns: int) -> WireFault | None:
        """The fault that hits a request, if any."""
        with self._lock:
            for fault, left in self._planned:
                if now_ns < fault.from_ns or fault.function not in (None, function):
                    continue
                if left[0]:
                    left[0] -= 1
                    continue
                left[1] -= 1
                self._planned = [each for each in self._planned if each[1][1]]
                return fault
        return None


class Hand:
    """A model and its time, shared with whoever else moves it; pymodbus reads and writes it.

    ``advance(now_ns)`` brings the model, and what it touches, to a time; it is called with the
    lock held.
    """

    def __init__(
        self,
        model: GripperModel,
        link: str,
        clock: Callable[[], int],
        lock: Guard | None,
        advance: Callable[[int], None] | None,
    ) -> None:
        self.model = model
        self.clock = clock
        self._lock: Guard = lock if lock is not None else threading.Lock()
        self._advance = advance if advance is not None else model.advance
        self._command, self._status = FIRST_REGISTERS[link]
        self._functions = {"tcp": (4, 16), "rtu": (3, 16)}[link]

    def inject_fault(self, code: int) -> None:
        """Show a fault from the next refresh on; 0 takes it back."""
        with self._lock:
            self._advance(self.clock())
            self.model.inject_fault(code)

    async def answer(self, request: ModbusPDU) -> ModbusPDU:
        """The reply. pymodbus has checked the counts, and asks below for the registers."""
        reply: ModbusPDU = ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_FUNCTION)
        if request.function_code in self._functions:
            reply = await request.datastore_update(self, request.dev_id)  # type: ignore[arg-type]
        reply.dev_id, reply.transaction_id = request.dev_id, request.transaction_id
        return reply

    async def async_getValues(
        self, dev_id: int, function: int, address: int, count: int
    ) -> list[int] | ExcCodes:
        first = address - self._status
        if first < 0 or first + count > WORDS:
            return ExcCodes.ILLEGAL_ADDRESS
        with self._lock:
            now_ns = self.clock()
            self._advance(now_ns)
            return list(self.model.read(now_ns)[first : first + count])

    async def async_setValues(
        self, dev_id: int, function: int, address: int, values: list[int]
    ) -> ExcCodes | None:
        first = address - self._command
        if first < 0 or first + len(values) > WORDS:
            return ExcCodes.ILLEGAL_ADDRESS
        with self._lock:
            now_ns = self.clock()
            self._advance(now_ns)
            self.model.write(first, values, now_ns)
        return None


class _Line:
    """One connection, or the serial line: cuts bytes into requests, answers one after the other."""

    def __init__(self, hand: Hand, framer: FramerType, send: Callable[[bytes], object]) -> None:
        self._hand = hand
        self._framer = FRAMER_NAME_TO_CLASS[framer](DecodePDU(True))
        self.send = send
        self.received = b""

    def next_request(self) -> tuple[bytes, ModbusPDU] | None:
        """A whole request and its bytes; None where there is none yet. Raises ModbusIOException
        for one that is malformed."""
        used, request = self._framer.handleFrame(self.received, 0, 0)
        frame, self.received = self.received[:used], self.received[used:]
        return None if request is None else (frame, request)

    async def reply(self, request: ModbusPDU) -> bytes:
        return self._framer.buildFrame(await self._hand.answer(request))

    def refuse(self, function: int, code: int, dev_id: int, transaction: int) -> None:
        self.send(self._framer.buildFrame(ExceptionResponse(function, code, dev_id, transaction)))


class _Disconnect(Exception):
    """The connection is to be closed."""


class _Emulator:
    """A hand behind a wire, served by a loop in a thread of its own.

    ``model`` may be settings of a hand of its own, or a model that somebody else moves on: then
    ``lock`` guards it and ``advance(now_ns)``, called with the lock held, brings it to a time.
    ``clock`` gives the monotonic nanoseconds of the model.
    """

    link = "tcp"

    def __init__(
        self,
        model: GripperModel | HandSettings,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        lock: Guard | None = None,
        advance: Callable[[int], None] | None = None,
        on_frame: OnFrame = lambda frame: None,
    ) -> None:
        if isinstance(model, HandSettings):
            model = GripperModel(model, clock())
        self.hand = Hand(model, self.link, clock, lock, advance)
        self.faults = WireFaults()
        self.requests = 0
        self._on_frame = on_frame
        self._frozen_until_s = 0.0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

    def start(self) -> Self:
        """Returns when the wire is open. Raises OSError when the port is taken."""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="gripper-emulator")
        self._thread.start()
        try:
            self._in_loop(self._open())
        except BaseException:
            self._end_loop()
            raise
        return self

    def stop(self) -> None:
        if self._loop is not None:
            try:
                self._in_loop(self._close())
            finally:
                self._end_loop()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    async def _open(self) -> None:
        raise NotImplementedError

    async def _close(self) -> None:
        raise NotImplementedError

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

    async def _serve(self, frame: bytes, request: ModbusPDU, line: _Line) -> None:
        """Carry out one request and answer it, or do what is planned instead."""
        fault = self.faults.take(request.function_code, self.hand.clock())
        trouble = None if fault is None else fault.trouble
        seconds = 0.0 if fault is None else fault.seconds
        if trouble is Trouble.FREEZE:
            self._frozen_until_s = time.monotonic() + seconds
        while (left_s := self._frozen_until_s - time.monotonic()) > 0.0:
            await asyncio.sleep(left_s)
        self.requests += 1
        self._on_frame(frame)
        if trouble is Trouble.DISCONNECT:
            raise _Disconnect
        if fault is not None and trouble is Trouble.EXCEPTION:
            ids = request.dev_id, request.transaction_id
            line.refuse(request.function_code, fault.code, *ids)
            return
        if fault is not None and trouble is Trouble.DEVICE_FAULT:
            self.hand.inject_fault(fault.code)
        reply = await line.reply(request)
        if trouble is Trouble.DELAY:
            asyncio.get_running_loop().call_later(seconds, line.send, reply)
        elif trouble is Trouble.SPLIT:
            for at in range(len(reply)):
                line.send(reply[at : at + 1])
                await asyncio.sleep(seconds)
        elif trouble is Trouble.GARBLE:
            line.send(bytes(255 - byte for byte in reply))
        elif trouble is not Trouble.DROP:
            line.send(reply)


class GripperEmulator(_Emulator):
    """On a TCP port, 0 for a free one. Every unit number is answered, as the hardware does."""

    def __init__(
        self,
        model: GripperModel | HandSettings,
        host: str = "127.0.0.1",
        port: int = 0,
        **more: Any,
    ) -> None:
        """``more``: the arguments of every emulator."""
        super().__init__(model, **more)
        self.address = (host, port)
        self._clients: set[asyncio.Task[None]] = set()

    async def _open(self) -> None:
        self._listener = socket.create_server(self.address)
        self._listener.setblocking(False)
        self.address = self._listener.getsockname()[:2]
        asyncio.get_running_loop().add_reader(self._listener, self._accept)

    async def _close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._listener)
        self._listener.close()
        self._drop_all()
        await asyncio.gather(*self._clients, return_exceptions=True)

    def disconnect(self) -> None:
        """Drop every client, as a pulled plug that is put back at once; from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._drop_all)

    def _drop_all(self) -> None:
        for client in self._clients:
            client.cancel()

    def _accept(self) -> None:
        # by hand: asyncio loses a client that it accepts while the server closes (CPython 3.11)
        with suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            task = asyncio.create_task(self._talk(client))
            self._clients.add(task)
            task.add_done_callback(self._clients.discard)
            task.add_done_callback(lambda _: client.close())

    async def _talk(self, client: socket.socket) -> None:
        def send(data: bytes) -> None:
            with suppress(OSError):  # gone, or reads nothing: a reply is lost
                client.send(data)

        line = _Line(self.hand, FramerType.SOCKET, send)
        with suppress(_Disconnect, OSError):
            while data := await asyncio.get_running_loop().sock_recv(client, _MOST_BYTES):
                line.received += data
                await self._serve_all(line)

    async def _serve_all(self, line: _Line) -> None:
        while len(line.received) > _FUNCTION_AT:
            if line.received[2:4] != b"\0\0":
                raise _Disconnect  # no header of Modbus: what follows cannot be told apart
            try:
                found = line.next_request()
            except ModbusIOException as error:
                function, line.received = line.received[_FUNCTION_AT], b""
                code = ExcCodes.ILLEGAL_VALUE if function in (4, 16) else ExcCodes.ILLEGAL_FUNCTION
                line.refuse(function, code, error.dev_id, error.transaction_id)
                return
            if found is None:
                return
            await self._serve(*found, line)


class RtuEmulator(_Emulator):
    """On a pseudo-terminal whose name is ``port``. Errors are answered by silence, manual p. 59."""

    link = "rtu"
    port = ""

    async def _open(self) -> None:
        self._master, self._slave = os.openpty()  # our end of the slave keeps the line open
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._line = _Line(self.hand, FramerType.RTU, self._send)
        self._heard_s = 0.0
        self._waiting: asyncio.Queue[tuple[bytes, ModbusPDU]] = asyncio.Queue()
        asyncio.get_running_loop().add_reader(self._master, self._receive)
        self._working = asyncio.create_task(self._work())

    async def _close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._master)
        self._working.cancel()
        await asyncio.gather(self._working, return_exceptions=True)
        os.close(self._master)
        os.close(self._slave)

    def _receive(self) -> None:
        now_s = time.monotonic()
        if now_s - self._heard_s > _SILENCE_S:
            self._line.received = b""
        self._heard_s = now_s
        self._line.received += os.read(self._master, _MOST_BYTES)
        with suppress(ModbusIOException):
            found = self._line.next_request()
            if found is not None and found[1].dev_id == SLAVE:
                self._waiting.put_nowait(found)

    async def _work(self) -> None:
        while True:
            with suppress(_Disconnect):
                await self._serve(*await self._waiting.get(), self._line)

    def _send(self, data: bytes) -> None:
        """What nobody reads is lost, as on a line; an exception is none of this hand's replies."""
        if not (len(data) > 1 and data[1] & 0x80):
            with suppress(BlockingIOError):
                os.write(self._master, data)
