"""`grasp gripper` and `grasp arm` at an emulated lab: what they move, and what stops them."""

import json
import re
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeviceFault
from drivers.ur.link.preflight import Dashboard, Rtde
from grasp.clock import WallClock
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.cell_control import ControlClient
from scenarios.rigs.cell_lock import arm_of, driving, gripper_of
from scenarios.rigs.device_checks import read_gripper
from scenarios.rigs.wired import open_arm
from tests.wire.scenarios.lab.terminal import grasp, started
from tests.wire.scenarios.test_rigs import emulate, lab_file

Counts = tuple[int, ...]
CONFIRMED = ("--confirm-motion",)


class Lab:
    """An emulated cell, the file that points at it, and what a person sees of it."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        self.file = lab_file(folder / "lab.toml", endpoints)
        self.cell = ControlClient(endpoints["control"]["host"], endpoints["control"]["port"])

    @property
    def config(self) -> RunConfig:
        return load_config("can", "hardware", "energy", self.file)

    def grasp(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return grasp(*words, "--config", str(self.file))

    def done(self, *words: str) -> str:
        done = self.grasp(*words, *CONFIRMED)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def rested(self, *words: str) -> "subprocess.CompletedProcess[str]":
        """Asked again while rubber that was pressed a moment ago still creeps back."""
        deadline = time.monotonic() + 60
        while "unsteady at rest" in (done := self.grasp(*words)).stderr:
            assert done.returncode == 4, done.stderr
            assert time.monotonic() < deadline, done.stderr
        assert done.returncode == 0, done.stderr
        return done

    @property
    def places(self) -> Counts:
        return tuple(finger.position for finger in read_gripper(self.config)[1].fingers)

    @property
    def height_m(self) -> float:
        clock = WallClock()
        with open_arm(self.config, lambda: clock.now_ns) as arm:
            arm.pump(clock.now_ns)
            assert arm.state is not None
            return arm.state.position_m[2]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate("--set", "hand.activation_s=3") as endpoints:
        found = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        yield found
        found.cell.close()


@pytest.fixture
def ready(lab: Lab) -> Lab:
    """With an active hand, whichever test was first."""
    lab.done("gripper", "activate", "--empty")
    return lab


def test_activation_is_stopped_by_ctrl_c_and_the_hand_is_inactive_then(lab: Lab) -> None:
    with started("gripper", "activate", "--empty", *CONFIRMED, "--config", str(lab.file)) as run:
        while max(lab.places) < 20:
            time.sleep(0.05)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=30)
    assert run.returncode == 130, said
    assert "the fingers stand; the hand is not active any more" in said
    before, now = read_gripper(lab.config)
    assert not now.active
    assert now.fingers == before.fingers
    assert max(lab.places) > 6


def test_hand_is_activated_only_by_whoever_says_that_it_is_empty(lab: Lab) -> None:
    asked = lab.grasp("gripper", "activate", *CONFIRMED)
    assert asked.returncode == 2
    assert "opens and closes the hand fully" in asked.stderr
    assert (
        "open and close all fingers fully" in lab.grasp("gripper", "activate", "--dry-run").stdout
    )
    assert "active, fingers at (6, 6, 6)" in lab.done("gripper", "activate", "--empty")
    assert "already" in lab.done("gripper", "activate", "--empty")
    told = lab.grasp("gripper", "status")
    assert told.returncode == 0
    assert all(name in told.stdout for name in ("gACT 1", "gIMC 3: ready", "finger C: at 6"))


def test_activation_that_is_refused_or_finds_nobody_leaves_the_hand_as_it_was(ready: Lab) -> None:
    """A hand that holds something is not reset either: it could not be opened gently after that."""
    ready.done("gripper", "open")
    ready.cell.ask("place")
    ready.done("gripper", "close")
    ready.cell.ask("fault", name="gripper_fault", code=10)
    refused = ready.grasp("gripper", "activate", "--empty", *CONFIRMED)
    assert refused.returncode == 4
    assert "would drop" in refused.stderr
    assert "not active any more" not in refused.stderr
    assert read_gripper(ready.config)[1].active
    nobody = ready.grasp(
        "gripper", "activate", "--empty", *CONFIRMED, "--set", "modbus.host=127.0.0.1",
        "--set", "modbus.port=9",
    )  # fmt: skip
    assert nobody.returncode == 3
    assert "NOT SEEN TO STAND" not in nobody.stderr  # nothing was told to move
    ready.done("release", "--rig", "hardware")
    ready.done("gripper", "activate", "--empty")


@pytest.mark.parametrize(
    "words",
    [("gripper", "open"), ("gripper", "close"), ("gripper", "step"), ("arm", "step", "--z", "2")],
    ids=" ".join,
)
def test_nothing_moves_unconfirmed_or_dry(words: tuple[str, ...], ready: Lab) -> None:
    before = ready.places, ready.height_m
    assert ready.grasp(*words).returncode == 2
    dry = ready.grasp(*words, "--dry-run")
    assert dry.returncode == 0, dry.stderr
    assert dry.stdout.startswith("would move")
    assert (ready.places, ready.height_m) == before


DRY = (
    ("gripper", "open"), ("gripper", "close"), ("gripper", "step", "--finger", "B"),
    ("calibrate", "hand", "--up-to", "16", "--out", "none.toml"),
    ("calibrate", "force", "--press", "--out", "none.toml"),
    ("calibrate", "noise", "--out", "none.toml"),
)  # fmt: skip


@pytest.mark.parametrize("words", DRY, ids=" ".join)
def test_dry_run_is_refused_where_the_motion_would_be(words: tuple[str, ...], ready: Lab) -> None:
    with driving(gripper_of(ready.config)):
        driven = ready.grasp(*words, "--dry-run")
    assert driven.returncode == 4, driven.stdout
    assert "is driven by process" in driven.stderr
    ready.cell.ask("fault", name="gripper_fault", code=14)
    asleep = ready.grasp(*words, "--dry-run")
    assert asleep.returncode == 4, asleep.stdout
    assert "the hand is not active" in asleep.stderr
    ready.done("release", "--rig", "hardware", "--activate")
    assert ready.rested(*words, "--dry-run").stdout.startswith("would move ")


def test_dry_run_hears_the_fingertips_and_sees_a_thumb_in_the_way(ready: Lab) -> None:
    ready.done("gripper", "open")
    deaf = ("--set", "usb.url=tcp://127.0.0.99:9", "--dry-run")
    assert ready.grasp("gripper", "close", *deaf).returncode == 3
    assert ready.grasp("gripper", "open", *deaf).returncode == 0  # which hears nothing either
    ready.done("gripper", "close", "--finger", "A", "--to", "40")
    in_the_way = ready.grasp("gripper", "close", "--dry-run")
    assert in_the_way.returncode == 4
    assert "the thumb stands at 40 counts" in in_the_way.stderr
    assert ready.grasp("gripper", "step", "--finger", "A", "--dry-run").returncode == 0
    scale = ("calibrate", "hand", "--up-to", "16", "--out", "none.toml", "--dry-run")
    assert "the hand is not open" in ready.grasp(*scale).stderr
    ready.done("gripper", "open")


def test_arm_is_stepped_and_stopped_without_an_address_of_a_gripper(lab: Lab) -> None:
    alone = ("--rig", "hardware", "--set", f"ur.host={lab.config.ur.host}")
    stepped = grasp("arm", "step", "--z", "1", *alone, *CONFIRMED)
    assert stepped.returncode == 0, stepped.stderr
    assert grasp("arm", "step", "--z", "-1", *alone, *CONFIRMED).returncode == 0
    with driving(arm_of(lab.config)):
        driven = grasp("arm", "step", "--z", "1", *alone, "--dry-run")
    assert driven.returncode == 4
    assert "is driven by process" in driven.stderr


def test_finger_steps_there_and_back(ready: Lab) -> None:
    ready.done("gripper", "open")
    assert "fingers at (6, 12, 6)" in ready.done("gripper", "step", "--finger", "B", "--mm", "5")
    assert "fingers at (6, 10, 6)" in ready.done("gripper", "step", "--finger", "B", "--open")
    refused = ready.grasp("gripper", "step", "--mm", "6", *CONFIRMED)
    assert refused.returncode == 2


def test_dry_runs_of_lift_tap_and_release_ask_the_devices_and_move_nothing(ready: Lab) -> None:
    before = ready.places, ready.height_m
    hardware = ("--rig", "hardware", "--dry-run")
    lift = ready.grasp("run", "lift", "--first", *hardware)
    assert lift.returncode == 0, lift.stderr
    assert "would lift the arm by 200 mm at 50 mm/s" in lift.stdout
    assert "no finger told more than 10 N" in lift.stdout
    assert lift.stdout.endswith("would start\n")
    tap = ready.grasp("run", "tap", *hardware)
    assert tap.returncode == 0, tap.stderr
    assert "would lift the arm by 80 mm at 100 mm/s\n" in tap.stdout
    assert "would ask for the object to be tapped" in tap.stdout
    assert "would lower the arm at 50 mm/s, open the fingers\n" in tap.stdout
    assert "would do so 20 times" in tap.stdout
    opened = ready.grasp("release", *hardware)
    assert opened.returncode == 0, opened.stderr
    assert "would open the fingers of the gripper at" in opened.stdout
    weak = ready.grasp("run", "lift", *hardware, "--set", "guard.force_limit_n=9")
    assert weak.returncode == 2
    nobody = ready.grasp("run", "lift", *hardware, "--set", "modbus.port=9")
    assert nobody.returncode == 3
    assert nobody.stdout.endswith("would not start\n")
    assert (ready.places, ready.height_m) == before


def test_a_run_says_what_will_move_and_moves_nothing_where_nobody_can_answer(
    ready: Lab, tmp_path: Path
) -> None:
    before = ready.places, ready.height_m
    out = ("--out", str(tmp_path / "new.toml"))
    for words in (
        ("run", "tap", "--rig", "hardware", "--runs", str(tmp_path)),
        ("run", "lift", "--first", "--rig", "hardware", "--runs", str(tmp_path)),
        ("calibrate", "hand", "--up-to", "16", "--scale", *out),
        ("calibrate", "force", "--press", "--scale", *out),
        ("calibrate", "force", *out),
        ("calibrate", "noise", *out),
    ):
        nobody = ready.grasp(*words, *CONFIRMED)
        assert nobody.returncode == 2, nobody.stderr
        assert "nobody is there to be asked: standard input has ended" in nobody.stderr
        if words[1] == "tap":
            assert "will lift the arm by 80 mm" in nobody.stderr
            assert "will do so 20 times" in nobody.stderr
        if words[1] == "lift":
            assert "will lift the arm by 200 mm at 50 mm/s" in nobody.stderr
    assert (ready.places, ready.height_m) == before


def test_a_workspace_without_the_start_is_refused_by_doctor_dry_run_and_run(ready: Lab) -> None:
    before = ready.places
    without = ("--rig", "hardware", "--set", "arm.workspace_low_m=[0.2,-0.5,0.1]")
    doctor = ready.grasp("doctor", *without)
    assert doctor.returncode == 3
    assert "leaves out where the arm starts" in doctor.stdout
    for words in (("--dry-run",), CONFIRMED):
        run = ready.grasp("run", "lift", *without, *words)
        assert run.returncode == 2, run.stdout
        assert "leaves out where the arm starts" in run.stderr
    assert ready.places == before


def test_what_will_move_is_said_before_it_moves(ready: Lab) -> None:
    ready.done("gripper", "open")
    stepped = ready.grasp("gripper", "step", "--finger", "B", "--mm", "2", *CONFIRMED)
    assert stepped.returncode == 0
    assert "will move fingers from (6, 6, 6) to (6, 8, 6) counts at 22 mm/s" in stepped.stderr
    opened = ready.grasp("gripper", "open", *CONFIRMED)
    assert "will move fingers from (6, 8, 6) to (0, 0, 0) counts at 22 mm/s" in opened.stderr
    moved = ready.grasp("arm", "step", "--z", "1", *CONFIRMED)
    assert "will move the arm at" in moved.stderr
    assert "z +1 mm at 10 mm/s in a straight line" in moved.stderr
    ready.done("arm", "step", "--z", "-1")


def test_thumb_never_bears_what_two_fingers_press(ready: Lab) -> None:
    """B and C push the can against the open thumb, unless they stand where they feel it."""
    ready.done("gripper", "open")
    ready.cell.ask("place")
    closed = ready.done("gripper", "close")
    truth = ready.cell.ask("truth")["truth"]
    assert "finger A met something" in closed
    assert 5.0 < truth["normal_n"][0] < 10.5
    assert truth["peak_n"][0] < 11.0
    further = ready.grasp("gripper", "step", "--finger", "B", *CONFIRMED)
    assert further.returncode == 4
    assert "fingertips can tell a touch" in further.stderr
    known = ready.file.parent / "rest.toml"
    ready.done("gripper", "open")
    ready.rested("tactile", "rest", "--out", str(known))
    ready.done("gripper", "step", "--finger", "B", "--mm", "5")
    ready.done("gripper", "step", "--finger", "C", "--config", str(known))  # not open: by its rest
    ready.done("gripper", "open")


def test_closing_is_refused_where_a_run_would_be(ready: Lab) -> None:
    before = ready.places
    weak = ready.grasp("gripper", "close", *CONFIRMED, "--set", "gripper.calibration=manual")
    assert weak.returncode == 2
    assert "cannot close with less than 15 N" in weak.stderr
    deaf = ready.grasp("gripper", "close", *CONFIRMED, "--set", "usb.url=tcp://127.0.0.99:9")
    assert deaf.returncode == 3
    assert ready.places == before


def test_nothing_closes_while_the_hand_reports_a_fault(ready: Lab) -> None:
    ready.done("gripper", "open")
    before = ready.places
    ready.cell.ask("fault", name="gripper_fault", code=5)
    presses = ("calibrate", "hand", "--up-to", "16", "--out", "none.toml")
    for words in (("gripper", "close"), ("gripper", "step"), presses):
        for how in (CONFIRMED, ("--dry-run",)) if words is not presses else (("--dry-run",),):
            refused = ready.grasp(*words, *how)
            assert refused.returncode == 3, refused.stdout
            assert "the gripper reports a fault, action delayed" in refused.stderr
    status = ready.grasp("gripper", "status")
    assert status.returncode == 3
    assert "action delayed: activation must complete first (wait)" in status.stderr
    assert ready.grasp("gripper", "open", "--dry-run").returncode == 0  # what is held can be let go
    assert ready.places == before
    ready.cell.ask("fault", name="gripper_fault", code=0)
    ready.done("gripper", "open")


def test_a_refusal_without_leave_says_what_the_verb_would_do_or_why_it_would_not(
    ready: Lab,
) -> None:
    ready.done("gripper", "open")
    told = "B and C no further than where anything is felt, then the thumb alone"
    assert told in ready.grasp("gripper", "close").stderr
    assert told in ready.grasp("gripper", "close", "--dry-run").stdout
    assert told not in ready.grasp("gripper", "step", "--finger", "A").stderr
    weak = ready.grasp("gripper", "close", "--set", "gripper.calibration=manual")
    assert weak.returncode == 2
    assert "cannot close with less than 15 N" in weak.stderr
    narrow = ("--z", "5", "--set", "arm.workspace_high_m=[0.1,0.1,0.004]")
    for how in (CONFIRMED, ("--dry-run",)):
        out = ready.grasp("arm", "step", *narrow, *how)
        assert out.returncode == 4
        assert "+5 mm in z leaves the workspace" in out.stderr


def test_doctor_without_a_rig_says_that_a_labs_devices_were_not_asked(lab: Lab) -> None:
    told = lab.grasp("doctor")
    assert told.returncode == 0
    assert "none was asked, though your settings name gripper, arm, fingertips" in told.stdout
    assert "no device was asked (--rig hardware asks a lab's)" in told.stdout.splitlines()[-1]
    assert "devices" not in grasp("doctor").stdout


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


def test_closing_is_stopped_by_ctrl_c_where_it_is(ready: Lab) -> None:
    ready.done("gripper", "open")
    words = ("gripper", "close", "--finger", "A", *CONFIRMED, "--config", str(ready.file))
    with started(*words) as run:
        while ready.places[0] < 30:
            time.sleep(0.05)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=30)
    assert run.returncode == 130, said
    assert "the fingers stand, at (" in said
    stood = ready.places
    assert 30 <= stood[0] < 105  # short of the can
    time.sleep(0.3)
    assert ready.places == stood
    ready.done("gripper", "open")


def test_fingers_stand_where_the_fingertips_fall_silent(ready: Lab) -> None:
    ready.done("gripper", "open")
    words = ("gripper", "close", "--finger", "A", *CONFIRMED, "--config", str(ready.file))
    with started(*words) as run:
        while ready.places[0] < 30:
            time.sleep(0.05)
        ready.cell.ask("fault", name="unplug")
        _, said = run.communicate(timeout=60)
    ready.cell.ask("fault", name="replug")
    assert run.returncode in (3, 4), said
    assert "the fingers stand, at (" in said
    assert 30 <= ready.places[0] < 105
    ready.done("gripper", "open")


@pytest.mark.parametrize(
    ("fingers", "watched"), [(("--finger", "A"), 0), ((), 1)], ids=["A", "B and C"]
)
def test_fingers_whose_link_freezes_go_no_further_than_a_step(
    ready: Lab, fingers: tuple[str, ...], watched: int
) -> None:
    ready.done("gripper", "open")
    ready.cell.ask("place")
    words = ("gripper", "close", *fingers, *CONFIRMED, "--config", str(ready.file))
    with started(*words) as run:
        while (frozen_at := ready.places)[watched] < 50:
            time.sleep(0.02)
        ready.cell.ask("fault", name="gripper_freeze", seconds=4.0)
        _, said = run.communicate(timeout=60)
    assert run.returncode == 3, said
    time.sleep(4.0)
    run_on = [end - at for end, at in zip(ready.places, frozen_at, strict=True)]
    assert max(run_on) <= 6 + 3  # 5 mm, and what it moved between look and freeze
    assert max(ready.cell.ask("truth")["truth"]["normal_n"]) < 0.01  # the can is at 103
    ready.done("gripper", "open")
    ready.cell.ask("take")


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
