"""`grasp emulate` as a process: its options, and clients of every device."""

import json
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from tests.wire.drivers.ur.emulator.test_process import Rtde
from tests.wire.scenarios.cell.modbus_clients import NOT_INSTALLED

ROOT = Path(__file__).parents[4]
APP = "import sys; from grasp.cli.main import main; sys.exit(main())"
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def endpoints() -> Iterator[dict[str, Any]]:
    command = [sys.executable, "-P", "-c", APP, "emulate", "--rtu", "--profile", "e-series"]
    cell = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    yield json.loads(cell.stdout.readline())
    cell.send_signal(signal.SIGTERM)
    assert cell.wait(PATIENCE_S) == 0
    cell.stdout.close()


def test_gripper_answers_on_tcp_and_on_a_serial_line(endpoints) -> None:
    """One hand: what one client activates, the other sees activated."""
    at, line = endpoints["gripper"], endpoints["gripper_serial"]
    with ModbusTcpClient(at["host"], port=at["port"]) as client:
        client.write_registers(0, [0x0100], device_id=at["unit"])
        deadline = time.monotonic() + PATIENCE_S
        while client.read_input_registers(0, count=1, device_id=at["unit"]).registers[0] >> 8 != 49:
            assert time.monotonic() < deadline
            time.sleep(0.05)
    with ModbusSerialClient(line["port"], timeout=5) as client:
        status = client.read_holding_registers(0x07D0, count=1, device_id=line["unit"])
        assert status.registers[0] >> 8 == 49


@pytest.mark.parametrize("client", ["pymodbustcp", "umodbus", "modbus_tk", "minimalmodbus"])
def test_client_of_the_package_index_activates_the_hand_moves_it_and_reads_back(
    endpoints, client
) -> None:
    """Skipped where it is not installed: this project does not need it."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.wire.scenarios.cell.modbus_clients", client,
         json.dumps(endpoints)],
        cwd=ROOT, capture_output=True, text=True, timeout=350.0, check=False,
    )  # fmt: skip
    if done.returncode == NOT_INSTALLED:
        pytest.skip(done.stdout)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_arm_is_an_e_series_at_500_hz(endpoints) -> None:
    with Rtde(endpoints["arm"]["host"]) as rtde:
        assert struct.unpack(">4I", rtde.ask("v")[1])[0] == 5
        recipe = struct.pack(">d", 500.0) + b"timestamp,ft_raw_wrench"
        assert rtde.ask("O", recipe) == ("O", b"\x01DOUBLE,VECTOR6D")
        rtde.ask("S")
        stamps = [struct.unpack_from(">Bd", rtde.read()[1])[1] for _ in range(5)]
        assert stamps[-1] - stamps[0] == pytest.approx(0.008)
