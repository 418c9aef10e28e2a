"""Fixtures: unique addresses, an emulated controller in another process, and a link to it."""

import itertools
import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from drivers.ur.link import messages
from tests.wire.drivers.ur.link.scripted import ScriptedController

ROOT = Path(__file__).parents[5]
_NUMBERS = itertools.count(1)
TARGET = (0.5, 0.1, 0.4, 3.1, 0.0, 0.0)
SETUP = messages.Setup(
    host="127.0.0.2",
    tcp_offset=(0.0,) * 6,
    payload_kg=2.6,
    cog_m=(0.0, 0.0, 0.05),
    upper_registers=False,
    watchdog_hz=10.0,
    heartbeat_timeout_s=0.2,
    link_timeout_s=1.0,
    brake_timeout_s=2.0,
    client_pid=os.getppid(),  # of code that runs in this process
)


def workers(parent=None):
    """Process ids of the workers that this process, or another one, has started for a link."""
    started = psutil.Process(parent).children()
    return [each.pid for each in started if "drivers.ur.link" in " ".join(each.cmdline())]


@pytest.fixture
def host():
    """A loopback address that is unlikely to be used by another test or run."""
    return f"127.{20 + os.getpid() % 200}.77.{next(_NUMBERS)}"


@pytest.fixture
def controller(host):
    made = []

    def make(**options):
        made.append(ScriptedController(host, **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


class Emulator:
    """Process of the emulator, with its control channel."""

    def __init__(self, host, profile):
        command = [sys.executable, "-m", "drivers.ur.emulator"]
        self.host = host
        self.process = subprocess.Popen(
            [*command, "--host", host, "--profile", profile], cwd=ROOT, stdout=subprocess.PIPE
        )
        self.ready = json.loads(self.process.stdout.readline())
        self._socket = socket.create_connection((host, self.ready["fault_port"]), timeout=20)
        self._lines = self._socket.makefile("rw")

    def do(self, verb, **options):
        self._lines.write(json.dumps({"do": verb, **options}) + "\n")
        self._lines.flush()
        reply = json.loads(self._lines.readline())
        assert reply["ok"], reply
        return reply

    def state_when(self, condition, timeout_s=15.0):
        deadline = time.monotonic() + timeout_s
        while True:
            state = self.do("state")
            if condition(state):
                return state
            assert time.monotonic() < deadline, state
            time.sleep(0.01)

    def close(self):
        self._lines.close()
        self._socket.close()
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


@pytest.fixture
def emulate(host):
    pytest.importorskip("rtde_control")
    pytest.importorskip("drivers.ur.emulator")
    running = []

    def make(profile="cb3"):
        running.append(Emulator(host, profile))
        return running[-1]

    yield make
    for emulator in running:
        emulator.close()
