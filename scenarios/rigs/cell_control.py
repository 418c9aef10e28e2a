"""The cell's control channel: JSON lines on a loopback port. Ours alone, never part of a driver.

A request is an object with a ``verb``; the reply is an object, with ``error`` when it was refused.
Where the cell is not on loopback alone, a request needs the cell's ``token``.
"""

import contextlib
import json
import secrets
import socketserver
import threading
from collections.abc import Callable
from typing import Any, Self

import msgspec

Obey = Callable[[dict[str, Any]], dict[str, Any]]
END_S = 5.0
LONGEST = 65_536  # bytes of a request
SHOWN = 500  # characters of what was wrong


class _Handler(socketserver.StreamRequestHandler):
    disable_nagle_algorithm = True
    server: "_Server"

    def handle(self) -> None:
        with contextlib.suppress(OSError):
            while line := self.rfile.readline(LONGEST):
                whole = line.endswith(b"\n") or len(line) < LONGEST
                reply = self._reply(line) if whole else {"error": "line too long"}
                self.wfile.write(json.dumps(reply).encode() + b"\n")
                if not whole:
                    return

    def finish(self) -> None:
        with contextlib.suppress(OSError):
            super().finish()

    def _reply(self, line: bytes) -> dict[str, Any]:
        try:
            request = msgspec.json.decode(line, type=dict[str, Any])
            token = str(request.pop("token", ""))
            if not secrets.compare_digest(token.encode(), self.server.token.encode()):
                raise PermissionError("the cell's token is asked for")
            return self.server.obey(request)
        except Exception as error:  # a client's mistake must not end the cell
            return {"error": f"{type(error).__name__}: {error}"[:SHOWN]}


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    allow_reuse_address = True
    obey: Obey
    token: str

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that went away is no error."""


class ControlServer:
    """Serves ``obey`` on a free port of the cell's address."""

    def __init__(self, host: str, obey: Obey, token: str = "") -> None:
        self._server = _Server((host, 0), _Handler)
        self._server.obey, self._server.token = obey, token
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
        self._thread.join(END_S)
