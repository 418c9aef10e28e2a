"""The cell's control channel: JSON lines on a loopback port. Ours alone, never part of a driver.

A request is an object with a ``verb``; the reply is an object, with ``error`` when it was refused.
Where the cell is not on loopback alone, a request needs the cell's ``token``.
"""

import contextlib
import json
import secrets
import socket
import socketserver
import threading
import time
from collections.abc import Callable
from typing import Any, Self

import msgspec

from drivers.errors import LinkLost
from drivers.fairness import Places

Obey = Callable[[dict[str, Any]], dict[str, Any]]
TIMEOUT_S = 5.0
ANSWER_S = 60.0  # of a cell that waits for its turn on a busy machine
_CLIENTS = 16
_LONGEST = 65_536  # bytes of a request
_SHOWN = 500  # characters of what was wrong


class _Handler(socketserver.StreamRequestHandler):
    disable_nagle_algorithm = True
    server: "_Server"

    def handle(self) -> None:
        self.connection.settimeout(None)
        if not self.server.enter(self.connection):
            return
        with contextlib.suppress(OSError):
            while (line := self.rfile.readline(_LONGEST)) and self._answer(line):
                pass

    def finish(self) -> None:
        with contextlib.suppress(OSError):
            super().finish()
        self.server.leave(self.connection)

    def _answer(self, line: bytes) -> bool:
        """False when there is no sense in reading on."""
        whole = line.endswith(b"\n") or len(line) < _LONGEST
        try:
            reply = self.server.obey(self._request(line)) if whole else {"error": "line too long"}
        except Exception as error:  # a client's mistake must not end the cell
            reply = {"error": f"{type(error).__name__}: {error}"[:_SHOWN]}
        self._say(reply)
        self.server.note_activity(self.connection)
        return whole

    def _request(self, line: bytes) -> dict[str, Any]:
        request = msgspec.json.decode(line, type=dict[str, Any])
        token = str(request.pop("token", ""))
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            raise PermissionError("the cell's token is asked for")
        return request

    def _say(self, reply: dict[str, Any]) -> None:
        self.wfile.write(json.dumps(reply).encode() + b"\n")


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 128

    def __init__(self, host: str, obey: Obey, token: str) -> None:
        super().__init__((host, 0), _Handler)
        self.obey = obey
        self.token = token
        self._crowd = threading.Lock()
        self._places: Places[socket.socket] = Places(_CLIENTS)

    def enter(self, connection: socket.socket) -> bool:
        """Take a place; False where there is none."""
        with self._crowd:
            try:
                leaves = self._places.enter(connection, time.monotonic())
            except OverflowError:
                return False
        if leaves is not None:
            with contextlib.suppress(OSError):
                leaves.shutdown(socket.SHUT_RDWR)
        return True

    def leave(self, connection: socket.socket) -> None:
        with self._crowd:
            self._places.leave(connection)

    def note_activity(self, connection: socket.socket) -> None:
        with self._crowd:
            self._places.heard(connection, time.monotonic())

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that went away is no news."""


class ControlServer:
    """Serves ``obey`` on a free port of the cell's address."""

    def __init__(self, host: str, obey: Obey, token: str = "") -> None:
        self._server = _Server(host, obey, token)
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever, name="cell-control", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(TIMEOUT_S)


class ControlClient:
    """Asks a cell. Raises LinkLost when it is gone, ValueError when it refuses."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), ANSWER_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._stream = self._socket.makefile("rwb")

    def ask(self, verb: str, **more: Any) -> dict[str, Any]:
        try:
            self._stream.write(json.dumps({"verb": verb, **more}).encode() + b"\n")
            self._stream.flush()
            line = self._stream.readline()
        except OSError as error:
            raise _gone(str(error)) from None
        if not line:
            raise _gone("it closed the connection")
        reply: dict[str, Any] = json.loads(line)
        if "error" in reply:
            raise ValueError(reply["error"])
        return reply

    def close(self) -> None:
        self._stream.close()
        self._socket.close()


def _gone(why: str) -> LinkLost:
    return LinkLost(f"the emulated cell is gone: {why}", "start the run again")
