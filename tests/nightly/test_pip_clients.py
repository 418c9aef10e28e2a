"""Clients that pip installs and this project does not need: skipped where they are not there."""

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from tests.nightly.pip_clients import NOT_INSTALLED
from tests.wire.drivers.ur.emulator.conftest import Emulated
from tests.wire.lab import ENVIRONMENT, ROOT, emulate

WITHIN_S = 350.0


def played(module: str, *words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", f"tests.nightly.{module}", *words], cwd=ROOT, env=ENVIRONMENT,
        capture_output=True, text=True, timeout=WITHIN_S, check=False,
    )  # fmt: skip
    if done.returncode == NOT_INSTALLED:
        pytest.skip(done.stdout)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize(
    "scenario", ["urx_moves", "urx_waits", "urx_speeds", "urx_real_time", "record", "urinterface"]
)
def test_client_of_the_arm_does_what_the_page_says(emulator: Emulated, scenario: str) -> None:
    played("pip_clients", scenario, emulator.host, str(emulator.fault_port))


@pytest.fixture(scope="module")
def endpoints() -> Iterator[dict[str, Any]]:
    with emulate("--rtu") as found:
        yield found


@pytest.mark.parametrize("client", ["pymodbustcp", "umodbus", "modbus_tk", "minimalmodbus"])
def test_client_of_the_gripper_activates_the_hand_moves_it_and_reads_back(
    endpoints: dict[str, Any], client: str
) -> None:
    played("modbus_clients", client, json.dumps(endpoints))
