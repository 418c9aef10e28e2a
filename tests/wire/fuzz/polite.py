"""A well-behaved client of every port, in a process of its own: how long each has to wait.

    python -m tests.wire.fuzz.polite ENDPOINTS.json SECONDS

prints one line of JSON: for each port the median and the longest wait in ms, or the error. Ten
requests a second on each, one connection each, kept open. RTDE: an answer in the midst of a stream.
Ports 30001 to 30003 are listened to: how long one state comes after the other.
"""

import json
import socket
import statistics
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from drivers.takktile.emulator import hop
from drivers.takktile.emulator.hop import HopReply, HopRequest, Op

EACH_S = 0.1
STATE_PORTS = (30001, 30002, 30003)
STATE = 16  # message type of ports 30001 and 30002
TIMEOUT_S = 60.0  # a busy machine may hold it up; what does not answer never will


class Line:
    """A connection that asks."""

    def __init__(self, host: str, port: int) -> None:
        self.sock = socket.create_connection((host, port), TIMEOUT_S)
        self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.file = self.sock.makefile("rb")

    def ask(self, data: bytes) -> bytes:
        self.sock.sendall(data)
        return self.file.readline()

    def exactly(self, count: int) -> bytes:
        data = self.file.read(count)
        if len(data) < count:
            raise ConnectionError("closed")
        return data


def questions(at: dict[str, Any]) -> Iterator[tuple[str, Callable[[], object]]]:
    host = at["host"]
    dashboard = Line(host, at["arm"]["dashboard"])
    dashboard.file.readline()
    yield "dashboard", lambda: expect(dashboard.ask(b"robotmode\n"), b"Robotmode")
    modbus = Line(at["gripper"]["host"], at["gripper"]["port"])

    def read() -> None:
        modbus.sock.sendall(bytes.fromhex("000100000006020400000001"))
        expect(modbus.exactly(11), b"\0\1\0\0\0\5\2\4\2")

    yield "modbus", read
    control = Line(at["control"]["host"], at["control"]["port"])
    yield "control", lambda: expect(control.ask(b'{"verb":"truth"}\n'), b'{"truth')
    faults = Line(host, at["arm"]["faults"])
    yield "faults", lambda: expect(faults.ask(b'{"do":"state"}\n'), b'{"ok":true')
    where, _, port = at["tactile"]["url"].removeprefix("tcp://").rpartition(":")
    board = Line(where, int(port))

    def listed() -> None:
        hop.send(board.sock, HopRequest(Op.LIST))
        hop.receive(board.sock, HopReply)

    yield "hop", listed
    yield "rtde", Stream(Line(host, at["arm"]["rtde"])).packet


class Stream:
    """Asks for the version in the midst of a stream at full rate, as no real client does: an
    answer that can be timed."""

    def __init__(self, line: Line) -> None:
        self._line = line
        names = b"timestamp,actual_q,actual_TCP_pose,robot_mode"
        line.sock.sendall(packet("O", struct.pack(">d", 125.0) + names) + packet("S"))

    def packet(self) -> None:
        self._line.sock.sendall(packet("v"))
        while True:
            size, kind = struct.unpack(">HB", self._line.exactly(3))
            self._line.exactly(size - 3)
            if kind == ord("v"):
                return


class Heard:
    """A thread that reads one port's states, and how long each came after the one before."""

    def __init__(self, host: str, port: int) -> None:
        self.waits: list[float] = []
        self.error = ""
        self._line = Line(host, port)
        self._header = struct.Struct(">I" if port == STATE_PORTS[-1] else ">IB")
        self._ended = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        before = time.perf_counter()
        try:
            while not self._ended:
                size, *kind = self._header.unpack(self._line.exactly(self._header.size))
                self._line.exactly(size - self._header.size)
                if kind in ([], [STATE]):
                    now = time.perf_counter()
                    self.waits.append((now - before) * 1e3)
                    before = now
        except (OSError, ValueError, struct.error) as error:
            self.error = f"{type(error).__name__}: {error}"

    def end(self) -> None:
        """After the next state, or when none comes for as long as an answer may take."""
        self._ended = True
        self._thread.join(TIMEOUT_S + 1.0)
        if self._thread.is_alive() and not self.error:
            self.error = "no state"
        self._line.sock.close()


def packet(kind: str, body: bytes = b"") -> bytes:
    return struct.pack(">HB", 3 + len(body), ord(kind)) + body


def expect(answer: bytes, begins: bytes) -> None:
    if not answer.startswith(begins):
        raise ValueError(f"answered {answer[:80]!r}")


def measure(at: dict[str, Any], seconds: float) -> dict[str, Any]:
    waits: dict[str, list[float]] = {}
    errors: dict[str, str] = {}
    heard = {f"state {port}": Heard(at["host"], port) for port in STATE_PORTS}
    asked = dict(questions(at))
    until = time.monotonic() + seconds
    while time.monotonic() < until and not errors:
        for name, ask in asked.items():
            started = time.perf_counter()
            try:
                ask()
            except (OSError, ValueError) as error:
                errors[name] = f"{type(error).__name__}: {error}"
                break
            waits.setdefault(name, []).append((time.perf_counter() - started) * 1e3)
            time.sleep(EACH_S / len(asked))
    for name, one in heard.items():
        one.end()
        if one.error:
            errors[name] = one.error
        if one.waits:
            waits[name] = one.waits
    return {
        "median_ms": {name: statistics.median(found) for name, found in waits.items()},
        "most_ms": {name: max(found) for name, found in waits.items()},
        "errors": errors,
    }


if __name__ == "__main__":
    with open(sys.argv[1]) as endpoints:
        print(json.dumps(measure(json.load(endpoints), float(sys.argv[2]))))
