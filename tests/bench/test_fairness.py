"""How long a client of the dashboard waits while others ask all that they can of the emulated arm.

One emulator in a process of its own, the attackers in another; blocks with and without them in
turn, so that whatever else the machine does weighs on both.
"""

import multiprocessing
import random
import selectors
import socket
import statistics
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from multiprocessing.connection import Connection

import pytest

from drivers.ur.emulator.robot import DASHBOARD_PORT
from drivers.ur.emulator.rtde_wire import PORT as RTDE_PORT
from drivers.ur.emulator.settings import PROFILES
from scenarios.testing.plugin import EmulatedArm
from tests.wire.fuzz.polite import STATE_PORTS, Line, expect, packet

CLIENTS = 30  # of the 32 places of a port
NAMES = 1000  # of a recipe: the most that is taken
COMPILERS = 6
BLOCKS, ASKED = 4, 150
GAP_S = (0.011, 0.021)  # between two questions: no multiple of a cycle
SETTLES_S = 0.5
TURN_S = 0.004
HOG = b"""def hog():
 while True:
  i = 0
  while i < 30000:
   x = get_inverse_kin(p[0.5, 0.1, 0.3, 3.14, 0, 0])
   i = i + 1
  end
  sync()
 end
end
"""

Turn = Callable[[list[socket.socket]], int]  # one of an attack: bytes said


def recipes(host: str) -> list[socket.socket]:
    """Clients that each want a thousand fields in every cycle."""
    names, clients = sorted(PROFILES["cb3"].output_types), []
    for i in range(CLIENTS):
        wanted = ",".join(random.Random(i).choices(names, k=NAMES)).encode()
        client = socket.create_connection((host, RTDE_PORT))
        client.sendall(packet("O", struct.pack(">d", 125.0) + wanted) + packet("S"))
        clients.append(client)
    return clients


def listeners(host: str) -> list[socket.socket]:
    """Clients that are told the state on all three ports that tell it."""
    return [
        socket.create_connection((host, STATE_PORTS[i % len(STATE_PORTS)])) for i in range(CLIENTS)
    ]


def hogging(host: str) -> list[socket.socket]:
    """A program that computes without end, and those who listen beside it."""
    clients = listeners(host)
    clients[0].sendall(HOG)
    return clients


def nothing(clients: list[socket.socket]) -> int:
    return 0


def programs(clients: list[socket.socket]) -> int:
    """A program that nobody has sent before, by each of some."""
    said = 0
    for client in clients[:COMPILERS]:
        new = random.randrange(10**9)
        text = f"def f():\n a = {new}\n" + " b = [1, 2, 3]\n" * 400 + "end\n"
        try:
            said += client.send(text.encode())
        except BlockingIOError:  # as much is on its way as there is room for
            continue
    return said


ATTACKS: dict[str, tuple[Callable[[str], list[socket.socket]], Turn]] = {
    "rtde": (recipes, nothing), "state": (listeners, nothing), "compile": (listeners, programs),
    "hog": (hogging, nothing),
}  # fmt: skip


def attack(kind: str, host: str, pipe: Connection) -> None:
    """Until told to end: reads all that is said, and says how many bytes that were, how many were
    said, and how many clients are left."""
    begin, turn = ATTACKS[kind]
    clients = begin(host)
    heard = selectors.DefaultSelector()
    for client in clients:
        client.setblocking(False)
        heard.register(client, selectors.EVENT_READ)
    pipe.send("on")
    read = said = 0
    while not pipe.poll():
        time.sleep(TURN_S)
        said += turn(clients)
        for key, _ in heard.select(0):
            data = key.fileobj.recv(1 << 16)  # type: ignore[union-attr]
            read += len(data)
            if not data:
                heard.unregister(key.fileobj)
    pipe.send((read, said, len(heard.get_map())))


@contextmanager
def under(kind: str, host: str, did: list[tuple[int, int, int]]) -> Iterator[None]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=attack, args=(kind, host, there))
    process.start()
    try:
        assert here.poll(60)
        assert here.recv() == "on"
        time.sleep(SETTLES_S)
        yield
        here.send("end")
        assert here.poll(60)
        did.append(here.recv())
    finally:
        process.join(10)
        process.kill()
        process.join()
        process.close()
        here.close()
        there.close()


def waits_ms(host: str) -> list[float]:
    """Of a client that asks now and then."""
    line = Line(host, DASHBOARD_PORT)
    line.file.readline()
    found = []
    for _ in range(ASKED):
        began = time.perf_counter()
        expect(line.ask(b"robotmode\n"), b"Robotmode")
        found.append((time.perf_counter() - began) * 1e3)
        time.sleep(random.uniform(*GAP_S))
    line.file.close()
    line.sock.close()
    return found


@pytest.mark.bench
@pytest.mark.parametrize("kind", ATTACKS)
def test_wait_of_a_client_beside_an_attack(kind: str) -> None:
    quiet: list[list[float]] = []
    loud: list[list[float]] = []
    did: list[tuple[int, int, int]] = []
    arm = EmulatedArm()
    try:
        for _ in range(BLOCKS):
            quiet.append(waits_ms(arm.host))
            with under(kind, arm.host, did):
                loud.append(waits_ms(arm.host))
            arm.fault("kill_program")  # one that nobody is there for any more goes on by itself
    finally:
        arm.close()
    ratios = [statistics.median(b) / statistics.median(a) for a, b in zip(quiet, loud, strict=True)]
    quiet_ms, loud_ms = (
        [statistics.median(part), statistics.quantiles(part, n=10)[-1], max(part)]
        for part in (list(chain(*quiet)), list(chain(*loud)))
    )
    print("\n| attack | quiet: median, 90 %, longest, ms | attacked | ratio, by block |")
    print(f"| {kind} | {_ms(quiet_ms)} | {_ms(loud_ms)} | {' '.join(f'{r:.2f}' for r in ratios)} |")
    for read, said, left in did:
        assert read > 0 and left == CLIENTS  # all of them were there, and were served
        assert (said > 0) == (kind == "compile")


def _ms(values: list[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
