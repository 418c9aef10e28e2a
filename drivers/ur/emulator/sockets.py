"""Sockets of the emulator: listeners, connections and their bytes; no thread of its own."""

import contextlib
import selectors
import socket
from collections.abc import Callable
from typing import Protocol

from drivers.ur.emulator.rtde import RtdeConnection
from drivers.ur.emulator.urscript.parse import MAX_CHARS, depth_change

_CHUNK = 65536
_MAX_LINE = 65536
_MAX_UNSENT = 1 << 20  # a client that does not read is cut off beyond this


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
        self._program: list[str] = []
        self._chars = 0
        self._depth = 0
        self.broken = False

    def feed(self, data: bytes) -> bytes:
        *lines, self._held = (self._held + data).split(b"\n")
        for line in lines:
            self._take(line.decode("utf-8", "replace") + "\n")
        self.broken = len(self._held) + self._chars > MAX_CHARS
        return b""

    def _take(self, line: str) -> None:
        self._program.append(line)
        self._chars += len(line)
        self._depth += depth_change(line)
        if self._depth > 0:
            return
        text = "".join(self._program)
        self._program, self._chars, self._depth = [], 0, 0
        if text.strip():
            self._load(text)

    def close(self) -> None: ...


class Connection:
    """A client's socket, never blocking, and what waits to be sent to it."""

    def __init__(self, sock: socket.socket, talk: Talk, *, ours: bool) -> None:
        self.sock = sock
        self.talk = talk
        self.ours = ours
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

    def send(self, data: bytes) -> bool:
        """Send as much as the client takes; False when it is gone or does not read."""
        self._unsent += data
        try:
            while self._unsent:
                del self._unsent[: self.sock.send(self._unsent)]
        except BlockingIOError:
            return len(self._unsent) <= _MAX_UNSENT
        except OSError:
            return False
        return True


class Server:
    """All listeners and connections; ``serve`` handles what is ready within a time."""

    def __init__(self) -> None:
        # select() takes microseconds; epoll would round up to whole milliseconds
        self._selector = selectors.SelectSelector()
        self._connections: list[Connection] = []

    def listen(
        self, host: str, port: int, talk: Callable[[], tuple[Talk, bytes]], *, ours: bool = False
    ) -> int:
        """Returns the port; ``talk`` makes the dialogue of a new connection and its greeting."""
        sock = socket.create_server((host, port), backlog=16, reuse_port=False)
        sock.setblocking(False)

        def accept() -> None:
            with contextlib.suppress(OSError):
                client, _ = sock.accept()
                self._welcome(client, *talk(), ours)

        self._selector.register(sock, selectors.EVENT_READ, accept)
        return int(sock.getsockname()[1])

    def _welcome(self, client: socket.socket, talk: Talk, greeting: bytes, ours: bool) -> None:
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = Connection(client, talk, ours=ours)
        self._connections.append(connection)
        self._selector.register(
            client, selectors.EVENT_READ, lambda: self._keep(connection, connection.receive())
        )
        self._keep(connection, connection.send(greeting))

    def _keep(self, connection: Connection, alive: bool) -> None:
        if not alive and connection in self._connections:
            self._connections.remove(connection)
            self._selector.unregister(connection.sock)
            connection.sock.close()
            connection.talk.close()

    def serve(self, seconds: float) -> None:
        """Wait up to this long for something to come, and handle it."""
        for key, _ in self._selector.select(max(0.0, seconds)):
            key.data()

    def broadcast(self, sample: Callable[[RtdeConnection], bytes]) -> None:
        """Send every RTDE client its data packet of this cycle."""
        for connection in list(self._connections):
            if isinstance(connection.talk, RtdeConnection):
                data = sample(connection.talk)
                self._keep(connection, not data or connection.send(data))

    def drop_links(self) -> None:
        """Close the connections of all clients but those of the control channel."""
        for connection in [one for one in self._connections if not one.ours]:
            self._keep(connection, False)

    def close(self) -> None:
        for connection in list(self._connections):
            self._keep(connection, False)
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()
