"""Sockets of the emulator: listeners, connections and their bytes; no thread of its own.

What comes is handled in the time that a cycle leaves, a piece of each client in turn. A port has so
many places (`drivers.fairness`); who finds none is closed.
"""

import contextlib
import selectors
import socket
import time
from collections.abc import Callable
from typing import Protocol

from drivers.fairness import Places
from drivers.ur.emulator.urscript.parse import MAX_CHARS, depth_change

_CHUNK = 1024  # what is taken at a time: a millisecond's work at most
_MAX_LINE = 65536
_MAX_UNSENT = 1 << 20  # a client that does not read is cut off beyond this
_BACKLOG = 128
_LEAST_S = 0.001  # of serving, however late a cycle is
_LOOK_S = 3e-4  # of sending samples, before pending requests are served


class Talk(Protocol):
    """One connection's dialogue: bytes in, bytes out."""

    @property
    def broken(self) -> bool: ...

    def feed(self, data: bytes) -> bytes: ...

    def close(self) -> None: ...


class LineTalk:
    """One answer a line."""

    def __init__(self, answer: Callable[[str], str]) -> None:
        self._answer = answer
        self._held = b""
        self.broken = False

    def feed(self, data: bytes) -> bytes:
        *lines, self._held = (self._held + data).split(b"\n")
        self.broken = len(self._held) > _MAX_LINE
        return b"".join(
            self._answer(line.decode("utf-8", "replace")).encode() + b"\n" for line in lines
        )

    def close(self) -> None: ...


class ScriptTalk:
    """Collects lines until the blocks that they opened are closed: that is one program."""

    def __init__(self, load: Callable[[str], None]) -> None:
        self._load = load
        self._held = b""
        self._program = bytearray()  # as it came: lines of their own would be thirty times as much
        self._depth = 0
        self.broken = False

    def feed(self, data: bytes) -> bytes:
        *lines, self._held = (self._held + data).split(b"\n")
        for line in lines:
            self._take(line + b"\n")
        self.broken = len(self._held) + len(self._program) > MAX_CHARS
        if self.broken:  # which is refused for its length
            self._load((self._program + self._held).decode("utf-8", "replace"))
        return b""

    def _take(self, line: bytes) -> None:
        self._program += line
        self._depth += depth_change(line.decode("utf-8", "replace"))
        if self._depth > 0:
            return
        text = self._program.decode("utf-8", "replace")
        self._program, self._depth = bytearray(), 0
        if text.strip():
            self._load(text)

    def close(self) -> None: ...


class Connection:
    """A client's socket, never blocking, and what waits to be sent to it."""

    def __init__(self, sock: socket.socket, talk: Talk, places: "Places[Connection]") -> None:
        self.sock = sock
        self.talk = talk
        self.places = places
        self.closed = False
        self._unsent = bytearray()

    def receive(self) -> bool:
        """Take and answer what has come; False when the connection is at its end."""
        try:
            data = self.sock.recv(_CHUNK)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return bool(data) and self.send(self.talk.feed(data)) and not self.talk.broken

    @property
    def deaf(self) -> bool:
        """It does not read what it is told."""
        return len(self._unsent) > _MAX_UNSENT

    def send(self, data: bytes) -> bool:
        """Send as much as the client takes; False when it is gone or does not read."""
        self._unsent += data
        try:
            while self._unsent:
                del self._unsent[: self.sock.send(self._unsent)]
        except BlockingIOError:
            return not self.deaf
        except OSError:
            return False
        return True


