"""Server of a board model, for the pyusb back end in ``bus``.

It emulates the board where pyusb passes a transfer to its back end, since there is no USB bus
without hardware. Everything above, pyusb included, runs as with hardware. Behaviour follows the
TakkTile-usb firmware; claims, replugs and time-outs follow libusb and Linux usbfs.
"""

import contextlib
import errno
import itertools
import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Self

import msgspec

from drivers.takktile.emulator import bus
from drivers.takktile.emulator.bus import BusReply, BusRequest, Op, backend
from drivers.takktile.model.board import BoardModel, Hung, Stall, Unplugged

__all__ = ["BoardServer", "backend"]

SERIAL = "4A453034383114003F001F"  # of an emulated board: lot, wafer and coordinates, as hex digits
_STRINGS = {1: "The Biorobotics Lab", 2: "TakkTile", bus.SERIAL_INDEX: SERIAL}
_LANGUAGES = bytes((4, 3, 0x09, 0x04))  # English only
_VENDOR_REQUEST = 0xC0  # to the host, vendor, device: every request of the board, even a command
_STANDARD_REQUEST, _GET_DESCRIPTOR, _STRING = 0x80, 6, 3
_RECHECK_S = 0.01  # interval at which a pending read checks the state of the board
_JOIN_S = 5.0
_NEVER_NS = 1 << 62


