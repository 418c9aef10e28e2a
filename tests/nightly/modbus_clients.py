"""Modbus clients that pip installs and this project does not need, as programs of their own.

pip install --no-deps pyModbusTCP==0.3.1 uModbus==1.0.4 modbus-tk==1.1.5 minimalmodbus==2.1.1
python -m tests.wire.scenarios.cell.modbus_clients CLIENT ENDPOINTS        as JSON, of the cell

Exit code 77: the client is not installed.
"""

import contextlib
import json
import os
import socket
import sys
import time

NOT_INSTALLED = 77
PATIENCE_S = 100.0
ACTIVATE, READY = 0x0100, 0x31  # rACT; gACT and gIMC = 3
GO = 0x0900  # rACT and rGTO
COUNTS = (40, 20)  # of all fingers, where they meet nothing
FULL = 0xFF00  # speed, at the least force
TIMEOUT_S = 5.0  # for one answer
REGISTERS = 8  # each way
RTU_COMMAND, RTU_STATUS = 0x03E8, 0x07D0


def until(holds):
    deadline = time.monotonic() + PATIENCE_S
    while not (found := holds()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def play(scenario):
    """Ends the program, with what came of it: the clients' threads would keep it going."""
    try:
        scenario()
    except ImportError as error:
        print(error)
        code = NOT_INSTALLED
    except BaseException as error:
        print(repr(error))
        code = 1
    else:
        code = 0
    sys.stdout.flush()
    os._exit(code)


def hand(write, read):
    """Activate, wait, read the status, move, read back; inactive at last, as it was."""

    def ready():
        return read()[0] >> 8 & READY == READY

    write([0, 0, 0])
    until(lambda: not ready())
    write([ACTIVATE])
    until(ready)
    assert not read()[1] >> 8 & 0x0F, "a fault"
    for wanted in COUNTS:
        write([GO, wanted, FULL])
        until(lambda wanted=wanted: there(read(), wanted))
    write([0, 0, 0])
    until(lambda: not ready())


def there(status, wanted):
    """All at what was asked for (gSTA = 3), which is echoed, and where the fingers say they are."""
    told = b"".join(word.to_bytes(2, "big") for word in status)
    echo, *fingers = told[3], told[4], told[7], told[10]
    if told[0] >> 6 != 3 or echo != wanted:
        return False
    assert all(abs(finger - wanted) <= 1 for finger in fingers), told.hex()
    return True


def pymodbustcp(at):
    from pyModbusTCP.client import ModbusClient

    tcp = at["gripper"]
    client = ModbusClient(tcp["host"], tcp["port"], tcp["unit"], timeout=TIMEOUT_S)

    def write(words):
        assert client.write_multiple_registers(0, words), client.last_error_as_txt

    hand(write, lambda: client.read_input_registers(0, REGISTERS))


def umodbus(at):
    from umodbus.client import tcp

    where = at["gripper"]
    with socket.create_connection((where["host"], where["port"]), TIMEOUT_S) as sock:

        def write(words):
            request = tcp.write_multiple_registers(where["unit"], 0, words)
            assert tcp.send_message(request, sock) == len(words)

        def read():
            request = tcp.read_input_registers(where["unit"], 0, REGISTERS)
            return tcp.send_message(request, sock)

        hand(write, read)


def modbus_tk(at):
    from modbus_tk import defines
    from modbus_tk.modbus_tcp import TcpMaster

    where = at["gripper"]
    master = TcpMaster(where["host"], where["port"], timeout_in_sec=TIMEOUT_S)

    def write(words):
        request = where["unit"], defines.WRITE_MULTIPLE_REGISTERS, 0
        assert master.execute(*request, output_value=words) == (0, len(words))

    def read():
        return master.execute(where["unit"], defines.READ_INPUT_REGISTERS, 0, REGISTERS)

    with contextlib.closing(master):
        hand(write, read)


def minimalmodbus(at):
    from minimalmodbus import Instrument

    line = at["gripper_serial"]
    client = Instrument(line["port"], line["unit"])
    client.serial.baudrate, client.serial.timeout = 115_200, TIMEOUT_S
    hand(
        lambda words: client.write_registers(RTU_COMMAND, words),
        lambda: client.read_registers(RTU_STATUS, REGISTERS),
    )


if __name__ == "__main__":
    play(lambda: globals()[sys.argv[1]](json.loads(sys.argv[2])))
