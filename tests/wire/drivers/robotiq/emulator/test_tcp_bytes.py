"""The emulator on Modbus TCP, byte by byte over plain sockets."""

import socket

import pytest

from drivers.robotiq.emulator import FaultKind, GripperEmulator, WireFault
from drivers.robotiq.model.gripper import GripperModel, HandSettings
from tests.wire.cases import case

FROZEN = HandSettings()


def stopped_clock() -> int:
    """A stopped clock: only requests change the hand."""
    return 0


class Wire:
    """A bare socket."""

    def __init__(self, emulator: GripperEmulator) -> None:
        self.socket = socket.create_connection(emulator.address, timeout=10)

    def send(self, text: str) -> None:
        self.socket.sendall(bytes.fromhex(text))

    def receive(self, count: int) -> str:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            if not more:
                raise ConnectionResetError("closed")
            data += more
        return data.hex(" ")

    def ask(self, text: str, count: int) -> str:
        self.send(text)
        return self.receive(count)

    def closed(self) -> bool:
        try:
            return self.socket.recv(1) == b""
        except ConnectionResetError:
            return True


@pytest.fixture
def now():
    """A clock that the test sets, in a list of one; at 2.5 s an activated hand is closing."""
    return [0]


@pytest.fixture
def emulator(now):
    with GripperEmulator(GripperModel(FROZEN, 0), clock=lambda: now[0]) as emulator:
        yield emulator


@pytest.fixture
def dial():
    """Connect to an emulator."""
    made: list[Wire] = []

    def connect(emulator: GripperEmulator) -> Wire:
        made.append(Wire(emulator))
        return made[-1]

    yield connect
    for wire in made:
        wire.socket.close()


@pytest.fixture
def wire(emulator, dial):
    return dial(emulator)


ACTIVATE = "33 9a 00 00 00 0d 02 10 00 00 00 03 06 01 00 00 00 00 00"
POLL = "45 33 00 00 00 06 02 04 00 00 00 01"


def test_the_activation_of_the_manual(wire, now) -> None:
    assert wire.ask(ACTIVATE, 12) == "33 9a 00 00 00 06 02 10 00 00 00 03"
    now[0] = 2_500_000_000
    assert wire.ask(POLL, 11) == "45 33 00 00 00 05 02 04 02 11 00"
    now[0] = 7_000_000_000
    assert wire.ask(POLL, 11) == "45 33 00 00 00 05 02 04 02 31 00"


def test_every_unit_number_gets_a_reply_with_that_number(wire) -> None:
    for unit in ["00", "02", "09", "ff"]:
        with case(unit):
            answer = wire.ask(f"00 07 00 00 00 06 {unit} 04 00 00 00 02", 13)
            assert answer == f"00 07 00 00 00 07 {unit} 04 04 00 00 00 00"


def test_invalid_requests_get_exception_replies(wire) -> None:
    for request_pdu, exception in [
        ("03 00 00 00 08", "83 01"),  # holding registers: not over TCP
        ("04 00 00 00 09", "84 02"),
        ("04 07 d0 00 08", "84 02"),  # addresses of RTU
        ("10 03 e8 00 01 02 00 00", "90 02"),
        ("10 00 07 00 02 04 00 00 00 00", "90 02"),
        ("10 00 00 00 02 02 00 00", "90 03"),
    ]:
        with case(request_pdu, exception):
            length = len(bytes.fromhex(request_pdu)) + 1
            assert wire.ask(f"12 34 00 00 {length:04x} 02 {request_pdu}", 9) == (
                f"12 34 00 00 00 03 02 {exception}"
            )
            assert wire.ask(POLL, 11).startswith("45 33"), "the connection stays open"


# Injected faults


def test_a_request_with_a_dropped_reply_is_executed(emulator, wire, now) -> None:
    emulator.faults.add(WireFault(kind=FaultKind.DROP, function=16))
    wire.send(ACTIVATE)
    assert wire.ask(POLL, 11).startswith("45 33"), "the next reply is that of the next request"
    now[0] = 2_500_000_000
    assert wire.ask(POLL, 11).endswith("11 00")


def test_a_request_with_a_disconnect_is_not_executed(emulator, wire, now, dial) -> None:
    emulator.faults.add(WireFault(kind=FaultKind.DISCONNECT, function=16))
    wire.send(ACTIVATE)
    assert wire.closed()
    now[0] = 2_500_000_000
    other = dial(emulator)
    assert other.ask(POLL, 11).endswith("00 00")


def test_a_request_with_an_exception_is_not_executed(emulator, wire, now) -> None:
    emulator.faults.add(WireFault(kind=FaultKind.EXCEPTION, function=16, code=4))
    assert wire.ask(ACTIVATE, 9) == "33 9a 00 00 00 03 02 90 04"
    now[0] = 2_500_000_000
    assert wire.ask(POLL, 11).endswith("00 00")


def test_a_frozen_gripper_executes_requests_late_and_in_order(emulator, wire, now) -> None:
    emulator.faults.add(WireFault(kind=FaultKind.FREEZE, seconds=0.3))
    wire.send(ACTIVATE + POLL)
    wire.socket.settimeout(0.05)
    with pytest.raises(TimeoutError):
        wire.receive(1)
    wire.socket.settimeout(10)
    assert wire.receive(12).startswith("33 9a")
    assert wire.receive(11).startswith("45 33")


def test_an_injected_device_fault_shows_in_the_status(emulator, wire, now) -> None:
    emulator.faults.add(WireFault(kind=FaultKind.DEVICE_FAULT, code=0x0D))
    wire.ask(POLL, 11)
    now[0] = 2_500_000_000
    assert wire.ask("00 01 00 00 00 06 02 04 00 00 00 02", 13).split()[11] == "0d"


def test_faults_are_injected_by_count_and_by_time(emulator, wire, now) -> None:
    emulator.faults.add(WireFault(kind=FaultKind.EXCEPTION, code=6, skip=2, times=2))
    lengths = []
    for _ in range(6):
        wire.send(POLL)
        lengths.append(int(wire.receive(6)[-2:], 16))
        wire.receive(lengths[-1])
    assert lengths == [5, 5, 3, 3, 5, 5]
    emulator.faults.add(WireFault(kind=FaultKind.EXCEPTION, code=6, from_ns=50))
    assert wire.ask(POLL, 11)
    now[0] = 50
    assert wire.ask(POLL, 9).endswith("84 06")


# Stop


def test_stop_closes_connected_clients(dial) -> None:
    with GripperEmulator(FROZEN, clock=stopped_clock) as emulator:
        made = dial(emulator)
        made.send("00 01 00")  # half a request
    assert made.closed()
