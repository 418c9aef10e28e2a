"""A well-behaved client of every port: how long each answer takes.

    python -m tests.nightly.fuzz.polite ENDPOINTS.json SECONDS

Prints one line of JSON: the median wait in ms by port, and errors. Ten requests a second on each
port, one connection each, kept open. On the RTDE port the answer comes within a stream.
"""

import json
import socket
import statistics
import struct
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from drivers.takktile.emulator import hop
from drivers.takktile.emulator.hop import HopReply, HopRequest, Op

EACH_S = 0.1
TIMEOUT_S = 60.0  # generous for a busy machine


class Line:
    """A connection that asks and reads."""

    def __init__(self, host: str, port: int) -> None:
        self.sock = socket.create_connection((host, port), TIMEOUT_S)
        self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.file = self.sock.makefile("rb")

    def ask(self, data: bytes, begins: bytes) -> None:
        self.sock.sendall(data)
        expect(self.file.readline(), begins)

    def exactly(self, count: int) -> bytes:
        data = self.file.read(count)
        if len(data) < count:
            raise ConnectionError("closed")
        return data


def expect(answer: bytes, begins: bytes) -> None:
    if not answer.startswith(begins):
        raise ValueError(f"answered {answer[:80]!r}")


def questions(at: dict[str, Any]) -> Iterator[tuple[str, Callable[[], object]]]:
    host, arm = at["host"], at["arm"]
    dashboard = Line(host, arm["dashboard"])
    dashboard.file.readline()
    yield "dashboard", lambda: dashboard.ask(b"robotmode\n", b"Robotmode")
    control = Line(at["control"]["host"], at["control"]["port"])
    yield "control", lambda: control.ask(b'{"verb":"truth"}\n', b'{"truth')
    faults = Line(host, arm["faults"])
    yield "faults", lambda: faults.ask(b'{"do":"state"}\n', b'{"ok":true')
    modbus = Line(at["gripper"]["host"], at["gripper"]["port"])

    def read_register() -> None:
        modbus.sock.sendall(bytes.fromhex("000100000006020400000001"))
        expect(modbus.exactly(11), b"\0\1\0\0\0\5\2\4\2")

    yield "modbus", read_register
    where, _, port = at["tactile"]["url"].removeprefix("tcp://").rpartition(":")
    board = Line(where, int(port))

    def list_boards() -> None:
        hop.send(board.sock, HopRequest(Op.LIST))
        hop.receive(board.sock, HopReply)

    yield "hop", list_boards
    rtde = Line(host, arm["rtde"])
    names = b"timestamp,actual_q,actual_TCP_pose,robot_mode"
    rtde.sock.sendall(_packet("O", struct.pack(">d", 125.0) + names) + _packet("S"))

    def version() -> None:
        rtde.sock.sendall(_packet("v"))
        kind = 0
        while kind != ord("v"):
            size, kind = struct.unpack(">HB", rtde.exactly(3))
            rtde.exactly(size - 3)

    yield "rtde", version


def _packet(kind: str, body: bytes = b"") -> bytes:
    return struct.pack(">HB", 3 + len(body), ord(kind)) + body


def measure(at: dict[str, Any], seconds: float) -> dict[str, Any]:
    waits: dict[str, list[float]] = {}
    errors: dict[str, str] = {}
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
    return {"median_ms": {n: statistics.median(found) for n, found in waits.items()},
            "errors": errors}  # fmt: skip


if __name__ == "__main__":
    print(json.dumps(measure(json.loads(Path(sys.argv[1]).read_text()), float(sys.argv[2]))))
