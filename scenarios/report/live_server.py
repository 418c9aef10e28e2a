"""The process that serves a live page on loopback, to clients with the token.

Started by `grasp.run.viewer_process`; reads one `Message` per line from standard input until its
end. A browser gets the trial so far, then each new line. Data from browsers is ignored.
"""

import asyncio
import hmac
import logging
import os
import socket
import sys
from collections import deque
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any, BinaryIO

import msgspec
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.typing import Origin

from drivers.interfaces import FINGER_NAMES
from grasp.run.viewer_process import ignore_signals
from scenarios.report.page import render
from scenarios.report.run_view import View


class Serve(msgspec.Struct, frozen=True, tag=True):
    """First message: the socket to listen on, and the page to serve to clients with the token."""

    descriptor: int
    address: str  # host and port
    token: str
    title: str
    view: View


class Begin(msgspec.Struct, frozen=True, tag=True):
    """Begin of a trial. ``data``: input of the page's scripts."""

    number: int
    of: int
    data: dict[str, Any]


Values = dict[str, Sequence[float | None]]  # by column; None: NaN


class Row(msgspec.Struct, frozen=True, tag=True):
    """One instant: its phase, and its values. All rows of a trial have the same columns."""

    phase: str
    values: Values


class Note(msgspec.Struct, frozen=True, tag=True):
    """A message between two trials, or after the last."""

    text: str


Message = Serve | Begin | Row | Note


SCRIPTS = (
    "uplot/uPlot.iife.min.js", "data.js", "run_scene.js", "run_plots.js", "run.js", "live.js",
)  # fmt: skip
MOST_LINES = 6_000  # of a trial: four minutes
MOST_VIEWERS = 8
MOST_BYTES = 1_024  # of a browser's message
END_S = 2.0  # for a browser to receive the last lines
NICE = 5  # below the priority of the run


class TrialStream:
    """The current trial: its begin, its rows so far, and the connected browsers."""

    def __init__(self) -> None:
        self.viewers: set[ServerConnection] = set()
        self._begin: list[bytes] = []
        self._lines: deque[bytes] = deque(maxlen=MOST_LINES)

    def add(self, line: bytes, begins: bool) -> None:
        if begins:
            self._begin = [line]
            self._lines.clear()
        else:
            self._lines.append(line)
        broadcast(self.viewers, _message([line]))

    def so_far(self) -> list[bytes]:
        return [*self._begin, *self._lines]

    async def show(self, viewer: ServerConnection) -> None:
        """Send past and future lines until the browser or the server closes."""
        broadcast([viewer], _message(self.so_far()))
        self.viewers.add(viewer)
        try:
            await viewer.wait_closed()
        finally:
            self.viewers.discard(viewer)


def _message(lines: list[bytes]) -> str:
    return f"[{b','.join(lines).decode()}]"


class Server:
    """Answers requests for the page and for its web socket."""

    def __init__(self, options: Serve, stream: TrialStream) -> None:
        self._options, self._stream = options, stream
        self._page = render(
            "live.html", SCRIPTS, connect=f"ws://{options.address}", title=options.title,
            fingers=FINGER_NAMES, view=options.view,
            data={"live": True, "phases": [], "marks": []},
        ).encode()  # fmt: skip

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, an error, or None for a web socket, which the caller then opens."""
        token = f"/{self._options.token}/"
        # requests under another host name are refused
        ours = request.headers.get_all("Host") == [self._options.address]
        path = request.path.encode()
        if ours and hmac.compare_digest(path, token.encode()):
            return _response(HTTPStatus.OK, self._page, "text/html; charset=utf-8")
        if not ours or not hmac.compare_digest(path, f"{token}live".encode()):
            return _response(HTTPStatus.NOT_FOUND, b"not found\n")
        if len(self._stream.viewers) >= MOST_VIEWERS:
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, b"too many viewers\n")
        return None


def _response(status: HTTPStatus, body: bytes, kind: str = "text/plain") -> Response:
    headers = Headers({
        "Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
        "Connection": "close",
    })  # fmt: skip
    return Response(status.value, status.phrase, headers, body)


async def read_lines(stream: TrialStream, source: BinaryIO) -> None:
    """Pass the lines of a pipe to the stream until it ends, read in a thread; an incomplete last
    line is dropped."""
    loop, decode = asyncio.get_running_loop(), msgspec.json.Decoder(Message).decode

    def read() -> None:
        for line in source:
            if line.endswith(b"\n"):
                begins = isinstance(decode(line), Begin)
                loop.call_soon_threadsafe(stream.add, line.rstrip(b"\n"), begins)

    await asyncio.to_thread(read)


async def _serve(options: Serve, source: BinaryIO) -> None:
    stream = TrialStream()
    server = Server(options, stream)
    with socket.socket(fileno=options.descriptor) as listening:
        listening.setblocking(False)
        async with serve(
            stream.show, sock=listening, process_request=server.answer, max_size=MOST_BYTES,
            origins=[Origin(f"http://{options.address}")], compression=None, server_header=None,
            close_timeout=END_S,
        ):  # fmt: skip
            await read_lines(stream, source)


def main() -> None:
    """Serve the messages on standard input until its end."""
    ignore_signals()
    os.nice(NICE)
    # no tracebacks on the run's terminal when file descriptors run out
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    first = sys.stdin.buffer.readline()
    if first:
        asyncio.run(_serve(msgspec.json.decode(first, type=Serve), sys.stdin.buffer))


if __name__ == "__main__":
    main()
