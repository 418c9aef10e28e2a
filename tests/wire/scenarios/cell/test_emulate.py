"""`grasp emulate` as a process: its options, and clients of every device."""

import struct
from collections.abc import Iterator
from typing import Any

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from tests.wire.drivers.ur.emulator.test_process import Rtde
from tests.wire.lab import emulate
from tests.wire.waiting import until


@pytest.fixture(scope="module")
def endpoints() -> Iterator[dict[str, Any]]:
    with emulate("--rtu", "--profile", "e-series") as found:
        yield found


def test_gripper_is_served_on_tcp_and_on_a_serial_line(endpoints: dict[str, Any]) -> None:
    """It is the same hand: one client activates it, the other reads the active state."""
    at, line = endpoints["gripper"], endpoints["gripper_serial"]
    with ModbusTcpClient(at["host"], port=at["port"]) as client:
        client.write_registers(0, [0x0100], device_id=at["unit"])
        until(
            lambda: (
                client.read_input_registers(0, count=1, device_id=at["unit"]).registers[0] >> 8
                == 49
            )
        )
    with ModbusSerialClient(line["port"], timeout=10) as client:
        status = client.read_holding_registers(0x07D0, count=1, device_id=line["unit"])
        assert status.registers[0] >> 8 == 49


def test_arm_is_an_e_series_at_500_hz(endpoints: dict[str, Any]) -> None:
    with Rtde(endpoints["arm"]["host"]) as rtde:
        assert struct.unpack(">4I", rtde.request("v")[1])[0] == 5
        recipe = struct.pack(">d", 500.0) + b"timestamp,ft_raw_wrench"
        assert rtde.request("O", recipe) == ("O", b"\x01DOUBLE,VECTOR6D")
        rtde.request("S")
        stamps = [struct.unpack_from(">Bd", rtde.read()[1])[1] for _ in range(5)]
        assert 0.0079 < stamps[-1] - stamps[0] < 1.0
