"""`grasp arm` at an emulated lab: what it moves, and what stops it."""

import json
import re
import socket
import struct
import threading
import time

import pytest

from drivers.errors import DeviceFault
from drivers.ur.link.preflight import Dashboard, Rtde
from grasp.clock import WallClock
from scenarios.rigs.permission import arm_of, driving
from scenarios.rigs.wired import open_arm
from tests.wire.scenarios.lab.bench import CONFIRMED, Lab
from tests.wire.scenarios.lab.terminal import grasp


def test_arm_is_stepped_and_stopped_without_an_address_of_a_gripper(lab: Lab) -> None:
    alone = ("--rig", "hardware", "--set", f"ur.host={lab.config.ur.host}")
    stepped = grasp("arm", "step", "--z", "1", *alone, *CONFIRMED)
    assert stepped.returncode == 0, stepped.stderr
    assert grasp("arm", "step", "--z", "-1", *alone, *CONFIRMED).returncode == 0
    with driving(arm_of(lab.config)):
        driven = grasp("arm", "step", "--z", "1", *alone, "--dry-run")
    assert driven.returncode == 4
    assert "is driven by process" in driven.stderr


def test_arm_that_another_program_moves_is_not_stepped(lab: Lab) -> None:
    lab.done("arm", "stop")
    host, before_m = lab.config.ur.host, lab.height_m
    with socket.create_connection((host, 30002), 10.0) as other:
        pose = f"p[0.5, 0.1, {before_m + 0.2:.3f}, 3.1, 0, 0]"
        other.sendall(f"def other():\n  movel({pose}, a=1, v=0.004)\nend\n".encode())
        while "speed, mm/s: 0.0" in lab.grasp("arm", "status").stdout:
            time.sleep(0.1)
        for how in (CONFIRMED, ("--dry-run",)):
            step = lab.grasp("arm", "step", "--z", "1", *how)
            assert step.returncode == 3, step.stdout
            assert "the arm moves" in step.stderr or "a program runs on the arm" in step.stderr
        assert "program: runs" in lab.grasp("arm", "status").stdout
    lab.done("arm", "stop")


def test_arm_steps_by_what_was_asked(lab: Lab) -> None:
    before_m = lab.height_m
    assert "after x +0, y +0, z +3 mm" in lab.done("arm", "step", "--z", "3")
    assert lab.height_m - before_m == pytest.approx(0.003, abs=0.0003)
    told = lab.grasp("arm", "status")
    assert told.returncode == 0
    assert "safety mode 1: normal" in told.stdout
    assert "joints, degrees: base" in told.stdout


def test_arm_in_a_protective_stop_is_told_with_its_remedy(lab: Lab) -> None:
    lab.cell.ask("fault", name="protective_stop")
    told = lab.grasp("arm", "status")
    assert told.returncode == 3
    assert "safety mode 3: protective stop" in told.stdout
    assert "clear it there" in told.stderr
    dry = lab.grasp("arm", "step", "--z", "1", "--dry-run")
    assert dry.returncode == 3
    assert "PROTECTIVE_STOP" in dry.stderr and "clear it there" in dry.stderr
    step = lab.grasp("arm", "step", "--z", "1", *CONFIRMED)
    assert step.returncode == 3
    assert "PROTECTIVE_STOP" in step.stderr
    time.sleep(5.2)
    with Dashboard(lab.config.ur.host, 2.0) as dashboard:
        dashboard.line()
        dashboard.ask("unlock protective stop")


def sent(lab: Lab, port: int, text: str) -> None:
    with socket.create_connection((lab.config.ur.host, port), 5.0) as peer:
        peer.sendall(text.encode())


