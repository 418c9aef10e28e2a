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


@pytest.mark.parametrize("rate_hz", [5e-324, 1e-310, 1e-3, float("nan"), float("inf"), -1.0, 126.0])
def test_frequency_that_is_none_is_refused(emulator, rate_hz):
    with Rtde(emulator.host) as rtde:
        assert rtde.ask("O", recipe(rate_hz, "timestamp"))[1][:1] == b"\x00"
        assert rtde.ask("S") == ("S", b"\x00")
    assert answers(emulator)


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("O", recipe(125.0, "actual_q," * 1400)),
        ("O", recipe(125.0, "a," * 30_000)),
        ("I", b"a," * 30_000),
        ("I", b"input_int_register_0," * 3_000),
    ],
)
def test_recipe_whose_packet_would_be_too_long_is_refused(emulator, kind, body):
    with Rtde(emulator.host) as rtde:
        answer, refused = rtde.ask(kind, body)
        assert (answer, refused[:1]) == (kind, b"\x00")
        assert rtde.ask("S") == ("S", b"\x00")
    assert answers(emulator)


def test_recipes_of_one_client_are_bounded_together(emulator):
    with Rtde(emulator.host) as rtde:
        names = b",".join(b"input_double_register_%d" % n for n in range(48))
        given = [rtde.ask("I", names)[1][0] for _ in range(200)]
        assert given[0] == 1 and given[-1] == 0
    assert answers(emulator)


@pytest.mark.parametrize(
    "program",
    [
        "speedl([1e200,0,0,0,0,0],1e300,1)",
        "speedl([0,0,0,0,0,1e200],1e300,1)",
        "speedl([0,0,0.1,0,0,0],1e-300,1)",
        "stopl(1e-320)",
        "movel(p[0.5,0.1,0.4,3.141592653589793,0,0],a=1e300,v=1e300)",
    ],
)
def test_speed_that_no_arm_has_ends_its_program_alone(emulator, program):
    send_program(emulator.host, f"def f():\n {program}\n sync()\nend\n")
    deadline = time.monotonic() + WAIT_S
    while not emulator.fault(do="state")["script_errors"]:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert answers(emulator)


def idle(host, port, count):
    opened = []
    for _ in range(count):
        with contextlib.suppress(OSError):
            opened.append(socket.create_connection((host, port), timeout=2.0))
    return opened


@pytest.mark.parametrize("port", [30003, 30004, 29999])
def test_connections_that_say_nothing_are_capped_and_make_room(emulator, port):
    """More than select() could number, and than a process may open."""
    held = idle(emulator.host, port, 1100)
    try:
        for other in {30003, 30004, 29999} - {port}:
            socket.create_connection((emulator.host, other), timeout=2.0).close()
        deadline = time.monotonic() + WAIT_S
        while True:  # those that are idle for longest make room
            with contextlib.suppress(OSError, AssertionError, struct.error):
                assert answers(emulator)
                break
            assert time.monotonic() < deadline
            time.sleep(0.5)
    finally:
        for one in held:
            one.close()


HOGS = {
    "a function of many calls": "global P=p[0.6,0.4,0.9,1,2,3]\n def f():\n"
    + f" x={' xor '.join(['get_inverse_kin_has_solution(P)'] * 20)}\n" * 250
    + " end\n"
    + " f()\n" * 200,
    "a long body": "while True:\n" + " a=1\n" * 9_000 + " sync()\n end",
}


@pytest.mark.parametrize("hog", HOGS)
def test_program_that_computes_without_end_starves_nobody(emulator, hog):
    send_program(emulator.host, f"def f():\n {HOGS[hog]}\nend\n")
    for _ in range(5):
        assert answers(emulator)
    emulator.process.send_signal(signal.SIGTERM)
    assert emulator.process.wait(MUTE_S) == 0


@pytest.mark.parametrize(
    "text",
    [
        "def f():\n" + " a=1\n" * 240_000 + "end\n",
        "def f():\n if 1==0:\n" + " elif 1==0:\n a=1\n" * 9_000 + " end\nend\n",
        "def f():\n a=" + "(((1+1)+(1+1))+((1+1)+(1+1)))+" * 8_000 + "1\nend\n",
    ],
)
def test_long_program_is_read_or_refused_beside_the_others(emulator, text):
    send_program(emulator.host, text)
    for _ in range(5):
        assert answers(emulator)


def resident_mb(process):
    with open(f"/proc/{process.pid}/status") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def served(host, port, peers):
    """How many of these connections the emulator has not closed, though they have not read it."""
    at = int.from_bytes(socket.inet_aton(host), "little")
    ours = {f"{at:08X}:{port:04X}", *(f":{peer:04X}" for peer in peers)}
    with open("/proc/net/tcp") as lines:
        known = [line.split()[1:4] for line in lines][1:]
    established = "01"
    return sum(
        local in ours and remote[-5:] in ours and state == established
        for local, remote, state in known
    )


@pytest.mark.parametrize(("port", "count"), [(30004, 5), (29999, 1)])
def test_client_that_never_reads_keeps_little_and_is_cut_off(emulator, port, count):
    """30004: 48 kB in every cycle, 29999: questions without end. A mebibyte is kept for each."""
    before = most = resident_mb(emulator.process)
    with contextlib.ExitStack() as stack:
        clients = []
        for _ in range(count):
            client = stack.enter_context(socket.socket())
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.connect((emulator.host, port))
            clients.append(client)
        peers = [client.getsockname()[1] for client in clients]
        assert served(emulator.host, port, peers) == len(clients)
        for client in clients:
            client.setblocking(False)
            if port == 30004:
                client.sendall(packet("O", recipe(125.0, ",".join(["actual_q"] * 1000))))
                client.sendall(packet("S"))
        deadline = time.monotonic() + 120.0
        while served(emulator.host, port, peers) and time.monotonic() < deadline:
            if port == 29999:
                for client in clients:
                    with contextlib.suppress(OSError):
                        client.send(b"robotmode\n" * 5000)
            most = max(most, resident_mb(emulator.process))
            time.sleep(0.02)
        assert not served(emulator.host, port, peers)
        assert most - before < count * 1.05 + 10.0  # what they keep, and what answers are made of
    said = " ".join(emulator.fault(do="state")["messages"])
    assert said.count("cut off: it has not read 1048576 bytes") == count
    assert answers(emulator)


def test_flood_leaves_time_for_the_others(emulator):
    with contextlib.ExitStack() as stack:
        for port, what in ((30004, packet("?") * 20_000), (29999, b"\n" * 60_000)):
            sock = stack.enter_context(socket.create_connection((emulator.host, port)))
            sock.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    sock.send(what)
        for _ in range(5):
            assert answers(emulator)
