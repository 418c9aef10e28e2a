"""An emulator process on its own address, and real clients in their own processes.

ur_rtde can hang or crash its interpreter, so no test loads it: each scenario of `clients.py` runs
in a subprocess with a deadline.
"""

import importlib.util
import itertools
import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.wire.drivers.ur.emulator.bench import Bench

ROOT = Path(__file__).parents[5]
CLIENTS = Path(__file__).with_name("clients.py")
DEADLINE_S = 180.0
_numbers = itertools.count(2)


class Emulated:
    """A running emulator: its address, its control channel, and clients that connect to it."""

    def __init__(self, process: subprocess.Popen[str], host: str, fault_port: int) -> None:
        self.process = process
        self.host = host
        self.fault_port = fault_port

    def fault(self, **request):
        address = (self.host, self.fault_port)
        with socket.create_connection(address, timeout=10.0) as sock, sock.makefile("rw") as lines:
            lines.write(json.dumps(request) + "\n")
            lines.flush()
            return json.loads(lines.readline())

    def client(self, scenario: str) -> str:
        """Run one scenario of clients.py; fails the test with all its output."""
        if importlib.util.find_spec("rtde_control") is None:
            pytest.skip("ur_rtde is not installed")
        command = [sys.executable, str(CLIENTS), scenario, self.host, str(self.fault_port)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=DEADLINE_S, check=False
            )
        except subprocess.TimeoutExpired as error:
            pytest.fail(f"{scenario} did not end: {error.stdout!r} {error.stderr!r}")
        shown = f"{done.stdout}\n{done.stderr}\n{self.fault(do='state')}"
        assert done.returncode == 0, shown
        return shown


def own_address() -> str:
    """A loopback address that no test running at the same time uses."""
    pid = os.getpid()
    return f"127.{20 + pid % 200}.{pid // 200 % 250}.{next(_numbers) % 250 + 2}"


@contextmanager
def running(kind: type[Emulated]) -> Iterator[Callable[..., Emulated]]:
    """Start emulators; all end with the context."""
    processes: list[subprocess.Popen[str]] = []

    def start(*arguments: str, host: str | None = None) -> Emulated:
        host = host or own_address()
        command = [sys.executable, "-m", "drivers.ur.emulator", "--host", host, *arguments]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        processes.append(process)
        return kind(process, host, json.loads(process.stdout.readline())["fault_port"])

    yield start
    for process in processes:
        process.terminate()
        process.wait(DEADLINE_S)
        process.stdout.close()


@pytest.fixture
def emulate() -> Iterator[Callable[..., Emulated]]:
    with running(Emulated) as start:
        yield start


@pytest.fixture
def emulator(emulate) -> Emulated:
    """The default emulator: a UR10 of the CB3 series at 125 Hz, unlocked without delay."""
    return emulate("--unlock-delay", "0")


@pytest.fixture
def bench():
    return Bench()
