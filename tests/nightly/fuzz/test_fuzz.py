"""Hostile clients on every port of an emulated cell, and a well-behaved client beside them.

`make test-fuzz MINUTES=60 SEED=1` attacks for an hour. The cell must live, answer everybody, not
grow, and end after SIGTERM. A failure prints the last cases, each a grammar and a seed.
"""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign.config import load_for_devices
from scenarios.rigs.cell_process import cell_process
from tests.nightly.fuzz.grammars import GRAMMARS, MOST_BYTES

MINUTES = float(os.environ.get("MINUTES", "0.7"))
SEED = int(os.environ.get("SEED", "7"))
FIRST = (("rtde", 6),)  # cases that found something once: a recipe at 5e-324 Hz ended the cell
ATTACKERS, BLOCK_S, QUIET_S = 6, 20.0, 8.0
PAUSE_S = 0.02  # between two connections of an attacker
CONNECTION_S = 0.5  # for one connection to send everything
MOST_GROWTH_MB = 150.0
# median wait beside the attack, of that without: other load of the machine makes several times;
# a cell that keeps others waiting makes hundreds
MOST_RATIO = 8.0
END_S = 30.0  # from SIGTERM

Case = tuple[str, int]
Ports = dict[str, list[tuple[str, int]]]


class Attack:
    """Threads that play cases until they are stopped."""

    def __init__(self, ports: Ports, seed: int, first: tuple[Case, ...]) -> None:
        self.last: deque[Case] = deque(maxlen=100)
        self._ports, self._first = ports, deque(first)
        self._random, self._lock, self._end = (
            random.Random(seed),
            threading.Lock(),
            threading.Event(),
        )
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
    """One connection: sends its pieces, reads or not, closes or resets. Raises OSError."""
    name, seed = case
    r = random.Random(seed)
    pieces = GRAMMARS[name](r)
    address, reads, waits_s = r.choice(ports[name]), r.random() < 0.7, r.choice((0.0, 0.0, 0.3))
    with socket.create_connection(address, 5.0) as sock, suppress(OSError):
        until = time.monotonic() + CONNECTION_S
        for piece in pieces:
            sock.settimeout(max(0.01, until - time.monotonic()))
            sock.sendall(piece)
            if reads:
                sock.settimeout(0.01)
                with suppress(TimeoutError):
                    sock.recv(1 << 16)
        time.sleep(waits_s)
        if r.random() < 0.3:  # reset in place of a close
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")


def ports_of(at: dict[str, Any]) -> Ports:
    host, arm = at["host"], at["arm"]
    board, _, port = at["tactile"]["url"].removeprefix("tcp://").rpartition(":")
    found = {
        "urscript": [(host, 30001), (host, 30002), (host, arm["script"])],
        "rtde": [(host, arm["rtde"])],
        "modbus": [(at["gripper"]["host"], at["gripper"]["port"])],
        "hop": [(board, int(port))],
        "dashboard": [(host, arm["dashboard"])],
        "control": [(at["control"]["host"], at["control"]["port"])],
        "faults": [(host, arm["faults"])],
    }
    return found | {"silence": [one for those in found.values() for one in those]}


def polite(endpoints: Path, seconds: float) -> dict[str, float]:
    """Median waits in ms, by port, of a well-behaved client in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tests.nightly.fuzz.polite", str(endpoints), str(seconds)],
        capture_output=True, text=True, timeout=seconds + 300, check=False,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-500:]
    found = json.loads(done.stdout)
    assert not found["errors"], f"unanswered: {found['errors']}"
    return dict(found["median_ms"])


def memory_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096 / 1e6


def ends_well(pid: int) -> bool:
    """Whether a child ends after SIGTERM with exit code 0; leaves it to be waited for."""
    os.kill(pid, signal.SIGTERM)
    until = time.monotonic() + END_S
    while time.monotonic() < until:
        end = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if end is not None:
            return (end.si_code, end.si_status) == (os.CLD_EXITED, 0)
        time.sleep(0.05)
    return False


@pytest.mark.timeout(600 + 180 * MINUTES)
def test_hostile_clients_of_all_ports_leave_a_cell_that_serves_the_others(tmp_path: Path) -> None:
    config, endpoints = load_for_devices("can", "emulated", [], []), tmp_path / "endpoints.json"
    last: list[Case] = []
    with cell_process(config, 0) as cell:
        endpoints.write_text(json.dumps(cell.endpoints))
        pid, ports, block = cell.endpoints["pid"], ports_of(cell.endpoints), 0
        quiet, least_mb = polite(endpoints, QUIET_S), memory_mb(pid)
        until = time.monotonic() + 60.0 * MINUTES
        try:
            while time.monotonic() < until:
                with Attack(ports, SEED * 1000 + block, () if block else FIRST) as attack:
                    loud = polite(endpoints, BLOCK_S)
                last, block = list(attack.last), block + 1
                after = polite(endpoints, QUIET_S / 2)
                ratios = {name: 2.0 * loud[name] / (quiet[name] + after[name]) for name in loud}
                assert max(ratios.values()) <= MOST_RATIO, ratios
                assert memory_mb(pid) - least_mb <= MOST_GROWTH_MB
                quiet = after
            assert ends_well(pid)
        except AssertionError:
            print("last cases:", *last)
            raise


@pytest.mark.parametrize("name", GRAMMARS)
def test_a_seed_sends_the_same_each_time_and_not_without_end(name: str) -> None:
    for seed in range(30):
        sent = GRAMMARS[name](random.Random(seed))
        assert sent == GRAMMARS[name](random.Random(seed))
        assert sum(map(len, sent)) <= 1.2 * MOST_BYTES
