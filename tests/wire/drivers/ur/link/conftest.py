"""Fixtures: unique addresses, an emulated controller in another process, and a link to it."""

import itertools
import os
import time
from pathlib import Path

import psutil
import pytest

from drivers.ur.link import messages
from tests.wire.drivers.ur.emulator.conftest import Emulated, running
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


class Emulator(Emulated):
    """The emulator, whose requests must succeed."""

    def do(self, verb, **options):
        reply = self.fault(do=verb, **options)
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


@pytest.fixture
def emulate(host):
    pytest.importorskip("rtde_control")
    with running(Emulator) as start:
        yield lambda profile="cb3": start("--profile", profile, host=host)
