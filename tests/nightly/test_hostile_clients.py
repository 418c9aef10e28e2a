"""What no client may do to the emulated arm: end it, outgrow it, or keep it from the others."""

import contextlib
import signal
import socket
import struct
import time

import pytest

from tests.wire.drivers.ur.emulator.test_process import Rtde, ask_dashboard, packet, send_program

WAIT_S = 15.0
MUTE_S = 5.0  # far above what a machine under load needs, far below what was seen without limits


def recipe(rate_hz, names):
    return struct.pack(">d", rate_hz) + names.encode()


def answers(emulator):
    """A client of each port is served as ever."""
    with Rtde(emulator.host) as rtde:
        rtde.sock.settimeout(MUTE_S)
        assert rtde.ask("O", recipe(125.0, "timestamp")) == ("O", b"\x01DOUBLE")
        assert rtde.ask("S") == ("S", b"\x01")
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
            answer, refused = rtde.ask(kind, body)
            assert (answer, refused[:1]) == (kind, b"\x00"), body[:40]
            assert rtde.ask("S") == ("S", b"\x00")
    with Rtde(emulator.host) as rtde:  # those of one client are bounded together
        names = b",".join(b"input_double_register_%d" % n for n in range(48))
        given = [rtde.ask("I", names)[1][0] for _ in range(200)]
        assert given[0] == 1 and given[-1] == 0
    assert answers(emulator)


def test_connections_that_say_nothing_are_capped_and_make_room(emulator):
    """More than select() could number, and than a process may open."""
    with contextlib.ExitStack() as held:
        for _ in range(1100):
            with contextlib.suppress(OSError):
                held.enter_context(socket.create_connection((emulator.host, 30004), timeout=2.0))
        deadline = time.monotonic() + WAIT_S
        while True:  # those that are idle for longest make room
            with contextlib.suppress(OSError, AssertionError, struct.error):
                assert answers(emulator)
                break
            assert time.monotonic() < deadline
            time.sleep(0.5)


HOG = (
    "global P=p[0.6,0.4,0.9,1,2,3]\n def f():\n"
    + f" x={' xor '.join(['get_inverse_kin_has_solution(P)'] * 20)}\n" * 250
    + " end\n"
    + " f()\n" * 200
)


def test_program_that_computes_without_end_starves_nobody(emulator):
    send_program(emulator.host, f"def f():\n {HOG}\nend\n")
    for _ in range(5):
        assert answers(emulator)
    emulator.process.send_signal(signal.SIGTERM)
    assert emulator.process.wait(MUTE_S) == 0


def resident_mb(process):
    with open(f"/proc/{process.pid}/status") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


@pytest.mark.timeout(200)
def test_client_that_never_reads_keeps_little_and_is_cut_off(emulator):
    """48 kB in every cycle, of which a mebibyte is kept."""
    before = most = resident_mb(emulator.process)
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect((emulator.host, 30004))
        client.sendall(packet("O", recipe(125.0, ",".join(["actual_q"] * 1000))) + packet("S"))
        deadline = time.monotonic() + 120.0
        said = ""
        while "cut off: it has not read 1048576 bytes" not in said:
            assert time.monotonic() < deadline, said
            most = max(most, resident_mb(emulator.process))
            time.sleep(0.02)
            said = " ".join(emulator.fault(do="state")["messages"])
    assert most - before < 11.0  # what it keeps, and what answers are made of
    assert answers(emulator)
