"""The real driver against the emulator, over TCP."""

import time

import pytest

from drivers.errors import LinkLost
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.emulator import FaultKind, WireFault
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.settings import DriverSettings, ModbusSettings
from tests.calibrations import PAPER
from tests.wire.drivers.robotiq.rig import TIMEOUT_S

FAST = 0.11
LINK_FAULTS = [FaultKind.DROP, FaultKind.GARBLE, FaultKind.DISCONNECT, FaultKind.EXCEPTION]


def force_bytes(written: bytes) -> set[int]:
    return {written[5], written[8], written[11], written[14]}


# The link


def test_reconnection_after_a_lost_link_moves_nothing(joined) -> None:
    served, client = joined()
    client.driver.move_to((200, 200, 200), 0.022, 10.0)
    client.poll_until(lambda: client.state.fresh and client.state.positions[0] > 12)
    served.emulator.disconnect()
    with pytest.raises(LinkLost):
        client.poll_until(lambda: bool(client.errors) and raised(client.errors.pop()))
    before = len(served.writes)
    client.poll_until(lambda: client.driver.statistics.reconnects == 1)
    client.settle()
    holding = served.writes[before:]
    assert holding, "the moving hand is commanded to hold"
    assert {written[3] for written in holding} != {200}, "nothing is sent again"
    assert all(force_bytes(written) == {0} for written in holding)
    assert max(client.state.positions) < 200
    assert client.transport.connections == 2


def raised(error: Exception) -> bool:
    raise error


@pytest.mark.parametrize("function", [4, 16])
@pytest.mark.parametrize("kind", LINK_FAULTS)
def test_every_failure_is_a_lost_link_with_a_remedy(joined, kind, function: int) -> None:
    served, client = joined()
    served.emulator.faults.add(WireFault(kind=kind, function=function))
    client.driver.move_to((60, 60, 60), FAST, 10.0)
    with pytest.raises(LinkLost) as lost:
        for _ in range(3):
            client.poll()
            time.sleep(0.01)
    assert lost.value.remedy
    assert client.driver.statistics.link_losses == 1
    client.poll_until(lambda: client.driver.statistics.reconnects == 1)
    assert client.driver.statistics.resynced == 1
    client.driver.move_to((50, 50, 50), FAST, 10.0)
    client.settle()
    assert client.state.positions == (50, 50, 50)


def test_a_late_reply_is_not_taken_for_the_next(joined) -> None:
    served, client = joined()
    served.emulator.faults.add(WireFault(kind=FaultKind.DELAY, seconds=1.5 * TIMEOUT_S))
    with pytest.raises(LinkLost, match="does not answer"):
        client.transport.read(0, 1, 0)
    assert len(client.transport.read(0, 8, 0)) == 8
    time.sleep(TIMEOUT_S)
    assert len(client.transport.read(0, 3, 0)) == 3
    assert client.transport.connections == 1


def test_a_connection_closed_between_requests_is_detected_before_the_next(joined) -> None:
    served, client = joined()
    served.emulator.disconnect()
    time.sleep(0.05)
    before = len(served.frames)
    client.driver.move_to((60, 60, 60), FAST, 10.0)
    with pytest.raises(LinkLost, match="closed"):
        client.poll()
    assert len(served.frames) == before, "nothing was sent over a new connection without notice"


def test_a_connection_closed_by_pymodbus_is_not_renewed_silently(joined) -> None:
    served, client = joined()
    client.transport.close()  # as pymodbus does by itself
    before = len(served.frames)
    with pytest.raises(LinkLost, match="closed"):
        client.poll()
    assert len(served.frames) == before
    client.poll_until(lambda: client.driver.statistics.reconnects == 1)


def test_a_silent_peer_costs_one_timeout_and_no_retries(serve, connect) -> None:
    """Without settings pymodbus waits 3 s and tries four times: 12 s for one read."""
    served = serve()
    client = connect(served)
    client.poll_until(lambda: client.state is not None)
    served.emulator.faults.add(WireFault(kind=FaultKind.DROP, times=1000))
    before = served.emulator.requests
    with pytest.raises(LinkLost):
        client.poll()
    assert served.emulator.requests == before + 1, "asked once"


def test_unreachable_gripper_is_a_lost_link() -> None:
    settings = ModbusSettings(host="127.0.0.1", port=1)
    transport = ModbusTransport(settings, reconnect_s=0.5)
    driver = RobotiqDriver(transport, DriverSettings(), PAPER)
    for _ in range(3):
        with pytest.raises(LinkLost, match=r"127\.0\.0\.1:1") as lost:
            driver.poll(0)
    assert "address" in lost.value.remedy
