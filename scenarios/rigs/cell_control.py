"""The cell's control channel: JSON lines on a loopback port. Ours alone, never part of a driver.

A request is an object with a ``verb``; the reply is an object, with ``error`` when it was refused.
"""

import json
import socket
import socketserver
import threading
from collections.abc import Callable
from typing import Any, Self

from drivers.errors import LinkLost

Obey = Callable[[dict[str, Any]], dict[str, Any]]
TIMEOUT_S = 5.0


class _Handler(socketserver.StreamRequestHandler):
    disable_nagle_algorithm = True

    def handle(self) -> None:
        for line in self.rfile:
            try:
                reply = self.server.obey(json.loads(line))  # type: ignore[attr-defined]
            except Exception as error:  # a client's mistake must not end the cell
                reply = {"error": f"{type(error).__name__}: {error}"}
            self.wfile.write(json.dumps(reply).encode() + b"\n")


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    allow_reuse_address = True


class ControlServer:
    """Serves ``obey`` on a free port of the cell's address."""

    def __init__(self, host: str, obey: Obey) -> None:
        self._server = _Server((host, 0), _Handler)
        self._server.obey = obey  # type: ignore[attr-defined]
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
        self._socket = socket.create_connection((host, port), TIMEOUT_S)
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
