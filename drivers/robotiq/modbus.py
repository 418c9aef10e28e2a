"""Registers over Modbus TCP and Modbus RTU, by pymodbus.

Source: Robotiq 3-Finger manual, 2014 p. 59 and 75, 2018 p. 46 and 55. Over TCP the gripper supports
functions 16 (write) and 4 (read); over RTU 16 and 3, and it does not reply to an error.
"""

import logging
import struct
import termios
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final, Literal

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from drivers.errors import LinkLost
from drivers.robotiq.settings import ModbusSettings

_BAUD: Final = 115200  # 8N1, manual p. 59
UNIT: Final = 2  # over TCP, manual p. 75; the gripper replies to any
RECONNECT_S: Final = 0.2  # least time between attempts to connect
_MAX_BYTES: Final = 4096
_WRITE, _READ_INPUT, _READ_HOLDING = 16, 4, 3  # function codes

# Exceptions of pymodbus calls: its own, the socket's and its decoder's.
_FAILURES: Final = (ModbusException, OSError, ValueError, IndexError, struct.error)

# pymodbus logs lost links and malformed replies; here they are raised as errors instead.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class ModbusTransport:
    """``RegisterTransport`` over Modbus. Every failure is ``LinkLost``, usually after one timeout.

    A lost connection is opened again by a later call, never by the call that detects the loss. So
    the caller gets ``LinkLost`` before every new connection.
    """

    def __init__(
        self,
        settings: ModbusSettings,
        link: Literal["tcp", "rtu"] = "tcp",
        reconnect_s: float = RECONNECT_S,
    ) -> None:
        """Connect at the first request, not here."""
        self._client: ModbusTcpClient | ModbusSerialClient
        how: dict[str, Any] = {"timeout": settings.timeout_s, "retries": 0}
        if link == "tcp":
            self._client = ModbusTcpClient(settings.host, port=settings.port, **how)
            self._read, self._read_function = self._client.read_input_registers, _READ_INPUT
            self._name, self._unit = f"{settings.host}:{settings.port}", UNIT
            self._remedy = "check power, cable and address of the gripper"
            # Unanswered requests in a row after which a connection counts as half open. A late
            # reply is recognized by its transaction number and dropped.
            self._max_unanswered = 3
        else:
            self._client = ModbusSerialClient(settings.serial_port, baudrate=_BAUD, **how)
            self._read, self._read_function = self._client.read_holding_registers, _READ_HOLDING
            self._name, self._unit = settings.serial_port, settings.slave
            self._remedy = "check power and cable of the gripper and the name of the serial port"
            self._max_unanswered = 1  # a late reply would be taken for the next one
        self._serial = link == "rtu"
        self._reconnect_ns = round(reconnect_s * 1e9)
        self._attempted_ns: int | None = None
        self._loss_reported = True  # LinkLost was raised since the last reply
        self._unanswered = 0
        self.connections = 0

    def close(self) -> None:
        """Close the connection; a later request opens a new one."""
        self._client.close()  # type: ignore[no-untyped-call]

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None:
        """Write registers, function 16."""
        values = list(registers)
        reply = self._exchange(
            lambda: self._client.write_registers(first_register, values, device_id=self._unit),
            _WRITE,
            now_ns,
        )
        if (reply.address, reply.count) != (first_register, len(values)):
            raise self._link_lost("acknowledged registers that were not written")

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]:
        """Read status registers: function 4 over TCP, 3 over RTU."""
        reply = self._exchange(
            lambda: self._read(first_register, count=count, device_id=self._unit),
            self._read_function,
            now_ns,
        )
        return reply.registers

    def _flush(self) -> None:
        """Discard unrequested input. Raises OSError when the line is gone."""
        line: Any = self._client.socket
        if line is None:
            return
        if self._serial:
            try:
                line.reset_input_buffer()
            except termios.error as error:
                raise OSError(*error.args) from error
            return
        line.setblocking(False)  # as pymodbus sets it while it waits for a reply
        with suppress(BlockingIOError):
            while line.recv(_MAX_BYTES):
                pass
            raise ConnectionResetError("closed by the gripper")

    def _exchange(self, request: Callable[[], ModbusPDU], function: int, now_ns: int) -> ModbusPDU:
        self._connect(now_ns)
        try:
            self._flush()
            reply = request()
        except _FAILURES as error:
            raise self._request_failed(error) from error
        self._unanswered = 0
        if reply.isError():
            raise self._link_lost(
                f"replied with exception {reply.exception_code} to function {function}"
            )
        if reply.function_code != function:
            what = f"replied with function {reply.function_code} to function {function}"
            raise self._link_lost(what)
        self._loss_reported = False
        return reply

    def _connect(self, now_ns: int) -> None:
        client = self._client
        if client.connected:
            return
        if not self._loss_reported:
            raise self._link_lost("closed the connection")
        if self._attempted_ns is not None and now_ns - self._attempted_ns < self._reconnect_ns:
            raise self._link_lost("does not answer")
        self._attempted_ns = now_ns
        if not client.connect():
            raise self._link_lost("cannot be connected")
        self.connections += 1
        self._unanswered = 0

    def _request_failed(self, error: Exception) -> LinkLost:
        """Error for a failed request; closes the connection after too many without reply."""
        self._unanswered += 1
        closed = isinstance(error, OSError) or not self._client.connected
        if closed or self._unanswered >= self._max_unanswered:
            self.close()
        return self._link_lost("closed the connection" if closed else "does not answer")

    def _link_lost(self, what: str) -> LinkLost:
        self._loss_reported = True
        return LinkLost(f"the gripper at {self._name} {what}", self._remedy)
