"""Arm link by ur_rtde, against the emulated controller in another process."""

import math
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time

import msgspec
import pytest

from drivers.errors import DeviceFault, LinkLost, Refused, Stale
from drivers.ur import kinematics
from drivers.ur.driver import ArmDriver
from drivers.ur.link import client
from drivers.ur.link.client import UrLink
from drivers.ur.settings import ArmSettings, UrSettings
from tests.ur_rtde import needs_ur_rtde
from tests.wire.cases import case
from tests.wire.drivers.ur.link.conftest import ROOT, workers

# a slow watchdog, so that a busy machine does not end the program
EASY = {"watchdog_hz": 1.0, "heartbeat_timeout_s": 5.0, "step_timeout_s": 8.0}
LONG_S = 60.0
PROGRAM_RUNNING = 2
SCRIPT_PORT = 30003


class Arm:
    """Driver on a link, in wall time."""

    def __init__(self, host, **settings):
        self.link = UrLink(UrSettings(host=host, **(EASY | settings)))
        self.link.connect()
        self.driver = ArmDriver(self.link, ArmSettings(stale_after_s=0.3))
        self.poll()
        self.start_m = self.state.position_m

    @property
    def state(self):
        return self.driver.state

    def poll(self):
        self.driver.poll(time.monotonic_ns())

    def poll_until(self, condition, patient=True):
        """Poll at about 100 Hz; ``patient``: stale samples on a busy machine are ignored."""
        deadline = time.monotonic() + LONG_S
        while not condition():
            assert time.monotonic() < deadline, self.state
            try:
                self.poll()
            except Stale:
                if not patient:
                    raise
            time.sleep(0.01)

    def rise(self, by_m, speed_mps=0.1):
        x, y, z = self.start_m
        self.driver.move_to((x, y, z + by_m), speed_mps, 1.0)

    def risen_m(self):
        return self.state.position_m[2] - self.start_m[2]

    def rising(self):
        return self.risen_m() > 0.01

    def expect_error(self, kind, match):
        """Poll until this error is raised; returns it."""
        with pytest.raises(kind, match=match) as caught:
            self.poll_until(lambda: False)
        assert caught.value.remedy
        return caught.value


@pytest.fixture
def connect(host):
    arms = []

    def make(**settings):
        arms.append(Arm(host, **settings))
        return arms[-1]

    yield make
    for arm in arms:
        arm.link.close()


def at_end(emulator):
    return emulator.state_when(lambda state: not state["moving"])


def test_moves_and_comes_to_rest_at_the_target(emulate, connect):
    emulate()
    arm = connect()
    arm.driver.set_payload(2.6)
    arm.rise(0.05)
    assert arm.state.moving
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.risen_m() == pytest.approx(0.05, abs=1e-3)
    assert math.dist(arm.state.position_m[:2], arm.start_m[:2]) < 1e-3


def test_joint_angles_are_those_of_the_sample_that_gives_the_position(emulate, connect):
    emulate()
    arm = connect()
    arm.rise(0.05)
    arm.poll_until(arm.rising)
    tool = kinematics.forward(arm.state.joints_rad) @ kinematics.frame(UrSettings().tcp_offset)
    assert kinematics.pose(tool)[:3] == pytest.approx(arm.state.position_m, abs=1e-6)


@pytest.mark.parametrize(("profile", "upper"), [("cb3", True), ("e-series", True), ("cb3", False)])
def test_moves_and_watchdog_beside_a_fieldbus_that_claims_the_other_registers(
    emulate, connect, profile, upper
):
    emulator = emulate(profile)
    first = 0 if upper else 24
    others = [f"input_{kind}_register_{first + n}" for kind in ("int", "double") for n in range(24)]
    emulator.do("claim", names=others)
    arm = connect(upper_registers=upper)
    arm.rise(0.05)
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.risen_m() == pytest.approx(0.05, abs=1e-3)
    arm.rise(0.4)
    arm.poll_until(arm.rising)
    (worker,) = workers()
    os.kill(worker, signal.SIGSTOP)  # nothing kicks the watchdog any more
    stopped = emulator.state_when(lambda state: state["runtime_state"] != PROGRAM_RUNNING)
    assert any("watchdog" in line for line in stopped["messages"])
    os.kill(worker, signal.SIGCONT)


