"""A process that stands between the application and its cell and spoils what passes, by a plan.

On loopback alone. Reads an order, a line of JSON, from standard input and answers with a line when
it listens; ends, with a line on what passed, when its input does.
"""

import asyncio
import contextlib
import os
import random
import sys
import time

import msgspec

from tests.nightly.chaos.plans import Plan, Trouble

PIECE = 65_536
FC16 = 16  # of Modbus: write registers
FORCES = (5, 8, 11)  # bytes of the command image: rFRA, rFRB, rFRC


class Route(msgspec.Struct, frozen=True):
    """Port 0: any."""

    wire: str
    listen: tuple[str, int]
    to: tuple[str, int]


class Order(msgspec.Struct, frozen=True):
    """What to do."""

    plan: Plan
    routes: tuple[Route, ...]


class Passed(msgspec.Struct):
    """What came of it."""

    pieces: int = 0
    spoilt: int = 0
    resets: int = 0
    writes: int = 0  # of the application to the hand
    most_force: int = 0  # the highest force byte in them


class Commands:
    """Writes to the hand, as the application sends them: whole Modbus frames."""

    def __init__(self, passed: Passed) -> None:
        self._passed = passed
        self._pending = b""

    def take(self, data: bytes) -> None:
        self._pending += data
        while len(self._pending) >= 6:
            size = 6 + int.from_bytes(self._pending[4:6], "big")
            if len(self._pending) < size:
                return
            frame, self._pending = self._pending[:size], self._pending[size:]
            self._frame(frame[7:])

    def _frame(self, pdu: bytes) -> None:
        if pdu[:1] != bytes([FC16]):
            return
        first = int.from_bytes(pdu[1:3], "big")
        image = bytes(2 * first) + pdu[6:]
        self._passed.writes += 1
        forces = [image[at] for at in FORCES if at < len(image)]
        self._passed.most_force = max(self._passed.most_force, *forces, 0)


class Proxy:
    """All routes of one plan."""

    def __init__(self, order: Order) -> None:
        self._troubles = {trouble.wire: trouble for trouble in order.plan.troubles}
        self._chance = random.Random(order.plan.number)
        self._start_s: float | None = None
        self.passed = Passed()

    def _under_way(self, wire: str) -> Trouble | None:
        trouble = self._troubles.get(wire)
        if trouble is None or self._start_s is None:
            return None
        since_s = time.monotonic() - self._start_s - trouble.after_s
        return trouble if 0.0 <= since_s < trouble.lasts_s else None

    async def serve(self, route: Route) -> asyncio.Server:
        async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._start_s = self._start_s or time.monotonic()
            try:
                there = await asyncio.open_connection(*route.to)
            except OSError:
                writer.transport.abort()
                return
            commands = Commands(self.passed) if route.wire == "gripper" else None
            await asyncio.gather(
                self._pass(route.wire, reader, there[1], commands),
                self._pass(route.wire, there[0], writer, None),
            )
            for end in (writer, there[1]):
                end.close()

        return await asyncio.start_server(connected, *route.listen)

    async def _pass(
        self, wire: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter,
        commands: Commands | None,
    ) -> None:  # fmt: skip
        with contextlib.suppress(OSError):
            while data := await reader.read(PIECE):
                if commands is not None:
                    commands.take(data)
                for piece in self._pieces(wire, data):
                    if not await self._piece(wire, piece, writer):
                        writer.transport.abort()
                        return
            writer.write_eof()

    def _pieces(self, wire: str, data: bytes) -> list[bytes]:
        trouble = self._under_way(wire)
        size = trouble.slice_bytes if trouble and trouble.slice_bytes else len(data)
        return [data[at : at + size] for at in range(0, len(data), size)]

    async def _piece(self, wire: str, piece: bytes, writer: asyncio.StreamWriter) -> bool:
        """Whether the connection lives."""
        self.passed.pieces += 1
        trouble = self._under_way(wire)
        times = 1
        if trouble is not None:
            self.passed.spoilt += 1
            if self._chance.random() < trouble.reset_share:
                self.passed.resets += 1
                return False
            wait_s = trouble.latency_s + trouble.jitter_s * self._chance.random()
            wait_s += len(piece) / trouble.bytes_per_s if trouble.bytes_per_s else 0.0
            if wait_s:
                await asyncio.sleep(wait_s)
            times += self._chance.random() < trouble.twice_share
        writer.write(piece * times)
        await writer.drain()
        if trouble is not None and trouble.slice_bytes:
            await asyncio.sleep(0)  # else the kernel would join them again
        return True


async def run(line: str) -> None:
    order = msgspec.json.decode(line, type=Order)
    proxy = Proxy(order)
    servers = [await proxy.serve(route) for route in order.routes]
    print(
        msgspec.json.encode([s.sockets[0].getsockname()[1] for s in servers]).decode(), flush=True
    )
    await asyncio.to_thread(sys.stdin.read)
    print(msgspec.json.encode(proxy.passed).decode(), flush=True)
    os._exit(0)  # whatever still waits to be passed


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(run(sys.stdin.readline()))
