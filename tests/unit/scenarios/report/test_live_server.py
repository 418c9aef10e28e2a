"""The server of a live page reads messages from its pipe."""

import asyncio
import os
from collections.abc import Callable, Iterator
from contextlib import suppress

import msgspec
import pytest

from scenarios.report.live_server import Begin, Row, TrialStream, read_lines

BEGIN = msgspec.json.encode(Begin(1, 2, {}))
ROWS = [msgspec.json.encode(Row("lift", {"t": [float(n)] * 60})) for n in range(200)]


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        with suppress(OSError):
            os.close(end)


def read(pipe: tuple[int, int], write: Callable[[int], None]) -> list[bytes]:
    """Lines for a browser that connects after ``write`` has written everything."""

    async def reading() -> list[bytes]:
        stream = TrialStream()
        writing = asyncio.get_running_loop().run_in_executor(None, write, pipe[1])
        with os.fdopen(pipe[0], "rb", closefd=False) as source:
            await asyncio.wait_for(read_lines(stream, source), 60.0)
        await writing
        return stream.so_far()

    return asyncio.run(reading())


def in_pieces_of(size: int) -> Callable[[int], None]:
    def write(to: int) -> None:
        content = b"".join(line + b"\n" for line in [BEGIN, *ROWS])
        for first in range(0, len(content), size):
            os.write(to, content[first : first + size])
        os.close(to)

    return write


@pytest.mark.parametrize("size", [7, 501, 4_096, 60_000])
def test_lines_do_not_depend_on_the_size_of_writes(pipe: tuple[int, int], size: int) -> None:
    assert read(pipe, in_pieces_of(size)) == [BEGIN, *ROWS]


def test_incomplete_last_line_is_dropped(pipe: tuple[int, int]) -> None:
    def write(to: int) -> None:
        os.write(to, BEGIN + b"\n" + ROWS[0] + b"\n" + ROWS[1][:20])
        os.close(to)

    assert read(pipe, write) == [BEGIN, ROWS[0]]