def test_a_stop_during_a_move_is_confirmed(emulate, connect):
    emulator = emulate()
    arm = connect()
    arm.rise(0.4)
    arm.poll_until(arm.rising)
    arm.driver.stop(1.0)
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.risen_m() < 0.3
    assert emulator.do("state")["runtime_state"] == PROGRAM_RUNNING
    here = arm.state.position_m
    arm.driver.move_to((*here[:2], here[2] + 0.02), 0.1, 1.0)  # and it moves again
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.state.position_m[2] == pytest.approx(here[2] + 0.02, abs=1e-3)


def test_protective_stop_is_a_fault_and_reconnection_is_refused(emulate, connect):
    emulator = emulate()
    arm = connect()
    arm.rise(0.4)
    arm.poll_until(arm.rising)
    emulator.do("protective_stop")
    arm.expect_error(DeviceFault, "protective stop")
    with pytest.raises(Refused, match="protective stop"):
        arm.rise(0.0)
    with pytest.raises(DeviceFault, match="PROTECTIVE_STOP"):
        arm.link.connect()
    with pytest.raises(LinkLost, match="not connected"):
        arm.poll()


def test_emergency_stop_is_a_fault(emulate, connect):
    emulator = emulate()
    arm = connect()
    arm.rise(0.4)
    arm.poll_until(arm.rising)
    emulator.do("emergency_stop")
    error = arm.expect_error(DeviceFault, "safety system")
    assert "emergency stop" in error.remedy
    arm.expect_error(DeviceFault, "stop")  # raised once by the driver itself
    assert arm.state.stopped_by_safety
    assert arm.risen_m() > 0.0  # the pose without power is not used


def test_killed_program_is_a_fault_and_reconnection_restarts_it(emulate, connect):
    emulator = emulate()
    arm = connect()
    arm.driver.set_payload(2.6)
    emulator.do("kill_program")
    error = arm.expect_error(DeviceFault, "program on the arm controller has ended")
    assert "start the run again" in error.remedy
    arm.poll()  # once for each onset
    with pytest.raises(DeviceFault, match="program"):
        arm.rise(0.05)
    arm.link.connect()
    arm.rise(0.05)
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.risen_m() == pytest.approx(0.05, abs=1e-3)


def test_frozen_controller_is_stale_first_then_lost(emulate, connect):
    emulator = emulate()
    arm = connect()
    emulator.do("freeze", seconds=3.0)
    with pytest.raises(Stale, match="the arm controller's clock stands still"):
        arm.poll_until(lambda: False, patient=False)
    arm.expect_error(LinkLost, "sends no data")
    with pytest.raises(LinkLost):
        arm.rise(0.05)
    emulator.state_when(lambda state: True)  # the freeze is over
    arm.link.connect()
    arm.poll_until(lambda: arm.state.position_m[2] == pytest.approx(arm.start_m[2], abs=1e-3))


def test_dropped_link_is_lost_and_does_not_reconnect_by_itself(emulate, connect):
    emulator = emulate()
    arm = connect()
    emulator.do("drop_link")
    arm.expect_error(LinkLost, "link to the arm lost")
    arm.link.connect()
    arm.poll()


def test_killed_worker_is_link_lost_and_the_watchdog_stops_the_arm(emulate, connect):
    emulator = emulate()
    arm = connect()
    arm.rise(0.4)
    arm.poll_until(arm.rising)
    (pid,) = workers()
    os.kill(pid, signal.SIGKILL)
    arm.expect_error(LinkLost, "worker process ended")
    ended = emulator.state_when(lambda s: s["runtime_state"] != PROGRAM_RUNNING)
    assert at_end(emulator)["position_m"][2] < arm.start_m[2] + 0.39, ended
    arm.link.connect()
    arm.driver.poll(time.monotonic_ns())
    arm.rise(0.0)
    arm.poll_until(lambda: not arm.state.moving)


def test_arm_of_a_caller_that_stops_reading_is_stopped_by_the_watchdog(emulate, connect):
    emulator = emulate()
    arm = connect(heartbeat_timeout_s=0.2)
    arm.rise(0.4, 0.05)  # 8 s
    arm.poll_until(arm.rising)
    emulator.state_when(lambda state: state["runtime_state"] != PROGRAM_RUNNING)
    assert at_end(emulator)["position_m"][2] < arm.start_m[2] + 0.35
    arm.expect_error(DeviceFault, "program")


