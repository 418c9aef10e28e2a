"""The packaged drivers pass the conformance tests over real protocols, with the emulated devices
of the pytest plugin."""

import time
from collections.abc import Iterator
from typing import Any

import pytest

from drivers.interfaces import Arm, Gripper, TactileSensor
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.link import ReadingThread
from drivers.ur.driver import ArmDriver
from drivers.ur.link.client import UrLink
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.wired import board_finder, wired_gripper
from tests import conformance
from tests.conformance import Bench

NOW = time.monotonic_ns
PRESSED_COUNTS = 100


def settings(*assignments: str) -> RunConfig:
    return load_config("can", "emulated", "energy", None, assignments)


def bench_of(device: Any, **more: Any) -> Bench[Any]:
    return Bench(device, NOW, time.sleep, **more)


class TestRobotiqOverModbus(conformance.GripperConformance):
    @pytest.fixture
    def bench(self, emulated_gripper: Any) -> Iterator[Bench[Gripper]]:
        """A hand without an object, over Modbus TCP."""
        config = settings(
            f"modbus.host={emulated_gripper.host}", f"modbus.port={emulated_gripper.port}"
        )
        with wired_gripper(config, NOW) as gripper:
            yield bench_of(gripper, cut=emulated_gripper.emulator.stop)


class TestTakkTileOverUsb(conformance.FingertipConformance):
    @pytest.fixture
    def bench(self, emulated_board: Any) -> Iterator[Bench[TactileSensor]]:
        config = settings(f"usb.url={emulated_board.url}", "usb.serial=any")
        reading = ReadingThread(board_finder(config, NOW), config.tactile, NOW)

        def press() -> None:
            for column in range(self.taxels):
                emulated_board.press(0, column, PRESSED_COUNTS)

        with TakkTileDriver(reading, config.tactile) as sensor:
            yield bench_of(sensor, cut=lambda: emulated_board.fault("unplug"), press=press)


class TestUniversalRobotsOverRtde(conformance.ArmConformance):
    @pytest.fixture
    def bench(self, emulated_arm: Any) -> Iterator[Bench[Arm]]:
        config = settings(f"ur.host={emulated_arm.host}")
        with UrLink(config.ur) as link:
            yield bench_of(ArmDriver(link, config.arm), cut=emulated_arm.close)
