"""Hostile clients on every port of the emulated devices, together with a well-behaved client.

`make test-fuzz MINUTES=60 SEED=1` runs for an hour. The cell must keep running, reply to every
valid request, not grow in memory, and end after SIGTERM. A failure prints the last cases, each a
grammar and a seed.
"""

import json
import os
import random
import signal
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from drivers.takktile.emulator import bus
from drivers.takktile.emulator.bus import BusReply, BusRequest, Op
from drivers.ur.emulator.rtde import PacketType, packet
from scenarios.campaign.config import load_for_devices
from scenarios.rigs.emulated import cell_process
from tests.nightly.fuzz.grammars import GRAMMARS, pieces

MINUTES = float(os.environ.get("MINUTES", "0.7"))
SEED = int(os.environ.get("SEED", "7"))
FIRST = (("rtde", 6),)  # cases that have found an error
ATTACKERS = 6
PAUSE_S, EACH_S = 0.02, 0.1  # between connections of an attacker, and valid requests
CONNECTION_S = 0.5  # for one connection to send everything
REPLY_S = 20.0  # generous for a busy machine
MAX_GROWTH_MB = 150.0
END_S = 30.0  # from SIGTERM

Case = tuple[str, int]
Ports = dict[str, list[tuple[str, int]]]


class Attack:
    """Threads that run cases until they are stopped."""

    def __init__(self, ports: Ports) -> None:
        self.last: deque[Case] = deque(maxlen=100)
        self._ports, self._first = ports, deque(FIRST)
        self._random, self._lock = random.Random(SEED), threading.Lock()
        self._end = threading.Event()
        self._threads = [threading.Thread(target=self._play) for _ in range(ATTACKERS)]

    def __enter__(self) -> "Attack":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        for thread in self._threads:
            thread.join()

    def _next(self) -> Case:
        with self._lock:
            if self._first:
                return self._first.popleft()
            return self._random.choice(sorted(GRAMMARS)), self._random.randrange(2**31)

    def _play(self) -> None:
        while not self._end.wait(PAUSE_S):
            case = self._next()
            with suppress(OSError):
                play(self._ports, case)
            self.last.append(case)


def play(ports: Ports, case: Case) -> None:
    """Open a connection and send the pieces; reads, waits, closes or resets at random."""
    name, seed = case
    r = random.Random(seed)
    data = pieces(name, r)
    with socket.create_connection(r.choice(ports[name]), 5.0) as sock, suppress(OSError):
        reads, until = r.random() < 0.7, time.monotonic() + CONNECTION_S
        for piece in data:
            sock.settimeout(max(0.01, until - time.monotonic()))
            sock.sendall(piece)
            if reads:
                sock.settimeout(0.01)
                with suppress(TimeoutError):
                    sock.recv(1 << 16)
        time.sleep(r.choice((0.0, 0.0, 0.3)))
        if r.random() < 0.3:  # reset in place of a close
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")


def ports_of(at: dict[str, Any]) -> Ports:
    host, arm = at["host"], at["arm"]
    board, _, port = at["tactile"]["url"].removeprefix("tcp://").rpartition(":")
    return {
        "urscript": [(host, arm["script"])],
        "rtde": [(host, arm["rtde"])],
        "modbus": [(at["gripper"]["host"], at["gripper"]["port"])],
        "usb": [(board, int(port))],
        "dashboard": [(host, arm["dashboard"])],
    }


def requests(ports: Ports, stack: ExitStack) -> dict[str, Callable[[], object]]:
    """Requests of a well-behaved client, with one open connection to each port; each call returns
    after its reply, or raises."""
    lines = ("dashboard", "modbus", "usb", "rtde")
    socks = {
        name: stack.enter_context(socket.create_connection(ports[name][0], REPLY_S))
        for name in lines
    }
    files = {name: stack.enter_context(sock.makefile("rb")) for name, sock in socks.items()}

    def request(name: str, data: bytes, begins: bytes) -> None:
        socks[name].sendall(data)
        reply = files[name].read(11) if name == "modbus" else files[name].readline()
        assert reply.startswith(begins), f"{name}: replied {reply[:80]!r}"

    def version() -> None:
        """Request the version; its reply arrives within a stream."""
        socks["rtde"].sendall(packet(PacketType.CONTROLLER_VERSION))
        kind = 0
        while kind != PacketType.CONTROLLER_VERSION:
            size, kind = struct.unpack(">HB", files["rtde"].read(3))
            files["rtde"].read(size - 3)

    def list_boards() -> None:
        bus.send(socks["usb"], BusRequest(Op.LIST))
        bus.receive(socks["usb"], BusReply)

    files["dashboard"].readline()
    outputs = struct.pack(">d", 125.0) + b"timestamp,actual_q,actual_TCP_pose,robot_mode"
    socks["rtde"].sendall(packet(PacketType.OUTPUTS, outputs) + packet(PacketType.START))
    read = bytes.fromhex("000100000006020400000001")
    return {
        "dashboard": lambda: request("dashboard", b"robotmode\n", b"Robotmode"),
        "modbus": lambda: request("modbus", read, b"\0\1\0\0\0\5\2\4\2"),
        "usb": list_boards,
        "rtde": version,
    }


def memory_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096 / 1e6


def ends_cleanly(pid: int) -> bool:
    """Whether a child ends after SIGTERM with exit code 0; it is not reaped here."""
    os.kill(pid, signal.SIGTERM)
    until = time.monotonic() + END_S
    while time.monotonic() < until:
        end = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if end is not None:
            return (end.si_code, end.si_status) == (os.CLD_EXITED, 0)
        time.sleep(0.05)
    return False


@pytest.mark.timeout(300 + 120 * MINUTES)
def test_hostile_clients_on_all_ports_do_not_disturb_a_well_behaved_client() -> None:
    config = load_for_devices("can", "emulated", [], [])
    with cell_process(config, 0) as cell, ExitStack() as stack:
        pid, ports = cell.endpoints["pid"], ports_of(cell.endpoints)
        requests_of_client, least_mb = requests(ports, stack), memory_mb(pid)
        until = time.monotonic() + 60.0 * MINUTES
        attack = Attack(ports)
        try:
            with attack:
                while time.monotonic() < until:
                    for name, request in requests_of_client.items():
                        try:
                            request()
                        except (OSError, struct.error) as error:
                            pytest.fail(f"{name} did not reply: {error!r}")
                        time.sleep(EACH_S / len(requests_of_client))
                    assert memory_mb(pid) - least_mb <= MAX_GROWTH_MB
            assert ends_cleanly(pid)
        except BaseException:
            print("last cases:", json.dumps(list(attack.last)))
            raise