def test_dead_parent_leaves_no_motion_and_no_process(emulate, host):
    emulator = emulate()
    script = f"""
import time
from drivers.ur.link.client import UrLink, UrSettings
link = UrLink(UrSettings(host={host!r}, watchdog_hz=2.0, heartbeat_timeout_s=5.0))
link.connect()
x, y, z = link.read(time.monotonic_ns()).position_m
link.move_l((x, y, z + 0.4), 0.05, 1.0, time.monotonic_ns())
print("moving", flush=True)
while True:
    link.read(time.monotonic_ns())
    time.sleep(0.01)
"""
    parent = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE)
    with parent:
        parent.stdout.readline()
        (worker,) = workers(parent.pid)
        emulator.state_when(lambda state: state["moving"])
        parent.kill()
    state = emulator.state_when(
        lambda s: not s["moving"] and s["runtime_state"] != PROGRAM_RUNNING, LONG_S
    )
    assert state["position_m"][2] < 0.3 + 0.35
    deadline = time.monotonic() + LONG_S
    while os.path.exists(f"/proc/{worker}"):
        assert time.monotonic() < deadline
        time.sleep(0.02)


RANDOM = random.Random(4)


@pytest.mark.parametrize("after_s", [RANDOM.uniform(0.0, 3.0) for _ in range(1)])
def test_ctrl_c_during_the_start_leaves_no_worker_and_no_program(emulate, host, after_s):
    emulator = emulate()
    script = f"""
import time
from drivers.ur.link.client import UrLink, UrSettings
print("begins", flush=True)
UrLink(UrSettings(host={host!r}, watchdog_hz=2.0)).connect()
time.sleep(60)
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    with parent:
        parent.stdout.readline()
        time.sleep(after_s)
        started = workers(parent.pid)
        parent.send_signal(signal.SIGINT)
        parent.wait(LONG_S)
    deadline = time.monotonic() + LONG_S
    while any(os.path.exists(f"/proc/{worker}") for worker in started):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    emulator.state_when(lambda s: s["runtime_state"] != PROGRAM_RUNNING, LONG_S)


def test_an_arm_moved_by_another_program_is_refused(emulate, host, monkeypatch):
    emulator = emulate()
    with socket.create_connection((host, SCRIPT_PORT), LONG_S) as other:
        other.sendall(
            b"def other():\n  movel(p[0.5, 0.1, 0.5, 3.141592653589793, 0, 0], a=1, v=0.01)\nend\n"
        )
        emulator.state_when(lambda state: state["moving"])
        with pytest.raises(DeviceFault, match="a program runs on the arm already"):
            UrLink(UrSettings(host=host, step_timeout_s=0.5)).connect()
        monkeypatch.setattr(
            client, "raise_failures", lambda *_: None
        )  # as if the program had started after the check
        with pytest.raises(DeviceFault, match="the arm moves"):
            UrLink(UrSettings(host=host, step_timeout_s=0.5)).connect()
        assert emulator.do("state")["runtime_state"] == PROGRAM_RUNNING
    assert workers() == []


def test_close_ends_the_program_and_leaves_nothing(emulate, connect):
    emulator = emulate()
    before = threading.active_count()
    arm = connect()
    (pid,) = workers()
    arm.rise(0.4)
    arm.poll_until(arm.rising)
    arm.link.close()
    assert not os.path.exists(f"/proc/{pid}")
    assert threading.active_count() == before
    state = emulator.state_when(lambda s: s["runtime_state"] != PROGRAM_RUNNING)
    assert not state["moving"] and state["position_m"][2] < arm.start_m[2] + 0.35


@needs_ur_rtde
def test_an_unconnected_link_cannot_be_read():
    link = UrLink(UrSettings(host="127.0.0.2"))
    with pytest.raises(LinkLost, match="connect"):
        link.read(0)
    link.close()


def test_settings_out_of_range_are_refused():
    for bad in [{"watchdog_hz": 0.0}, {"step_timeout_s": 0.0}, {"hots": "x"}]:
        with case(bad), pytest.raises(msgspec.ValidationError):
            msgspec.convert({"host": "127.0.0.2"} | bad, UrSettings)