class _Failure(Exception):
    """A transfer failed with an errno."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class BoardServer:
    """Serves one board; ``start`` and ``close``, or use it as a context manager.

    ``lock`` guards the model, which other threads may advance, unplug or give faults. ``clock``
    returns the model's time; it is called with the lock held, so that it may advance the world.
    """

    def __init__(
        self,
        board: BoardModel,
        lock: AbstractContextManager[Any],
        host: str = "127.0.0.1",
        port: int = 0,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._board = board
        self._lock = lock
        self._address = host, port
        self._clock = clock
        self._listener: socket.socket | None = None
        self._connections: dict[socket.socket, threading.Thread] = {}
        self._stopping = threading.Event()
        self._acceptor = threading.Thread(target=self._accept, name="takktile-server", daemon=True)
        self._numbers = itertools.count(1)
        self._handles: dict[int, int] = {}  # ``plug_count`` of the board at opening, by handle
        self._owner: int | None = None  # handle that has claimed the interface

    @property
    def url(self) -> str:
        """URL for ``backend``; known once started."""
        if self._listener is None:
            raise RuntimeError("the board server is not running")
        host, port = self._listener.getsockname()[:2]
        return f"tcp://{host}:{port}"

    def start(self) -> Self:
        self._listener = socket.create_server(self._address)
        self._acceptor.start()
        return self

    def close(self) -> None:
        """End all connections and threads; pending transfers fail as for an unplugged board."""
        if self._listener is None:
            return
        self._stopping.set()
        _shut(self._listener)
        self._acceptor.join(_JOIN_S)
        self._listener.close()
        self._listener = None
        for connection, thread in self._connections.items():
            _shut(connection)
            thread.join(_JOIN_S)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        listener = self._listener
        while listener is not None:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            thread = threading.Thread(
                target=self._serve, args=(connection,), name="takktile-connection", daemon=True
            )
            thread.start()
            living = {c: t for c, t in self._connections.items() if t.is_alive()}
            self._connections = {**living, connection: thread}

    def _serve(self, connection: socket.socket) -> None:
        opened: list[int] = []  # handles that are closed with this connection
        try:
            while not self._stopping.is_set():
                request = bus.receive(connection, BusRequest)
                bus.send(connection, self._reply(request, connection, opened))
        except OSError:
            pass
        finally:
            with self._lock:
                for handle in opened:
                    self._close_handle(handle)
            connection.close()

    def _reply(self, r: BusRequest, connection: socket.socket, opened: list[int]) -> BusReply:
        try:
            if r.op is Op.CONTROL:
                return BusReply(0, self._control(r, connection))
            if r.op is Op.BULK_READ:
                return BusReply(0, self._bulk_read(r, connection))
            with self._lock:
                return BusReply(0, self._bus_operation(r, opened))
        except _Failure as failure:
            return BusReply(failure.code)
        except Unplugged:
            return BusReply(errno.ENODEV)
        except Stall:
            return BusReply(errno.EPIPE)

    def _bus_operation(self, r: BusRequest, opened: list[int]) -> bytes:
        """Execute an operation that needs no transfer to the board."""
        board = self._board
        if r.op is Op.LIST:
            return msgspec.msgpack.encode([board.plug_count] if board.plugged else [])
        if r.op is Op.OPEN:
            if not board.plugged or r.index != board.plug_count:
                raise Unplugged
            opened.append(next(self._numbers))
            self._handles[opened[-1]] = board.plug_count
            return msgspec.msgpack.encode(opened[-1])
        if r.op is Op.CLOSE:
            self._close_handle(r.handle)
            return b""
        self._require_present(r.handle)
        if r.op is Op.CLAIM:
            self._claim(r.handle)
        elif r.op is Op.RELEASE and self._owner == r.handle:
            self._owner = None
        elif r.op is Op.CONFIGURE and self._claimed():  # usbfs refuses it to the owner too
            raise _Failure(errno.EBUSY)
        return b""

    def _close_handle(self, handle: int) -> None:
        self._handles.pop(handle, None)
        if self._owner == handle:
            self._owner = None

    def _require_present(self, handle: int) -> None:
        """Raise ``Unplugged`` unless the board of the handle is still plugged in."""
        if not self._board.plugged or self._handles.get(handle) != self._board.plug_count:
            raise Unplugged

    def _claimed(self) -> bool:
        """Whether a client has claimed the interface; a claim ends with a replug."""
        return self._owner is not None and self._handles.get(self._owner) == self._board.plug_count

    def _claim(self, handle: int) -> None:
        if self._claimed() and self._owner != handle:
            raise _Failure(errno.EBUSY)
        self._owner = handle

    def _control(self, r: BusRequest, connection: socket.socket) -> bytes:
        try:
            with self._lock:
                self._require_present(r.handle)
                if r.request_type != _VENDOR_REQUEST:
                    return _standard_reply(r)[: r.size]
                return self._board.control(r.request, r.value, r.index, r.size, self._clock())
        except Hung:
            return self._when_ready(r, connection)  # waits for the time-out

    def _bulk_read(self, r: BusRequest, connection: socket.socket) -> bytes:
        """Data of one transfer: whole packets until a short one or the requested size."""
        with self._lock:
            self._require_present(r.handle)
            self._claim(r.handle)  # usbfs claims implicitly
        data = self._when_ready(r, connection)
        if len(data) > r.size:
            raise _Failure(errno.EOVERFLOW)
        return data

    def _when_ready(self, r: BusRequest, connection: socket.socket) -> bytes:
        whole_packets = -(-r.size // bus.PACKET_BYTES) * bus.PACKET_BYTES
        give_up_ns = 0
        while True:
            with self._lock:
                self._require_present(r.handle)
                now_ns = self._clock()
                if not give_up_ns:
                    give_up_ns = now_ns + r.timeout_ms * 1_000_000 if r.timeout_ms else _NEVER_NS
                ready_ns = self._board.ready_ns
                next_ns = give_up_ns if ready_ns is None else min(ready_ns, give_up_ns)
                data = self._board.bulk_read(whole_packets, now_ns) if now_ns >= next_ns else None
            if data is not None:
                return data
            if now_ns >= give_up_ns:
                raise _Failure(errno.ETIMEDOUT)
            _wait(connection, next_ns - now_ns)


def _standard_reply(r: BusRequest) -> bytes:
    """Reply to a standard request; only string descriptors are supported."""
    if (r.request_type, r.request, r.value >> 8) != (_STANDARD_REQUEST, _GET_DESCRIPTOR, _STRING):
        raise Stall
    index = r.value & 0xFF
    if index == 0:
        return _LANGUAGES
    if index not in _STRINGS:
        raise Stall
    units = _STRINGS[index].encode("utf-16-le")
    return bytes([2 + len(units), _STRING]) + units


def _wait(connection: socket.socket, wait_ns: int) -> None:
    """Sleep until the next check; ``OSError`` when the client disconnects."""
    wait_s = min(max(wait_ns, 0) * 1e-9, _RECHECK_S)
    readable = select.poll()
    readable.register(connection, select.POLLIN)
    whole_ms = int(wait_s * 1e3)  # poll would round up and delay the frame
    disconnected = readable.poll(whole_ms)
    time.sleep(wait_s - whole_ms * 1e-3)
    if disconnected:
        raise ConnectionAbortedError("the client has gone")


def _shut(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):  # the other side may have been first
        connection.shutdown(socket.SHUT_RDWR)
