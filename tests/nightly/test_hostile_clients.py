"""What no client may do to the emulated arm: end it, outgrow it, or keep it from the others."""

import socket
import struct
import time

import psutil
import pytest

from tests.wire.drivers.ur.emulator.test_process import Rtde, ask_dashboard, packet

MUTE_S = 5.0  # far above what a machine under load needs, far below what was seen without limits


def recipe(rate_hz, names):
    return struct.pack(">d", rate_hz) + names.encode()


def answers(emulator):
    """A client of each port is served as ever."""
    with Rtde(emulator.host) as rtde:
        rtde.sock.settimeout(MUTE_S)
        assert rtde.request("O", recipe(125.0, "timestamp")) == ("O", b"\x01DOUBLE")
        assert rtde.request("S") == ("S", b"\x01")
        assert rtde.read()[0] == "U"
    started = time.monotonic()
    assert ask_dashboard(emulator.host, "robotmode") == "Robotmode: RUNNING"
    assert emulator.fault(do="state")["ok"]
    assert time.monotonic() - started < MUTE_S
    return True


def test_recipe_that_cannot_be_served_is_refused(emulator):
    asked = [("O", recipe(rate, "timestamp")) for rate in (5e-324, 1e-3, float("nan"), -1.0, 126.0)]
    asked += [("O", recipe(125.0, "actual_q," * 1400)), ("I", b"input_int_register_0," * 3_000)]
    for kind, body in asked:
        with Rtde(emulator.host) as rtde:
            answer, refused = rtde.request(kind, body)
            assert (answer, refused[:1]) == (kind, b"\x00"), body[:40]
            assert rtde.request("S") == ("S", b"\x00")
    with Rtde(emulator.host) as rtde:  # those of one client are bounded together
        names = b",".join(b"input_double_register_%d" % n for n in range(48))
        given = [rtde.request("I", names)[1][0] for _ in range(200)]
        assert given[0] == 1 and given[-1] == 0
    assert answers(emulator)


def resident_mb(process):
    with open(f"/proc/{process.pid}/status") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def is_connected(client, process):
    served = psutil.Process(process.pid).net_connections()
    return client.getsockname() in {tuple(each.raddr) for each in served}


@pytest.mark.timeout(200)
def test_client_that_never_reads_keeps_little_and_is_cut_off(emulator):
    """48 kB in every cycle, of which a mebibyte is kept."""
    before = most = resident_mb(emulator.process)
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect((emulator.host, 30004))
        client.sendall(packet("O", recipe(125.0, ",".join(["actual_q"] * 1000))) + packet("S"))
        deadline = time.monotonic() + 120.0
        while is_connected(client, emulator.process):
            assert time.monotonic() < deadline
            most = max(most, resident_mb(emulator.process))
            time.sleep(0.02)
    assert most - before < 11.0  # what it keeps, and what answers are made of
    assert answers(emulator)
