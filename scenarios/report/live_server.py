"""The process that serves a live page: on loopback, to who knows the token.

Started by `grasp.viewer_process`; reads one `Message` a line from standard input until that ends. A
browser is sent what has come since it was sent something last, as much as is still kept: a slow one
gets less, and delays no other. Nothing that a browser sends is read.
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
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Origin

from grasp.viewer_process import ignore_signals
from scenarios.report.page import render
from scenarios.report.run_view import View


class Serve(msgspec.Struct, frozen=True, tag=True):
    """The first message: listen on that descriptor, and hand this page to who knows the token."""

    descriptor: int
    address: str  # host and port
    token: str
    title: str
    fingers: tuple[str, ...]
    view: View


class Begin(msgspec.Struct, frozen=True, tag=True):
    """A trial begins: what came before is over. ``data`` is for the scripts of the page,
    ``left_s`` how long all that is to come will last, None where nobody can tell."""

    number: int
    of: int
    left_s: float | None
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
MOST_BYTES = 1_024  # that a browser may say at once, of what nobody reads
END_S = 2.0  # that a viewer has to take what came last
NICE = 5  # a picture gives way to the run


class Story:
    """What there is to be told of the trial that lasts: its begin, and the lines since."""

    def __init__(self) -> None:
        self.trial = 0
        self.over = False
        self._begin: bytes | None = None
        self._lines: deque[bytes] = deque(maxlen=MOST_LINES)
        self._came = 0  # lines of this trial, kept or not
        self._news = asyncio.Event()

    def add(self, line: bytes, begins: bool) -> None:
        if begins:
            self.trial += 1
            self._begin, self._came = line, 0
            self._lines.clear()
        else:
            self._lines.append(line)
            self._came += 1
        self._tell()

    def end(self) -> None:
        self.over = True
        self._tell()

    def since(self, trial: int, came: int) -> tuple[list[bytes], int]:
        """What a viewer lacks who was told of so many lines of that trial, and of how many he
        will have been then."""
        fresh = trial != self.trial
        first = self._came - len(self._lines)
        begin = [self._begin] if fresh and self._begin is not None else []
        lacks = list(self._lines)[max(0 if fresh else came - first, 0) :]
        return [*begin, *lacks], self._came

    async def news(self) -> None:
        """Until there is more."""
        await self._news.wait()

    def _tell(self) -> None:
        self._news.set()
        self._news = asyncio.Event()


class Server:
    """One page and its viewers."""

    def __init__(self, told: Serve, story: Story) -> None:
        self._told = told
        self._story = story
        self._viewers = 0
        self._page = render(
            "live.html", SCRIPTS, connect=f"ws://{told.address}", title=told.title,
            fingers=told.fingers, view=told.view, data={"live": True, "phases": [], "marks": []},
        ).encode()  # fmt: skip

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, or None where a socket is asked for; nothing else is here."""
        token = f"/{self._told.token}/"
        # a name that leads here from elsewhere is none of ours
        ours = request.headers.get_all("Host") == [self._told.address]
        path = request.path.encode()
        if ours and hmac.compare_digest(path, token.encode()):
            return _response(HTTPStatus.OK, self._page, "text/html; charset=utf-8")
        if not ours or not hmac.compare_digest(path, f"{token}live".encode()):
            return _response(HTTPStatus.NOT_FOUND, b"not found\n")
        if self._viewers >= MOST_VIEWERS:
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, b"too many look on\n")
        return None

    async def tell(self, viewer: ServerConnection) -> None:
        """One viewer, until all is told or he has gone."""
        self._viewers += 1
        trial, came = -1, 0
        try:
            while True:
                lines, came = self._story.since(trial, came)
                trial = self._story.trial
                if lines:
                    await viewer.send(b"[" + b",".join(lines) + b"]", text=True)
                elif self._story.over:
                    return
                else:
                    await self._story.news()
        except ConnectionClosed:
            return
        finally:
            self._viewers -= 1


def _response(status: HTTPStatus, body: bytes, kind: str = "text/plain") -> Response:
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Connection": "close",
        }
    )
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
            server.tell, sock=listening, process_request=server.answer, max_size=MOST_BYTES,
            origins=[Origin(f"http://{told.address}")], compression=None, server_header=None,
            close_timeout=END_S,
        ) as made:  # fmt: skip
            await read_lines(story, source)
            story.end()
            told_all = [asyncio.create_task(c.wait_closed()) for c in made.connections]
            if told_all:
                await asyncio.wait(told_all, timeout=END_S)


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
