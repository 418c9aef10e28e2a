"""Worker process with scripted children: start, replies and end."""

import os
import signal
import subprocess
import sys
import time

import msgspec
import psutil
import pytest

from drivers.errors import DeviceFault, LinkLost
from drivers.ur.link import messages
from drivers.ur.link.connections import RTDE_PORT
from drivers.ur.link.messages import Outcome, State
from drivers.ur.link.supervisor import WorkerProcess
from tests.wire.cases import case
from tests.wire.drivers.ur.link.conftest import ROOT, SETUP, TARGET, workers
from tests.wire.waiting import until

LONG_S = 30.0


def child(body):
    """A child that runs ``body`` with its end of the socket as ``peer``."""
    start = f"import sys, time, msgspec; sys.path[:] = {sys.path!r}; import socket\n"
    peer = "peer = socket.socket(fileno=int(sys.argv[1]))\n"
    names = "from drivers.ur.link.messages import *\n"
    names += "send = lambda m: peer.send(msgspec.msgpack.encode(m))\n"
    return (sys.executable, "-c", start + peer + names + body)


def test_child_that_does_not_become_ready_is_killed():
    worker = WorkerProcess(SETUP, child("time.sleep(1000)"))
    while not (pids := workers()):  # until the new process has its command line
        time.sleep(0.01)
    (pid,) = pids
    with pytest.raises(LinkLost, match="did not start within"):
        worker.wait_ready(0.3)
    assert not os.path.exists(f"/proc/{pid}")


def test_start_errors_of_ur_rtde_have_their_error_class():
    for text, kind in [
        ("One of the RTDE input registers are already in use!", DeviceFault),
        ("ur_rtde: Please enable remote control on the robot!", DeviceFault),
        ("Failed to start control script, before timeout of 5 seconds", DeviceFault),
        ("Could not connect to: 127.0.0.2 at 30004", LinkLost),
    ]:
        with case(text, kind):
            worker = WorkerProcess(
                SETUP, child(f"print('printed', flush=True); send(Failed({text!r}))")
            )
            with pytest.raises(kind, match=r"RTDE|ur_rtde|script|connect") as caught:
                worker.wait_ready(30.0)
            assert caught.value.remedy


def test_child_that_crashes_is_link_lost_and_its_output_is_kept():
    body = "import os; os.write(2, b'stack smashed'); os.kill(os.getpid(), 11)"
    worker = WorkerProcess(SETUP, child(body))
    with pytest.raises(LinkLost, match="worker process ended"):
        worker.wait_ready(30.0)
    assert list(worker.log) == ["stack smashed"]


def test_child_that_does_not_reply_to_commands_is_killed():
    for then in ("time.sleep(1000)", "while True: time.sleep(0.01); send(State({fields}))"):
        with case(then):
            state = State(0.0, TARGET, (0.0, 0.0, 0.0), False, 7, 1, True)
            fields = ", ".join(repr(getattr(state, name)) for name in state.__struct_fields__)
            body = f"send(Ready()); send(State({fields}))\n{then.format(fields=fields)}"
            worker = WorkerProcess(SETUP, child(body))
            worker.wait_ready(30.0)
            assert worker.state == state
            with pytest.raises(LinkLost, match="did not accept a command in time"):
                worker.call(messages.SetPayload(worker.next_number(), 1.0, (0.0, 0.0, 0.0)), 0.6)
            with pytest.raises(LinkLost, match="link to the arm lost"):
                worker.check()


def test_failed_command_is_reported_once():
    body = (
        "peer.recv(65536); request = msgspec.msgpack.decode(peer.recv(65536), type=Request)\n"
        "send(Reply(request.number, Outcome.NOT_ACCEPTED)); time.sleep(1000)"
    )
    worker = WorkerProcess(SETUP, child(body))
    try:
        worker.post(messages.SetPayload(worker.next_number(), 1.0, (0.0, 0.0, 0.0)), 30.0)
        deadline = time.monotonic() + 30.0
        while worker.is_pending(1) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert (worker.next_failure(), worker.next_failure()) == (Outcome.NOT_ACCEPTED, None)
    finally:
        worker.kill()


def test_child_that_shuts_down_on_request_is_not_killed(tmp_path):
    """It brakes and ends its program; after a kill only the watchdog would do that."""
    left = tmp_path / "left"
    body = "peer.recv(65536); request = peer.recv(65536); open({!r}, 'wb').write(request)"
    worker = WorkerProcess(SETUP, child(body.format(str(left))))
    worker.close(30.0)
    assert isinstance(
        msgspec.msgpack.decode(left.read_bytes(), type=messages.Request), messages.Shutdown
    )


def test_child_that_does_not_shut_down_is_killed():
    worker = WorkerProcess(SETUP, child("time.sleep(1000)"))
    start = time.monotonic()
    worker.close(0.2)
    assert time.monotonic() - start < 30


def blocked_in_start(client, host):
    """Whether the worker of that process waits for data of the controller."""
    return any(
        connection.raddr == (host, RTDE_PORT)
        for pid in workers(client)
        for connection in psutil.Process(pid).net_connections()
    )


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT], ids=["killed", "Ctrl-C"])
def test_worker_blocked_in_its_start_ends_with_its_client(controller, host, number):
    """A controller accepts and stays silent: ur_rtde waits there, and no Python code runs."""
    pytest.importorskip("rtde_receive")
    controller().speaks.clear()
    script = f"""
from drivers.ur.link.client import UrLink, UrSettings
from drivers.ur.link import client
client.preflight = client.raise_failures = client.require_stationary = lambda *asked: None
UrLink(UrSettings(host={host!r}, step_timeout_s=4.0)).connect()
"""
    parent = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, stderr=subprocess.DEVNULL)
    with parent:
        until(lambda: blocked_in_start(parent.pid, host))
        (worker,) = workers(parent.pid)
        parent.send_signal(number)
        parent.wait(LONG_S)
    until(lambda: not os.path.exists(f"/proc/{worker}"))
