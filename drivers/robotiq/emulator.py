"""Emulated gripper: the model behind Modbus TCP, or RTU on a pseudo-terminal.

pymodbus parses and builds the frames, as in the driver. The register map is written twice, in
``model`` and in ``protocol``, so that tests reveal a mistake in either. A malformed frame ends a
connection. Sources: Robotiq 3-Finger manual, 2014 p. 59 (RTU) and p. 75 (TCP).
"""

import os
import select
import socket
import threading
import time
import tty
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from enum import Enum
from typing import Any, Final, Self

import msgspec
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FRAMER_NAME_TO_CLASS, FramerType
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    WriteMultipleRegistersResponse,
)

from drivers.robotiq.model.gripper import FIRST_REGISTERS, GripperModel, HandSettings
from drivers.robotiq.model.hand import WORDS

RTU_SLAVE: Final = 9  # the only slave number that gets a reply, manual p. 59
_HEADER_BYTES: Final = 7  # of a TCP frame: transaction, protocol, length and unit
_MAX_BYTES: Final = 4096
_SILENCE_S: Final = 0.05  # ends an incomplete serial frame; far above 3.5 characters
_JOIN_S: Final = 5.0

Guard = AbstractContextManager[object]  # a lock of any kind
OnFrame = Callable[[bytes], None]


class FaultKind(Enum):
    """Kind of a fault injected into a request."""

    DROP = "drop"  # executed, no reply
    DELAY = "delay"  # executed, reply ``seconds`` later
    GARBLE = "garble"  # executed, reply in a damaged frame
    SPLIT = "split"  # executed, reply one byte at a time, ``seconds`` apart
    DISCONNECT = "disconnect"  # not executed, connection closed; RTU: no reply
    EXCEPTION = "exception"  # not executed, reply is exception ``code``; RTU: no reply
    FREEZE = "freeze"  # this and all following requests wait ``seconds``, then are executed
    DEVICE_FAULT = "device_fault"  # the hand shows fault ``code`` from the next refresh on


class WireFault(msgspec.Struct, frozen=True, kw_only=True):
    """Fault to inject into the requests that meet all its conditions."""

    kind: FaultKind | None
    function: int | None = None  # requests with this function; None: all
    from_ns: int = 0  # not before this time of the emulator's clock
    skip: int = 0  # matching requests to leave unchanged first
    times: int = 1  # requests to affect after those
    seconds: float = 0.0  # of a delay or a freeze, or between bytes
    code: int = 4  # of an exception, or of a fault of the hand


_NO_FAULT: Final = WireFault(kind=None)


class WireFaults:
    """Planned faults. Any thread may add one; a request gets the first that matches."""

    def __init__(self) -> None:
        self._planned: list[tuple[WireFault, list[int]]] = []  # with remaining skip and times
        self._lock = threading.Lock()

    def add(self, fault: WireFault) -> None:
        with self._lock:
            self._planned.append((fault, [fault.skip, fault.times]))

    def take(self, function: int, now_ns: int) -> WireFault:
        """The fault to inject into this request."""
        with self._lock:
            for fault, remaining in self._planned:
                if now_ns < fault.from_ns or fault.function not in (None, function):
                    continue
                if remaining[0]:
                    remaining[0] -= 1
                    continue
                remaining[1] -= 1
                self._planned = [each for each in self._planned if each[1][1]]
                return fault
        return _NO_FAULT


class _Disconnect(Exception):
    """Closes the connection."""


