"""The gripper on a serial line, over a pseudo-terminal: bytes first, then the driver."""

import time

import pytest
import serial

from drivers.errors import LinkLost
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.emulator import FaultKind, RtuEmulator, WireFault
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.model.gripper import GripperModel, HandSettings
from drivers.robotiq.settings import DriverSettings, ModbusSettings
from tests.calibrations import PAPER
from tests.wire.cases import case
from tests.wire.drivers.robotiq.rig import QUICK, FastClock
from tests.wire.waiting import until

ACTIVATE = "09 10 03 e8 00 03 06 01 00 00 00 00 00 72 e1"
ACTIVATED = "09 10 03 e8 00 03 01 30"
POLL = "09 03 07 d0 00 01 85 cf"


@pytest.fixture
def now():
    return [0]


@pytest.fixture
def emulator(now):
    with RtuEmulator(GripperModel(HandSettings(), 0), clock=lambda: now[0]) as emulator:
        yield emulator


@pytest.fixture
def line(emulator):
    with serial.Serial(emulator.port, 115200, timeout=10) as line:
        yield line


def ask(line: serial.Serial, text: str, count: int) -> str:
    line.write(bytes.fromhex(text))
    return line.read(count).hex(" ")


def test_the_activation_of_the_manual(line, now) -> None:
    assert ask(line, ACTIVATE, 8) == ACTIVATED
    now[0] = 2_500_000_000
    assert ask(line, POLL, 7) == "09 03 02 11 00 55 d5"
    now[0] = 7_000_000_000
    assert ask(line, POLL, 7) == "09 03 02 31 00 4c 15"


# The driver


@pytest.fixture
def quick():
    clock = FastClock(5)
    with RtuEmulator(GripperModel(QUICK, clock()), clock=clock) as emulator:
        yield emulator


@pytest.fixture
def transport(quick):
    settings = ModbusSettings(serial_port=quick.port, timeout_s=1.0)
    transport = ModbusTransport(settings, "rtu", reconnect_s=0.02)
    yield transport
    transport.close()


@pytest.fixture
def driver(transport):
    return RobotiqDriver(transport, DriverSettings(link="rtu"), PAPER)


def reach(driver: RobotiqDriver, true) -> None:
    def once() -> bool:
        driver.poll(time.monotonic_ns())
        return true(driver.state)

    until(once)


def test_activate_and_move(driver) -> None:
    driver.poll(time.monotonic_ns())
    driver.activate()
    reach(driver, lambda state: state.active and state.fresh)
    driver.move_to((60, 70, 80), 0.11, 10.0)
    reach(driver, lambda state: state.at_rest)
    assert driver.state.positions == (60, 70, 80)


def test_an_unanswered_request_is_a_lost_link_once(quick, driver) -> None:
    for kind in [FaultKind.DROP, FaultKind.GARBLE, FaultKind.EXCEPTION]:
        with case(kind):
            driver.poll(time.monotonic_ns())
            quick.faults.add(WireFault(kind=kind))
            with pytest.raises(LinkLost, match="does not answer"):
                driver.poll(time.monotonic_ns())
            until(lambda: replies(driver))


def replies(driver: RobotiqDriver) -> bool:
    try:
        driver.poll(time.monotonic_ns())
    except LinkLost:
        return False
    return True


def test_a_missing_serial_port_is_a_lost_link() -> None:
    transport = ModbusTransport(ModbusSettings(serial_port="/dev/no-such-port"), "rtu")
    with pytest.raises(LinkLost, match="/dev/no-such-port") as lost:
        transport.read(2000, 8, 0)
    assert "serial port" in lost.value.remedy
