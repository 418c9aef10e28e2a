"""Modbus transport: replies and failures of a pymodbus client, without a wire."""

from collections.abc import Sequence
from typing import Any

import pytest
from pymodbus.exceptions import ModbusIOException

from drivers.errors import LinkLost
from drivers.robotiq import modbus
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.settings import ModbusSettings

S = 1_000_000_000


class Reply:
    def __init__(self, function: int, address: int = 0, count: int = 0, error: int = 0) -> None:
        self.function_code, self.address, self.count = function, address, count
        self.registers = [7] * count
        self.exception_code = error

    def isError(self) -> bool:
        return self.exception_code != 0


class Port:
    """A serial line with unrequested input."""

    flushed = 0

    def reset_input_buffer(self) -> None:
        self.flushed += 1


class Client:
    """Stand-in for pymodbus's client; replies correctly unless ``replies`` has other ones."""

    made: Any = None

    def __init__(self, *where: Any, **how: Any) -> None:
        self.where, self.how = where, how
        self.connected = False
        self.reachable = True
        self.connects = 0
        self.closes = 0
        self.socket: Any = None
        self.requests: list[tuple[Any, ...]] = []
        self.replies: list[Reply | Exception] = []
        Client.made = self

    def connect(self) -> bool:
        self.connects += 1
        self.connected = self.reachable
        return self.connected

    def close(self) -> None:
        self.closes += 1
        self.connected = False

    def _reply(self, correct: Reply) -> Reply:
        reply = self.replies.pop(0) if self.replies else correct
        if isinstance(reply, Exception):
            raise reply
        return reply

    def write_registers(self, first: int, values: Sequence[int], device_id: int) -> Reply:
        self.requests.append(("write", first, tuple(values), device_id))
        return self._reply(Reply(16, first, len(values)))

    def read_input_registers(self, first: int, count: int, device_id: int) -> Reply:
        self.requests.append(("input", first, count, device_id))
        return self._reply(Reply(4, first, count))

    def read_holding_registers(self, first: int, count: int, device_id: int) -> Reply:
        self.requests.append(("holding", first, count, device_id))
        return self._reply(Reply(3, first, count))


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modbus, "ModbusTcpClient", Client)
    monkeypatch.setattr(modbus, "ModbusSerialClient", Client)


def tcp(**settings: Any) -> tuple[ModbusTransport, Client]:
    where = {"host": "gripper", "port": 1502, "timeout_s": 0.2}
    return ModbusTransport(ModbusSettings(**where | settings), reconnect_s=0.5), Client.made


def lost(transport: ModbusTransport, now_ns: int = 0) -> str:
    with pytest.raises(LinkLost) as error:
        transport.read(0, 8, now_ns)
    return error.value.message.removeprefix("the gripper at gripper:1502 ")


@pytest.mark.usefixtures("line")
def test_requests_use_the_unit_and_the_functions_of_the_gripper() -> None:
    transport, client = tcp()
    assert (client.where, client.how) == (
        ("gripper",),
        {"port": 1502, "timeout": 0.2, "retries": 0},
    )
    assert client.connects == 0
    transport.write(3, (1, 2), 0)
    assert transport.read(2, 3, 0) == [7, 7, 7]
    assert client.requests == [("write", 3, (1, 2), 2), ("input", 2, 3, 2)]
    assert client.connects == transport.connections == 1


@pytest.mark.usefixtures("line")
def test_serial_line_uses_115200_baud_and_function_3_and_is_flushed_before_a_request() -> None:
    settings = ModbusSettings(serial_port="/dev/hand", slave=11, timeout_s=0.2)
    transport, client = ModbusTransport(settings, "rtu"), Client.made
    assert client.where == ("/dev/hand",)
    assert client.how == {"baudrate": 115200, "timeout": 0.2, "retries": 0}
    transport.read(0, 2, 0)
    client.socket = Port()
    transport.write(3, (1,), 0)
    assert client.requests == [("holding", 0, 2, 11), ("write", 3, (1,), 11)]
    assert client.socket.flushed == 1
    client.replies = [ModbusIOException("silence")]
    with pytest.raises(LinkLost, match="/dev/hand does not answer"):
        transport.read(0, 2, 0)
    assert client.closes == 1, "a late reply would be taken for the next"


@pytest.mark.usefixtures("line")
def test_an_invalid_reply_is_reported_and_keeps_the_connection() -> None:
    for reply, says in (
        (Reply(4, 0, 8, error=2), "replied with exception 2 to function 4"),
        (Reply(3, 0, 8), "replied with function 3 to function 4"),
        (ValueError("odd"), "does not answer"),
    ):
        transport, client = tcp()
        client.replies = [reply]
        assert lost(transport) == says
        assert client.closes == 0, says
        assert len(transport.read(0, 8, 0)) == 8, says
    for other in (Reply(16, 4, 2), Reply(16, 3, 1)):
        client.replies = [other]
        with pytest.raises(LinkLost, match="acknowledged registers that were not written"):
            transport.write(3, (1, 2), 0)


@pytest.mark.usefixtures("line")
def test_connection_is_closed_after_three_unanswered_requests_in_a_row() -> None:
    transport, client = tcp()
    transport.read(0, 8, 0)
    for round_ in range(2):
        client.replies = [ModbusIOException("silence")] * 2
        assert [lost(transport) for _ in range(2)] == ["does not answer"] * 2
        assert len(transport.read(0, 8, 0)) == 8, f"one reply is enough, {round_}"
    client.replies = [ModbusIOException("silence")] * 3
    assert [lost(transport) for _ in range(3)] == ["does not answer"] * 3
    assert client.closes == 1
    client.replies = [ModbusIOException("silence")] * 2
    assert [lost(transport, S) for _ in range(2)] == ["does not answer"] * 2
    assert client.closes == 1, "counted from 0 on a new connection"


@pytest.mark.usefixtures("line")
def test_broken_connection_is_closed_at_once_and_reopened_by_a_later_call() -> None:
    transport, client = tcp()
    transport.read(0, 8, 0)
    client.replies = [ConnectionResetError("gone")]
    assert lost(transport) == "closed the connection"
    assert (client.closes, client.connects) == (1, 1)
    assert lost(transport, S // 2 - 1) == "does not answer", "so soon after the last attempt"
    assert client.connects == 1
    transport.read(0, 8, S // 2)
    assert client.connects == transport.connections == 2


class Socket:
    """A socket with unrequested input, or closed by the other side."""

    def __init__(self, *chunks: bytes, closed: bool = False) -> None:
        self.chunks, self._closed = list(chunks), closed
        self.blocking: bool | None = None

    def setblocking(self, flag: bool) -> None:
        self.blocking = flag

    def recv(self, most: int) -> bytes:
        assert most == 4096
        if self.chunks:
            return self.chunks.pop(0)
        if self._closed:
            return b""
        raise BlockingIOError


@pytest.mark.usefixtures("line")
def test_unrequested_input_is_discarded_and_a_closed_socket_is_detected() -> None:
    transport, client = tcp()
    client.socket = Socket(b"late", b"later")
    transport.read(0, 8, 0)
    assert client.socket.blocking is False
    assert client.socket.chunks == []
    client.socket = Socket(b"late", closed=True)
    assert lost(transport) == "closed the connection"
