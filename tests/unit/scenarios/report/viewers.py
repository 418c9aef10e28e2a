"""Viewers of a live page that do it no good, on bare sockets."""

import contextlib
import socket
import struct
from collections.abc import Callable
from urllib.parse import SplitResult, urlsplit

PATIENCE_S = 20.0  # for a server that starts, on a machine however busy
MANY = 40  # five times those that are let in
GIANT_BYTES = 2**40  # as a frame's head says; no byte of it follows
CLOSE_AT_ONCE = struct.pack("ii", 1, 0)


class Viewers:
    """Those of all ``kinds``, each of which comes when it is told to ``look``."""

    def __init__(self) -> None:
        self.kinds: dict[str, Callable[[SplitResult], None]] = {
            "takes nothing": self._takes_nothing,
            "is killed": self._is_killed,
            "guesses the token": self._guesses,
            "sends giant frames": self._sends_giants,
            "talks nonsense": self._talks_nonsense,
            "are many": self._are_many,
        }
        self._open: list[socket.socket] = []
        self._kind = ""
        self.answers: dict[str, set[bytes]] = {}  # first words of what the server said to each

    def look(self, kind: str, address: str) -> None:
        self._kind = kind
        self.answers[kind] = set()
        self.kinds[kind](urlsplit(address))

    def go_on(self) -> None:
        """Whoever is still connected says more, which nobody wants to hear."""
        for each in self._open:
            with contextlib.suppress(OSError):
                each.send(b"\x81\xff" + bytes(64))

    def close(self) -> None:
        for each in self._open:
            each.close()

    def _connected(self, at: SplitResult) -> socket.socket:
        assert at.hostname is not None and at.port is not None
        made = socket.create_connection((at.hostname, at.port), timeout=PATIENCE_S)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        self._open.append(made)
        return made

    def _asks(self, at: SplitResult, path: str, upgrade: str = "") -> socket.socket:
        made = self._connected(at)
        made.sendall(f"GET {path} HTTP/1.1\r\nHost: {at.netloc}\r\n{upgrade}\r\n".encode())
        self.answers[self._kind].add(made.recv(12))
        made.setblocking(False)
        return made

    def _looks(self, at: SplitResult) -> socket.socket:
        """As the page does; nothing but the first words is read."""
        upgrade = (
            f"Origin: http://{at.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        )
        return self._asks(at, f"{at.path}live", upgrade)

    def _takes_nothing(self, at: SplitResult) -> None:
        self._looks(at)

    def _is_killed(self, at: SplitResult) -> None:
        made = self._looks(at)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, CLOSE_AT_ONCE)
        made.close()

    def _guesses(self, at: SplitResult) -> None:
        for path in ("/", "/live", f"/{'x' * 22}/live", f"{at.path}../../etc/passwd"):
            self._asks(at, path)

    def _sends_giants(self, at: SplitResult) -> None:
        made = self._looks(at)
        made.send(b"\x82\xff" + struct.pack("!Q", GIANT_BYTES) + bytes(4) + bytes(60_000))

    def _are_many(self, at: SplitResult) -> None:
        for _ in range(MANY):
            self._looks(at)

    def _talks_nonsense(self, at: SplitResult) -> None:
        for words in (bytes(range(256)) * 40, b"GET / HTTP/1.1\r\nX: " + b"a" * 100_000, b""):
            made = self._connected(at)
            made.setblocking(False)
            with contextlib.suppress(OSError):
                made.send(words)
