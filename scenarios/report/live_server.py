"""The process that serves a live page: on loopback, to who knows the token.

Started by `grasp.viewer_process`; reads one `Message` a line from standard input until that ends.
A viewer is sent the trial so far, then each line as it comes. Nothing that a browser sends is read.
"""

import asyncio
import hmac
import logging
import os
import socket
import sys
from collections import deque
from http import HTTPStatus
from typing import Any, BinaryIO

import msgspec
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.typing import Origin

from drivers.interfaces import FINGER_NAMES
from grasp.viewer_process import ignore_signals
from scenarios.report.page import render
from scenarios.report.run_view import View


class Serve(msgspec.Struct, frozen=True, tag=True):
    """The first message: listen on that descriptor, and hand this page to who knows the token."""

    descriptor: int
    address: str  # host and port
    token: str
    title: str
    view: View


class Begin(msgspec.Struct, frozen=True, tag=True):
    """A trial begins. ``data`` is for the scripts of the page."""

    number: int
    of: int
    data: dict[str, Any]


class Row(msgspec.Struct, frozen=True, tag=True):
    """One instant: its phase, and the columns of ``Begin.data`` side by side; None: no number."""

    phase: str
    values: list[float | None]


class Said(msgspec.Struct, frozen=True, tag=True):
    """A line between two trials, or when all is over."""

    text: str


Message = Serve | Begin | Row | Said


SCRIPTS = (
    "uplot/uPlot.iife.min.js", "data.js", "run_scene.js", "run_plots.js", "run.js", "live.js",
)  # fmt: skip
MOST_LINES = 6_000  # of a trial: four minutes
MOST_VIEWERS = 8
MOST_BYTES = 1_024  # that a browser may send at once
END_S = 2.0  # for a viewer to receive what came last
NICE = 5  # the run has priority


class Story:
    """The trial that goes on: its begin, its rows so far, and who follows it."""

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
        """Send what came and what comes, until the viewer or the server closes."""
        broadcast([viewer], _message(self.so_far()))
        self.viewers.add(viewer)
        try:
            await viewer.wait_closed()
        finally:
            self.viewers.discard(viewer)


def _message(lines: list[bytes]) -> str:
    return f"[{b','.join(lines).decode()}]"


class Server:
    """One page and its viewers."""

    def __init__(self, told: Serve, story: Story) -> None:
        self._told, self._story = told, story
        self._page = render(
            "live.html", SCRIPTS, connect=f"ws://{told.address}", title=told.title,
            fingers=FINGER_NAMES, view=told.view, data={"live": True, "phases": [], "marks": []},
        ).encode()  # fmt: skip

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, or None where a socket is asked for; nothing else is here."""
        token = f"/{self._told.token}/"
        # another name that leads here is refused
        ours = request.headers.get_all("Host") == [self._told.address]
        path = request.path.encode()
        if ours and hmac.compare_digest(path, token.encode()):
            return _response(HTTPStatus.OK, self._page, "text/html; charset=utf-8")
        if not ours or not hmac.compare_digest(path, f"{token}live".encode()):
            return _response(HTTPStatus.NOT_FOUND, b"not found\n")
        if len(self._story.viewers) >= MOST_VIEWERS:
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, b"too many viewers\n")
        return None


def _response(status: HTTPStatus, body: bytes, kind: str = "text/plain") -> Response:
    headers = Headers({
        "Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
        "Connection": "close",
    })  # fmt: skip
    return Response(status.value, status.phrase, headers, body)


async def read_lines(story: Story, source: BinaryIO) -> None:
    """That pipe, line by line in a thread, until it ends; a line that was cut off is left out."""
    loop, decode = asyncio.get_running_loop(), msgspec.json.Decoder(Message).decode

    def read() -> None:
        for line in source:
            if line.endswith(b"\n"):
                begins = isinstance(decode(line), Begin)
                loop.call_soon_threadsafe(story.add, line.rstrip(b"\n"), begins)

    await asyncio.to_thread(read)


async def _serve(told: Serve, source: BinaryIO) -> None:
    story = Story()
    server = Server(told, story)
    with socket.socket(fileno=told.descriptor) as listening:
        listening.setblocking(False)
        async with serve(
            story.show, sock=listening, process_request=server.answer, max_size=MOST_BYTES,
            origins=[Origin(f"http://{told.address}")], compression=None, server_header=None,
            close_timeout=END_S,
        ):  # fmt: skip
            await read_lines(story, source)


def main() -> None:
    """Serve what comes on standard input until it ends."""
    ignore_signals()
    os.nice(NICE)
    # more viewers than there are descriptors: no tracebacks on the terminal of a run
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    first = sys.stdin.buffer.readline()
    if first:
        asyncio.run(_serve(msgspec.json.decode(first, type=Serve), sys.stdin.buffer))


if __name__ == "__main__":
    main()
