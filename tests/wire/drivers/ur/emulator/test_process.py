"""The emulator as a process, and the bytes on its ports."""

import contextlib
import itertools
import json
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[5]
WAIT_S = 60.0


def packet(kind, body=b""):
    return struct.pack(">HB", 3 + len(body), ord(kind)) + body


class Rtde:
    """RTDE client with its own encoding, so that a mistake in the emulator's cannot cancel out."""

    def __init__(self, host):
        self.sock = socket.create_connection((host, 30004), timeout=10.0)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.sock.close()

    def request(self, kind, body=b""):
        self.sock.sendall(packet(kind, body))
        return self.read()

    def read(self):
        size, kind = struct.unpack(">HB", self.exactly(3))
        return chr(kind), self.exactly(size - 3)

    def exactly(self, count):
        data = b""
        while len(data) < count:
            part = self.sock.recv(count - len(data))
            assert part, "closed"
            data += part
        return data


def ask_dashboard(host, line):
    with socket.create_connection((host, 29999), timeout=10.0) as sock, sock.makefile("rw") as f:
        assert f.readline() == "Connected: Universal Robots Dashboard Server\n"
        f.write(line + "\n")
        f.flush()
        return f.readline().rstrip("\n")


def test_ends_on_signal(emulate):
    emulator = emulate()
    emulator.process.send_signal(signal.SIGTERM)
    assert emulator.process.wait(WAIT_S) == 0


def refused(*arguments):
    """The line of the error with which an emulator does not start."""
    command = [sys.executable, "-m", "drivers.ur.emulator", *arguments]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60.0, check=False
    )
    assert done.returncode == 1, done.stderr
    assert not done.stdout
    (line,) = done.stderr.splitlines()
    return line


def test_invalid_arguments_are_refused_in_one_line(emulator):
    assert f"cannot listen on {emulator.host}" in refused("--host", emulator.host)
    assert "fault-port" in refused("--host", "127.0.0.2", "--fault-port", "70000")


def test_ends_when_its_parent_dies(emulate):
    """The orphaned emulator frees its address."""
    host = emulate().host.rsplit(".", 1)[0] + ".254"
    parent = (
        "import subprocess, sys\n"
        "command = [sys.executable, '-m', 'drivers.ur.emulator', '--host', sys.argv[1]]\n"
        "child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)\n"
        "print(child.stdout.readline())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", parent, host],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=True,
    )
    assert json.loads(done.stdout)["ready"]
    deadline = time.monotonic() + WAIT_S
    while True:
        try:
            socket.create_connection((host, 30004), timeout=1.0).close()
        except ConnectionRefusedError:
            break
        assert time.monotonic() < deadline, "the orphan lives"
        time.sleep(0.05)


def test_versions_and_data_as_bytes(emulator):
    with Rtde(emulator.host) as rtde:
        assert rtde.request("V", b"\x00\x02") == ("V", b"\x01")
        assert rtde.request("v") == ("v", struct.pack(">4I", 3, 15, 8, 106339))
        recipe = struct.pack(">d", 62.5) + b"timestamp,robot_mode,payload_cog,"
        assert rtde.request("O", recipe) == ("O", b"\x01DOUBLE,INT32,VECTOR3D")
        assert rtde.request("S") == ("S", b"\x01")
        stamps = []
        for _ in range(5):
            kind, body = rtde.read()
            assert kind == "U" and len(body) == 1 + 8 + 4 + 24
            number, stamp, mode = struct.unpack_from(">Bdi", body)
            assert (number, mode) == (1, 7)
            stamps.append(stamp)
        assert [b - a for a, b in itertools.pairwise(stamps)] == pytest.approx([0.016] * 4)


def test_invalid_recipes_are_refused(emulator):
    with Rtde(emulator.host) as one, Rtde(emulator.host) as other:
        assert one.request("V", b"\x00\x03") == ("V", b"\x00")
        assert one.request("O", struct.pack(">d", 125.0) + b"timestamp,nonsense")[1] == (
            b"\x00DOUBLE,NOT_FOUND"
        )
        assert one.request("S") == ("S", b"\x00")
        assert one.request("I", b"input_int_register_0,")[1] == b"\x01INT32"
        assert (
            one.request("I", b"input_int_register_0,input_double_register_1")[1]
            == b"\x02INT32,DOUBLE"
        )
        assert other.request("I", b"input_int_register_0,bad")[1] == b"\x00IN_USE,NOT_FOUND"
    with Rtde(emulator.host) as next_one:
        deadline = time.monotonic() + WAIT_S
        while next_one.request("I", b"input_int_register_0")[1] != b"\x01INT32":
            assert time.monotonic() < deadline, "claims outlive their connection"


def test_dashboard_commands(emulator):
    host = emulator.host
    assert ask_dashboard(host, "PolyscopeVersion").startswith("URSoftware 3.15.8.106339")
    assert ask_dashboard(host, "get serial number").isdigit()
    assert ask_dashboard(host, "robotmode") == "Robotmode: RUNNING"
    assert ask_dashboard(host, "safetystatus") == "Safetystatus: NORMAL"
    assert ask_dashboard(host, "is in remote control").startswith("could not understand")
    assert ask_dashboard(host, "stop") == "Stopped"
    assert ask_dashboard(host, "rm -rf") == "could not understand: 'rm -rf'"


def send_program(host, text):
    with socket.create_connection((host, 30003), timeout=10.0) as sock:
        sock.sendall(text.encode())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def f():\n  while True:\n    x = 1\n  end\nend\n", "infinite loop detected"),
        ("def f():\n  $\nend\n", "line 2: not emulated: $"),
    ],
)
def test_invalid_programs_end_and_the_controller_keeps_running(emulator, text, message):
    send_program(emulator.host, text)
    deadline = time.monotonic() + WAIT_S
    while not (state := emulator.fault(do="state"))["script_errors"]:
        assert time.monotonic() < deadline, state
        time.sleep(0.01)
    assert state["runtime_state"] == 1
    assert any(message in line for line in state["messages"]), state


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("def f():\n  if True:\n    sleep(1)\n  end\n", "a block without end"),
        ("def f():\n  sleep(1)\nend", "a block without end, or no line end"),
        ("def f():\n" + "  sleep(1)\n" * 30_000, "longer than 100000 characters"),
    ],
)
def test_a_program_that_never_ends_is_logged_as_incomplete(emulator, text, why):
    with contextlib.suppress(ConnectionError):  # beyond the limit the emulator hangs up
        send_program(emulator.host, text)
    deadline = time.monotonic() + WAIT_S
    while not (lines := emulator.fault(do="state")["messages"]):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert f"incomplete program ignored: {why}" in lines[0]
