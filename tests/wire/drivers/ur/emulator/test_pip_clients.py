"""Clients that pip installs and this project does not need: skipped where they are not there."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.wire.drivers.ur.emulator.pip_clients import NOT_INSTALLED

CLIENTS = Path(__file__).with_name("pip_clients.py")


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "scenario", ["urx_moves", "urx_waits", "urx_speeds", "urx_real_time", "record", "urinterface"]
)
def test_client_does_what_the_page_says(emulator, scenario):
    done = subprocess.run(
        [sys.executable, str(CLIENTS), scenario, emulator.host, str(emulator.fault_port)],
        capture_output=True, text=True, timeout=250.0, check=False,
    )  # fmt: skip
    if done.returncode == NOT_INSTALLED:
        pytest.skip(done.stdout)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}\n{emulator.fault(do='state')}"
