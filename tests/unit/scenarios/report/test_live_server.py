"""How the server of a live page takes what it is told."""

import asyncio
import os
from collections.abc import Callable, Iterator
from contextlib import suppress

import msgspec
import pytest

from scenarios.report.live_server import Begin, Row, TrialStream, read_lines

BEGIN = msgspec.json.encode(Begin(1, 2, {}))
ROWS = [msgspec.json.encode(Row("lift", [float(n)] * 60)) for n in range(200)]


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        with suppress(OSError):
            os.close(end)


def read(pipe: tuple[int, int], tell: Callable[[int], None]) -> list[bytes]:
    """What a viewer is handed, who comes when all has been told by ``tell``."""

    async def reading() -> list[bytes]:
        stream = TrialStream()
        telling = asyncio.get_running_loop().run_in_executor(None, tell, pipe[1])
        with os.fdopen(pipe[0], "rb", closefd=False) as source:
            await asyncio.wait_for(read_lines(stream, source), 60.0)
        await telling
        return stream.so_far()

    return asyncio.run(reading())


def in_pieces_of(size: int) -> Callable[[int], None]:
    def tell(to: int) -> None:
        told = b"".join(line + b"\n" for line in [BEGIN, *ROWS])
        for first in range(0, len(told), size):
            os.write(to, told[first : first + size])
        os.close(to)

    return tell


@pytest.mark.parametrize("size", [7, 501, 4_096, 60_000])
def test_lines_are_the_same_however_the_pipe_hands_them_over(
    pipe: tuple[int, int], size: int
) -> None:
    assert read(pipe, in_pieces_of(size)) == [BEGIN, *ROWS]


def test_half_a_line_of_a_run_that_died_is_left_out(pipe: tuple[int, int]) -> None:
    def tell(to: int) -> None:
        os.write(to, BEGIN + b"\n" + ROWS[0] + b"\n" + ROWS[1][:20])
        os.close(to)

    assert read(pipe, tell) == [BEGIN, ROWS[0]]