class Server:
    """All listeners and connections; ``serve`` handles what is ready within a time."""

    def __init__(self, refused: Callable[[str], None] = lambda why: None) -> None:
        """``refused`` is told of each client that found no place."""
        self._selector = selectors.DefaultSelector()
        self._refused = refused
        self._connections: dict[Connection, bool] = {}  # whether they are of our own channel

    def listen(
        self,
        host: str,
        port: int,
        talk: Callable[[], tuple[Talk, bytes]],
        *,
        most: int,
        ours: bool = False,
    ) -> int:
        """Returns the port; ``talk`` makes the dialogue of a new connection and its greeting. More
        than ``most`` connections are closed at once."""
        sock = socket.create_server((host, port), backlog=_BACKLOG, reuse_port=False)
        sock.setblocking(False)
        number = int(sock.getsockname()[1])
        places: Places[Connection] = Places(most)

        def accept() -> None:
            with contextlib.suppress(OSError):
                client, _ = sock.accept()
                client.setblocking(False)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                dialogue, greeting = talk()
                connection = Connection(client, dialogue, places)
                try:
                    leaves = places.enter(connection, time.monotonic())
                except OverflowError as error:
                    self._refused(f"port {number}: a client was refused, {error}")
                    dialogue.close()
                    client.close()
                    return
                if leaves is not None:
                    self._refused(f"port {number}: the client silent for longest had to leave")
                    self._keep(leaves, False)
                self._welcome(connection, greeting, ours)

        self._selector.register(sock, selectors.EVENT_READ, accept)
        return number

    def _welcome(self, connection: Connection, greeting: bytes, ours: bool) -> None:
        self._connections[connection] = ours
        self._selector.register(connection.sock, selectors.EVENT_READ, connection)
        self._keep(connection, connection.send(greeting))

    def _attend(self, connection: Connection) -> None:
        connection.places.heard(connection, time.monotonic())
        self._keep(connection, connection.receive())

    def _keep(self, connection: Connection, alive: bool) -> None:
        if alive or connection.closed:
            return
        connection.closed = True
        if connection.deaf:
            self._refused(f"a client was cut off: it has not read {_MAX_UNSENT} bytes")
        del self._connections[connection]
        connection.places.leave(connection)
        self._selector.unregister(connection.sock)
        connection.sock.close()
        connection.talk.close()

    def serve(self, seconds: float) -> None:
        """Wait up to this long for something to come, and handle it."""
        until_s = time.monotonic() + max(seconds, _LEAST_S)
        ready = self._selector.select(_whole_ms(seconds))
        if not ready and seconds > 0.0:
            time.sleep(max(0.0, min(seconds, until_s - time.monotonic())))
            ready = self._selector.select(0)
        while ready and time.monotonic() < until_s:
            self._handle([key for key, _ in ready], until_s)
            ready = self._selector.select(0)

    def _handle(self, ready: list[selectors.SelectorKey], until_s: float) -> None:
        for key in ready:
            if time.monotonic() > until_s:
                return
            if key.fileobj.fileno() == -1:  # type: ignore[union-attr] # closed by one before it
                continue
            if isinstance(key.data, Connection):
                self._attend(key.data)
            else:
                key.data()

    def talks(self) -> list[Talk]:
        """Of all clients."""
        return [connection.talk for connection in self._connections]

    def broadcast(self, sample: Callable[[Talk], bytes]) -> None:
        """Send every client its sample of this cycle, and serve requests in between."""
        looked_s = time.monotonic()
        for connection in list(self._connections):
            if time.monotonic() - looked_s > _LOOK_S:
                self.serve(0.0)
                looked_s = time.monotonic()
            if not connection.closed and (data := sample(connection.talk)):
                self._keep(connection, connection.send(data))

    def drop_links(self) -> None:
        """Close the connections of all clients but those of the control channel."""
        for connection in [one for one, ours in self._connections.items() if not ours]:
            self._keep(connection, False)

    def close(self) -> None:
        for connection in list(self._connections):
            self._keep(connection, False)
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()


def _whole_ms(seconds: float) -> float:
    """Rounded down: epoll would round up, past the end of a cycle."""
    milliseconds = int(seconds * 1e3)
    return (milliseconds - 0.5) * 1e-3 if milliseconds > 0 else 0.0