def test_program_that_runs_on_the_arm_is_told_before_a_run_or_a_step_with_what_ends_it(
    lab: Lab,
) -> None:
    sent(lab, 30003, "def theirs():\n while True:\n  sleep(0.1)\n end\nend\n")
    deadline = time.monotonic() + 10.0
    while "program: runs" not in lab.grasp("arm", "status").stdout:
        assert time.monotonic() < deadline
    try:
        told = lab.grasp("doctor", "--rig", "hardware")
        assert told.returncode == 3
        assert re.search("^FAIL +arm program .*already", told.stdout, re.MULTILINE)
        dry = lab.grasp("run", "lift", "--rig", "hardware", "--dry-run")
        assert dry.returncode == 3
        assert "would not start" in dry.stdout
        assert "`grasp arm stop`" in dry.stderr
        for words in (("arm", "step", "--z", "1"), ("run", "lift", "--rig", "hardware")):
            refused = lab.grasp(*words, *CONFIRMED)
            assert refused.returncode == 3, refused.stderr
            assert "a program runs on the arm already" in refused.stderr
            assert "did not start" not in refused.stderr
    finally:
        lab.done("arm", "stop")


def test_speed_slider_is_told_and_refused_where_a_run_would_not_end_in_time(lab: Lab) -> None:
    def at(fraction: float) -> None:
        with Rtde(lab.config.ur.host, 2.0) as rtde:
            rtde.ask(b"V", struct.pack(">H", 2))
            (recipe,) = rtde.ask(b"I", b"speed_slider_mask,speed_slider_fraction")[:1]
            rtde.ask(b"S", b"")
            rtde.tell(b"U", struct.pack(">BId", recipe, 1, fraction))
            time.sleep(0.3)

    at(0.6)
    try:
        assert "speed slider: 60 %" in lab.grasp("arm", "status").stdout
        assert "speed slider at 60 %: the arm moves at so much" in lab.grasp(
            "arm", "step", "--z", "1", *CONFIRMED
        ).stderr  # fmt: skip
        dry = lab.grasp("run", "lift", "--rig", "hardware", "--dry-run")
        assert "arm speed slider: speed slider at 60 %" in dry.stderr
        at(0.05)
        dry = lab.grasp("run", "lift", "--rig", "hardware", "--dry-run")
        assert dry.returncode == 3
        assert "would not start" in dry.stdout
        for words in (("arm", "step", "--z", "1"), ("run", "lift", "--rig", "hardware")):
            refused = lab.grasp(*words, *CONFIRMED)
            assert refused.returncode == 3, refused.stderr
            assert "speed slider at 5 %" in refused.stderr
            assert "100 % at the teach pendant" in refused.stderr
    finally:
        at(1.0)


def test_remedy_of_an_arm_that_answers_on_no_port_is_told_once(lab: Lab) -> None:
    step = lab.grasp("arm", "step", "--z", "1", *CONFIRMED, "--set", "ur.host=127.0.0.99")
    assert step.returncode == 3
    assert step.stderr.count("Connection refused") == 3
    assert step.stderr.count("check power, cable and address") == 1


def test_stopping_the_arm_needs_no_leave_and_a_dry_run_stops_nothing(lab: Lab) -> None:
    dry = lab.grasp("arm", "stop", "--dry-run")
    assert dry.returncode == 0
    assert f"would end the program on the arm at {lab.config.ur.host}" in dry.stdout
    for words in ((), CONFIRMED):
        done = lab.grasp("arm", "stop", *words)
        assert done.returncode == 0, done.stderr
        assert "no program runs on it" in done.stdout


def test_arm_that_somebody_drives_is_stopped_without_asking_them(lab: Lab) -> None:
    clock, ended = WallClock(), threading.Event()

    def drive() -> None:
        with open_arm(lab.config, lambda: clock.now_ns) as arm:
            try:
                while True:
                    arm.pump(clock.now_ns)
                    arm.drive((0.0, 0.0, 0.01), 0.0, 0.5)
                    time.sleep(0.01)
            except DeviceFault:  # its program has ended
                ended.set()

    driver = threading.Thread(target=drive)
    driver.start()
    time.sleep(3.0)
    stopped = json.loads(lab.grasp("arm", "stop", "--json").stdout)
    assert "no program runs on it" in stopped["done"]
    assert ended.wait(5.0)
    driver.join(10.0)
    before_m = lab.height_m
    time.sleep(0.2)
    assert lab.height_m == before_m
