"""A board model behind USB transfers: a loopback server, and the pyusb back end that talks to it.

There is no USB bus without hardware, so the seam is the one where pyusb hands a transfer to its
back end: everything above it, pyusb included, is what a lab runs. Source of the behaviour: the
TakkTile-usb firmware; libusb and Linux usbfs for what a host says to claims, replugs, time-outs.
A connection for which there is no place is closed.
"""

import contextlib
import errno
import secrets
import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Self

from drivers.fairness import Places
from drivers.takktile.emulator import descriptors, hop
from drivers.takktile.emulator.bus import backend
from drivers.takktile.emulator.hop import HopReply, HopRequest, Op
from drivers.takktile.model.board import BoardModel, Hung, Stall, Unplugged

__all__ = ["BoardServer", "backend"]

_LOOK_AGAIN_S = 0.01  # while a read is pending: whether the board was unplugged or started
_JOIN_S = 5.0
_CLIENTS = 32
_OPENED = 16  # handles of one connection


class _Failure(Exception):
    """A transfer failed with an errno."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class BoardServer:
    """Serves one board; ``start`` and ``close``, or use it as a context manager.

    ``lock`` guards the model, which others may advance, unplug or spoil meanwhile; ``clock`` gives
    the model's time and is asked with the lock held, so that a cell may advance its world first.
    """

    def __init__(
        self,
        board: BoardModel,
        lock: AbstractContextManager[Any],
        host: str = "127.0.0.1",
        port: int = 0,
        clock: Callable[[], int] = time.monotonic_ns,
        serial: str = descriptors.SERIAL,
    ) -> None:
        self._board = board
        self._lock = lock
        self._address = host, port
        self._clock = clock
        self._serial = serial
        self._listener: socket.socket | None = None
        self._connections: dict[socket.socket, threading.Thread] = {}  # until the next comes
        self._crowd = threading.Lock()  # guards the next
        self._places: Places[socket.socket] = Places(_CLIENTS)
        self._ending = threading.Event()
        self._acceptor = threading.Thread(target=self._accept, name="takktile-server", daemon=True)
        self._handles: dict[int, int] = {}  # handle -> ``plugs`` of the board when it was opened
        self._owner: int | None = None  # handle that has claimed the interface

    @property
    def url(self) -> str:
        """Where to point ``backend``; known once started."""
        if self._listener is None:
            raise RuntimeError("the board server is not running")
        host, port = self._listener.getsockname()[:2]
        return f"tcp://{host}:{port}"

    def start(self) -> Self:
        self._listener = socket.create_server(self._address)
        self._acceptor.start()
        return self

    def close(self) -> None:
        """End every connection and thread; pending transfers fail as if the board were gone."""
        if self._listener is None:
            return
        self._ending.set()
        _shut(self._listener)
        self._acceptor.join(_JOIN_S)
        self._listener.close()
        self._listener = None
        for connection, thread in self._connections.items():
            _shut(connection)
            thread.join(_JOIN_S)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self.close()

    def _accept(self) -> None:
        listener = self._listener
        while listener is not None:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if not self._enter(connection):
                connection.close()
                continue
            thread = threading.Thread(
                target=self._serve, args=(connection,), name="takktile-connection", daemon=True
            )
            thread.start()
            living = {c: t for c, t in self._connections.items() if t.is_alive()}
            self._connections = {**living, connection: thread}

    def _enter(self, connection: socket.socket) -> bool:
        """Give a place to a newcomer; False when there is none."""
        with self._crowd:
            try:
                leaves = self._places.enter(connection, time.monotonic())
            except OverflowError:
                return False
        if leaves is not None:
            _shut(leaves)
        return True

    def _serve(self, connection: socket.socket) -> None:
        opened: list[int] = []  # handles, which end with this connection
        try:
            while not self._ending.is_set():
                request = hop.receive(connection, HopRequest)
                hop.send(connection, self._answer(request, connection, opened))
                with self._crowd:
                    self._places.heard(connection, time.monotonic())
        except OSError:
            pass
        finally:
            with self._lock:
                for handle in opened:
                    self._forget(handle)
            with self._crowd:
                self._places.leave(connection)
            connection.close()

    def _answer(self, r: HopRequest, connection: socket.socket, opened: list[int]) -> HopReply:
        try:
            match r.op:
                case Op.OPEN:
                    if len(opened) >= _OPENED:
                        return HopReply(errno.EMFILE)
                    opened.append(self._open(r.index))
                    return HopReply(0, hop.encode(opened[-1]))
                case Op.CONTROL:
                    return HopReply(0, self._control(r, connection))
                case Op.BULK_READ:
                    return HopReply(0, self._bulk_read(r, connection))
                case Op.BULK_WRITE:
                    self._bulk_write(r, connection)
            with self._lock:
                return HopReply(0, self._manage(r))
        except _Failure as failure:
            return HopReply(failure.code)
        except Unplugged:
            return HopReply(errno.ENODEV)
        except Stall:
            return HopReply(errno.EPIPE)

    def _open(self, plugs: int) -> int:
        with self._lock:
            if not self._board.plugged or plugs != self._board.plugs:
                raise _Failure(errno.ENODEV)
            handle = secrets.randbelow(1 << 31)  # nobody guesses another's
            self._handles[handle] = plugs
            return handle

    def _manage(self, r: HopRequest) -> bytes:
        """What needs no transfer to the board."""
        if r.op is Op.LIST:
            return hop.encode(self._listed())
        if r.op is Op.CLOSE:
            self._forget(r.handle)
            return b""
        self._reach(r.handle)
        match r.op:
            case Op.CLAIM:
                self._claim(r.handle, r.index)
            case Op.RELEASE:
                self._release(r.handle)
            case Op.SET_CONFIGURATION:
                self._configure(r.value)
            case Op.SET_ALTSETTING if (r.index, r.value) != (0, 0):
                raise _Failure(errno.ENOENT)
            case Op.CLEAR_HALT if r.request_type not in (
                descriptors.ENDPOINT_IN,
                descriptors.ENDPOINT_OUT,
            ):
                raise _Failure(errno.ENOENT)
        return b""  # a reset, like a cleared halt, leaves the firmware as it was

    def _listed(self) -> list[hop.Listed]:
        if not self._board.plugged:
            return []
        return [hop.Listed(self._board.plugs, descriptors.DEVICE, descriptors.CONFIG)]

    def _forget(self, handle: int) -> None:
        self._handles.pop(handle, None)
        if self._owner == handle:
            self._owner = None

    def _reach(self, handle: int) -> None:
        """Fail unless the board that the handle was opened on is still plugged in."""
        if not self._board.plugged or self._handles.get(handle) != self._board.plugs:
            raise _Failure(errno.ENODEV)

    def _claimed(self) -> bool:
        """Whether somebody holds the interface: a claim does not outlive a replug."""
        return self._owner is not None and self._handles.get(self._owner) == self._board.plugs

    def _claim(self, handle: int, interface: int) -> None:
        if interface != 0:
            raise _Failure(errno.ENOENT)
        if self._claimed() and self._owner != handle:
            raise _Failure(errno.EBUSY)
        self._owner = handle

    def _release(self, handle: int) -> None:
        if self._owner != handle:
            raise _Failure(errno.ENOENT)
        self._owner = None

    def _configure(self, value: int) -> None:
        if value not in (0, descriptors.CONFIGURATION):
            raise _Failure(errno.ENOENT)
        if self._claimed():  # usbfs refuses it to the owner too
            raise _Failure(errno.EBUSY)

    def _control(self, r: HopRequest, connection: socket.socket) -> bytes:
        if r.request_type != descriptors.VENDOR_REQUEST:
            with self._lock:
                self._reach(r.handle)
            reply = descriptors.answer(r.request_type, r.request, r.value, self._serial)
            if reply is None:
                raise _Failure(errno.EPIPE)
            return reply[: r.size]
        try:
            with self._lock:
                self._reach(r.handle)
                return self._board.control(r.request, r.value, r.index, r.size, self._clock())
        except Hung:
            self._time_out(r, connection)
            raise _Failure(errno.ETIMEDOUT) from None

    def _bulk_read(self, r: HopRequest, connection: socket.socket) -> bytes:
        """One pending read: blocks until the board has a frame or the time-out has passed."""
        if r.request_type != descriptors.ENDPOINT_IN:
            raise _Failure(errno.ENOENT)
        whole_packets = -(-r.size // descriptors.PACKET_BYTES) * descriptors.PACKET_BYTES
        give_up_ns = self._give_up_ns(r)
        while True:
            with self._lock:
                self._reach(r.handle)
                self._claim(r.handle, 0)  # usbfs claims for whoever forgot to
                now_ns = self._clock()
                next_ns = give_up_ns
                if (ready_ns := self._board.ready_ns) is not None:
                    next_ns = min(ready_ns, give_up_ns)
                data = self._board.bulk_read(whole_packets, now_ns) if now_ns >= next_ns else None
            if data is not None:
                if len(data) > r.size:
                    raise _Failure(errno.EOVERFLOW)
                return data
            if now_ns >= give_up_ns:
                raise _Failure(errno.ETIMEDOUT)
            _wait(connection, next_ns - now_ns)

    def _bulk_write(self, r: HopRequest, connection: socket.socket) -> None:
        """The firmware never takes anything: the write is not acknowledged until it times out."""
        with self._lock:
            self._reach(r.handle)
            self._claim(r.handle, 0)
        self._time_out(r, connection)
        raise _Failure(errno.ETIMEDOUT)

    def _time_out(self, r: HopRequest, connection: socket.socket) -> None:
        give_up_ns = self._give_up_ns(r)
        while True:
            with self._lock:
                self._reach(r.handle)
                now_ns = self._clock()
            if now_ns >= give_up_ns:
                return
            _wait(connection, give_up_ns - now_ns)

    def _give_up_ns(self, r: HopRequest) -> int:
        with self._lock:
            return self._clock() + r.timeout_ms * 1_000_000 if r.timeout_ms else 1 << 62


def _wait(connection: socket.socket, wait_ns: int) -> None:
    """Sleep, but not past the next look; ``OSError`` when the client goes away meanwhile."""
    wait_s = min(max(wait_ns, 0) * 1e-9, _LOOK_AGAIN_S)
    readable = select.poll()
    readable.register(connection, select.POLLIN)
    whole_ms = int(wait_s * 1e3)  # poll would round up, and the frame be late
    spoke = readable.poll(whole_ms)
    time.sleep(wait_s - whole_ms * 1e-3)
    if spoke:
        raise ConnectionAbortedError("the client has gone")


def _shut(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):  # the other side may have been first
        connection.shutdown(socket.SHUT_RDWR)