class _Emulator:
    """Modbus server of a hand model; runs in threads.

    ``model``: settings of a new hand model, or a model that the caller advances. In the second case
    ``lock`` guards it and ``advance(now_ns)``, called with the lock held, advances it to a time.
    ``clock`` gives the monotonic nanoseconds of the model.
    """

    link = "tcp"
    framer = FramerType.SOCKET
    read_reply: type[ModbusPDU] = ReadInputRegistersResponse

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
        self.model = model
        self._clock = clock
        self._lock: Guard = lock if lock is not None else threading.Lock()
        self._advance = advance if advance is not None else model.advance
        self._command, self._status = FIRST_REGISTERS[self.link]
        self.faults = WireFaults()
        self.requests = 0
        self._on_frame = on_frame
        self._framer = FRAMER_NAME_TO_CLASS[self.framer](DecodePDU(True))
        self._frozen_until_s = 0.0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="gripper-emulator")

    def start(self) -> Self:
        """Start serving; returns when the port is open. Raises OSError when the port is taken."""
        self._open()
        self._thread.start()
        return self

    def stop(self) -> None:
        if self._thread.is_alive():
            self._stopping.set()
            self._shut()
            self._thread.join(_JOIN_S)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def inject_fault(self, code: int) -> None:
        """Report a fault of the hand from the next refresh on; 0 clears it."""
        with self._lock:
            self._advance(self._clock())
            self.model.inject_fault(code)

    def _open(self) -> None: ...

    def _shut(self) -> None: ...

    def _run(self) -> None: ...

    def _first_request(self, received: bytes) -> tuple[ModbusPDU | None, bytes, bytes]:
        """The first request in the bytes, its frame, and the remaining bytes."""
        used, request = self._framer.handleFrame(received, 0, 0)
        return request, received[:used], received[used:]

    def _serve(self, frame: bytes, request: ModbusPDU, send: OnFrame) -> None:
        """Execute one request and reply, with the planned fault if there is one."""
        fault = self.faults.take(request.function_code, self._clock())
        if fault.kind is FaultKind.FREEZE:
            self._frozen_until_s = time.monotonic() + fault.seconds
        while (left_s := self._frozen_until_s - time.monotonic()) > 0.0:
            if self._stopping.wait(left_s):
                return
        self.requests += 1
        self._on_frame(frame)
        if fault.kind is FaultKind.DISCONNECT:
            raise _Disconnect
        if fault.kind is FaultKind.DEVICE_FAULT:
            self.inject_fault(fault.code)
        if fault.kind is FaultKind.EXCEPTION:
            reply: ModbusPDU = ExceptionResponse(request.function_code, fault.code)
        else:
            reply = self._reply(request)
        self._send(self._frame(reply, request.dev_id, request.transaction_id), fault, send)

    def _reply(self, request: ModbusPDU) -> ModbusPDU:
        """The reply to a read (function 4, over RTU 3) or a write (16)."""
        function, count = request.function_code, request.count
        reads = function == self.read_reply.function_code
        first = request.address - (self._status if reads else self._command)
        if not reads and function != 16:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_FUNCTION)
        if not reads and not 0 < count == len(request.registers):
            return ExceptionResponse(function, ExcCodes.ILLEGAL_VALUE)
        if first < 0 or first + count > WORDS:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_ADDRESS)
        with self._lock:
            now_ns = self._clock()
            self._advance(now_ns)
            if reads:
                return self.read_reply(registers=self.model.read(now_ns)[first : first + count])
            self.model.write(first, request.registers, now_ns)
        return WriteMultipleRegistersResponse(address=request.address, count=count)

    def _frame(self, reply: ModbusPDU, dev_id: int, transaction: int) -> bytes:
        reply.dev_id, reply.transaction_id = dev_id, transaction
        return self._framer.buildFrame(reply)

    def _send(self, reply: bytes, fault: WireFault, send: OnFrame) -> None:
        if fault.kind is FaultKind.DELAY:
            later = threading.Timer(fault.seconds, send, (reply,))
            later.daemon = True
            later.start()
        elif fault.kind is FaultKind.SPLIT:
            for at in range(len(reply)):
                send(reply[at : at + 1])
                self._stopping.wait(fault.seconds)
        elif fault.kind is FaultKind.GARBLE:
            send(bytes(255 - byte for byte in reply))
        elif fault.kind is not FaultKind.DROP:
            send(reply)


class GripperEmulator(_Emulator):
    """Emulated gripper on a TCP port, 0 for a free one. It replies to every unit number, as the
    hardware does."""

    def __init__(
        self,
        model: GripperModel | HandSettings,
        host: str = "127.0.0.1",
        port: int = 0,
        **more: Any,
    ) -> None:
        """``more``: arguments of the base class."""
        super().__init__(model, **more)
        self.address = (host, port)
        self._clients: dict[socket.socket, threading.Thread] = {}

    def _open(self) -> None:
        self._listener = socket.create_server(self.address)
        self.address = self._listener.getsockname()[:2]

    def _shut(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)

    def disconnect(self) -> None:
        """Disconnect every client, as a cable that is unplugged briefly; from any thread."""
        for client in list(self._clients):
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def _run(self) -> None:
        with self._listener:
            while not self._stopping.is_set():
                with suppress(OSError):
                    client, _ = self._listener.accept()
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    thread = threading.Thread(
                        target=self._serve_client, args=(client,), daemon=True
                    )
                    self._clients[client] = thread
                    thread.start()
        self.disconnect()
        for thread in list(self._clients.values()):
            thread.join(_JOIN_S)

    def _serve_client(self, client: socket.socket) -> None:
        def send(data: bytes) -> None:
            with suppress(OSError):  # gone
                client.sendall(data)

        received = b""
        with client, suppress(OSError, _Disconnect, ModbusIOException):
            while data := client.recv(_MAX_BYTES):
                received = self._serve_all(received + data, send)
        del self._clients[client]

    def _serve_all(self, received: bytes, send: OnFrame) -> bytes:
        """Reply to every complete request; returns the remaining bytes."""
        while len(received) >= _HEADER_BYTES:
            if received[2:4] != b"\0\0":
                raise _Disconnect  # not a Modbus header, so frame boundaries are unknown
            request, frame, remaining = self._first_request(received)
            if request is None:
                break
            self._serve(frame, request, send)
            received = remaining
        return received


class RtuEmulator(_Emulator):
    """Emulated gripper on a pseudo-terminal, whose name is ``port``. It does not reply to errors
    (manual p. 59)."""

    link = "rtu"
    framer = FramerType.RTU
    read_reply = ReadHoldingRegistersResponse
    port = ""

    def _open(self) -> None:
        self._master, self._slave = os.openpty()  # keeping the slave open keeps the line open
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)

    def _run(self) -> None:
        received = b""
        while not self._stopping.is_set():
            if not select.select([self._master], [], [], _SILENCE_S)[0]:
                received = b""
                continue
            received += os.read(self._master, _MAX_BYTES)
            with suppress(ModbusIOException, _Disconnect):
                request, frame, received = self._first_request(received)
                if request is not None and request.dev_id == RTU_SLAVE:
                    self._serve(frame, request, self._write)
        os.close(self._master)
        os.close(self._slave)

    def _write(self, data: bytes) -> None:
        """Send bytes; they are lost if nobody reads them, as on a serial line."""
        with suppress(BlockingIOError):
            os.write(self._master, data)

    def _frame(self, reply: ModbusPDU, dev_id: int, transaction: int) -> bytes:
        return b"" if reply.isError() else super()._frame(reply, dev_id, transaction)
