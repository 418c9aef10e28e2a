"""A proxy process between the application and its cell that disturbs the connections by a plan.

On loopback only. Reads an order, a line of JSON, from standard input and prints a line when it
listens. At the end of its input it prints statistics and ends.
"""

import asyncio
import contextlib
import os
import random
import sys
import time

import msgspec

WIRES = {"gripper": "gripper", "tactile": "fingertips", "arm": "arm"}  # and the device's name
AMOUNTS: dict[str, tuple[float, ...]] = {
    "latency_s": (0.002, 0.02, 0.08, 0.3, 1.0),
    "slice_bytes": (1, 7, 50),
    "reset_share": (0.001, 0.01, 0.2),
    "twice_share": (0.001, 0.01, 0.2),
}
PIECE = 65_536
FC16 = 16  # of Modbus: write registers
FORCES = (5, 8, 11)  # bytes of the command image: rFRA, rFRB, rFRC


class Disturbance(msgspec.Struct, frozen=True, omit_defaults=True):
    """A disturbance of one connection, in both directions, from ``after_s`` for ``lasts_s``."""

    wire: str
    after_s: float  # since the first connection
    lasts_s: float
    latency_s: float = 0.0  # of every piece
    slice_bytes: int = 0  # largest piece; 0: unchanged
    reset_share: float = 0.0  # of pieces: the connection is reset instead of passing one
    twice_share: float = 0.0  # of pieces: passed twice


class Plan(msgspec.Struct, frozen=True):
    """The disturbances of one run."""

    number: int
    disturbances: tuple[Disturbance, ...]


def sample_plan(number: int) -> Plan:
    """The random plan of a number; the number is the seed."""
    chance = random.Random(number)
    wires = chance.sample(tuple(WIRES), chance.choice((1, 1, 1, 2, 3)))
    return Plan(number, tuple(_disturbance(chance, wire) for wire in wires))


def _disturbance(chance: random.Random, wire: str) -> Disturbance:
    kinds = chance.sample(sorted(AMOUNTS), chance.choice((1, 1, 2)))
    amounts = {kind: chance.choice(AMOUNTS[kind]) for kind in kinds}
    after_s = chance.choice((0.0, 1.0, 3.0, 5.0, 7.0))
    return Disturbance(wire, after_s, chance.choice((0.1, 0.5, 2.0, 600.0)), **amounts)  # type: ignore[arg-type]


class Route(msgspec.Struct, frozen=True):
    """One connection to forward. Port 0: any."""

    wire: str
    listen: tuple[str, int]
    to: tuple[str, int]


class Order(msgspec.Struct, frozen=True):
    """Input of the proxy process."""

    plan: Plan
    routes: tuple[Route, ...]


class Passed(msgspec.Struct):
    """Number of writes to the hand that passed, and the highest force byte in them."""

    writes: int = 0
    most_force: int = 0


class Commands:
    """Decodes the writes to the hand from Modbus frames."""

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
        image = bytes(2 * int.from_bytes(pdu[1:3], "big")) + pdu[6:]
        self._passed.writes += 1
        forces = [image[at] for at in FORCES if at < len(image)]
        self._passed.most_force = max(self._passed.most_force, *forces, 0)


class Proxy:
    """Forwards all routes with the disturbances of one plan."""

    def __init__(self, plan: Plan) -> None:
        self._disturbances = {disturbance.wire: disturbance for disturbance in plan.disturbances}
        self._chance = random.Random(plan.number)
        self._start_s: float | None = None
        self.passed = Passed()

    def _under_way(self, wire: str) -> Disturbance | None:
        disturbance = self._disturbances.get(wire)
        if disturbance is None or self._start_s is None:
            return None
        since_s = time.monotonic() - self._start_s - disturbance.after_s
        return disturbance if 0.0 <= since_s < disturbance.lasts_s else None

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
                disturbance = self._under_way(wire)
                size = (
                    disturbance.slice_bytes
                    if disturbance and disturbance.slice_bytes
                    else len(data)
                )
                for at in range(0, len(data), size):
                    if not await self._piece(wire, data[at : at + size], writer):
                        writer.transport.abort()
                        return
            writer.write_eof()

    async def _piece(self, wire: str, piece: bytes, writer: asyncio.StreamWriter) -> bool:
        """Pass one piece; False if the connection is to be reset."""
        disturbance = self._under_way(wire)
        times = 1
        if disturbance is not None:
            if self._chance.random() < disturbance.reset_share:
                return False
            if disturbance.latency_s:
                await asyncio.sleep(disturbance.latency_s)
            times += self._chance.random() < disturbance.twice_share
        writer.write(piece * times)
        await writer.drain()
        if disturbance is not None and disturbance.slice_bytes:
            await asyncio.sleep(0)  # otherwise the kernel would join the pieces
        return True


async def run(line: str) -> None:
    order = msgspec.json.decode(line, type=Order)
    proxy = Proxy(order.plan)
    servers = [await proxy.serve(route) for route in order.routes]
    print(
        msgspec.json.encode([s.sockets[0].getsockname()[1] for s in servers]).decode(), flush=True
    )
    await asyncio.to_thread(sys.stdin.read)
    print(msgspec.json.encode(proxy.passed).decode(), flush=True)
    os._exit(0)  # even with unsent data


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(run(sys.stdin.readline()))
