"""Lab commands on an emulated cell: search, motion, refusals and stops. Tests of the polled driver
cores in virtual time are in tests/unit."""

import json
import re
import signal
import socket
import struct
import threading
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeviceFault
from drivers.robotiq.emulator import GripperEmulator
from drivers.robotiq.model.gripper import GripperModel, HandSettings
from drivers.robotiq.protocol import AxisCommand, CommandRegisters
from drivers.ur.link.connections import Rtde
from drivers.ur.link.preflight import read_status
from grasp.run.clock import WallClock
from scenarios.campaign.config import load_config
from scenarios.rigs.permission import driving, gripper_of
from scenarios.rigs.wired import open_arm
from tests.ur_rtde import needs_ur_rtde
from tests.wire.lab import ALONE, CONFIRMED, HARDWARE, CommandResult, Lab, grasp, sets
from tests.wire.waiting import PATIENCE_S, until

NO_BOARD = ("--set", "usb.url=tcp://127.0.0.99:9")
SCISSOR = 3
CALIBRATIONS = (("hand", "--up-to", "16"), ("noise",))


def checks(result: CommandResult) -> dict[str, dict[str, str]]:
    return {check["name"]: check for check in json.loads(result.out)["checks"]}


def test_doctor_finds_devices_and_prints_their_settings(lab: Lab) -> None:
    gripper, url = lab.endpoints["gripper"], lab.endpoints["tactile"]["url"]
    result = grasp("doctor", lab.config.ur.host, f"{gripper['host']}:{gripper['port']}", url)
    assert result.code == 0, result.err
    assert "not activated, no fault" in result.out and "robot mode 7: running" in result.out
    for line in (f"port = {gripper['port']}", f'url = "{url}"', f'host = "{lab.config.ur.host}"'):
        assert line in result.out
    assert grasp("doctor", "127.0.0.1/24").code == 2


def test_a_device_of_zeros_is_not_called_a_gripper() -> None:
    model = GripperModel(HandSettings(), time.monotonic_ns(), active=False)
    model.misreport(lambda words: (0,) * len(words))
    emulator = GripperEmulator(model, clock=time.monotonic_ns).start()
    try:
        host, port = emulator.address
        out = grasp("doctor", f"{host}:{port}").out
    finally:
        emulator.stop()
    assert "answers like a gripper that is not activated" in out
    assert "other devices may answer the same" in out


@needs_ur_rtde
def test_doctor_checks_every_device_and_fails_where_a_run_would(lab: Lab) -> None:
    doctor = ("doctor", *HARDWARE, "--json")
    inactive = lab.grasp(*doctor)
    found = checks(inactive)
    assert inactive.code == 3
    assert [name for name, check in found.items() if check["status"] == "fail"] == ["gripper"]
    assert "`grasp gripper activate`" in found["gripper"]["remedy"]
    assert "18 taxels, rest 4" in found["fingertips"]["detail"]
    lab.activate_hand()
    assert lab.grasp(*doctor).code == 0
    for words, check, detail in (
        (("--set", "gripper.calibration=manual"), "force guard", "cannot close with less than 15"),
        (("--set", "tactile.rest_min_counts=460"), "fingertips", "outside 460..512"),
    ):
        failed = lab.grasp(*doctor, *words)
        assert failed.code == 3
        assert checks(failed)[check]["status"] == "fail"
        assert detail in checks(failed)[check]["detail"]


def test_rest_codes_are_written_to_a_settings_file_that_is_not_overwritten(
    lab: Lab, tmp_path: Path
) -> None:
    out = tmp_path / "rest.toml"
    words = ("tactile", "watch", "--rest", "--seconds", "1", "--out", str(out))
    result = lab.grasp(*words)
    assert result.code == 0, result.err
    codes = tomllib.loads(out.read_text())["tactile"]["rest_reference"]
    config = load_config("can", "hardware", "energy", [lab.file, out])
    assert config.tactile.rest_reference == tuple(map(tuple, codes))
    again = lab.grasp(*words)
    assert again.code == 2 and "exists already" in again.err


def test_tactile_watch_reports_rest_codes_and_counts(lab: Lab) -> None:
    report = json.loads(lab.grasp("tactile", "watch", "--seconds", "1", "--json").out)
    assert all(400 < rest < 512 for finger in report["rest"] for rest in finger)
    assert all(abs(counts) < 2.0 for finger in report["counts"] for counts in finger)
    without_board = lab.grasp("tactile", "watch", *NO_BOARD)
    assert without_board.code == 3
    assert "no TakkTile board (59e3:74c7) at tcp://127.0.0.99:9" in without_board.err


@needs_ur_rtde
def test_arm_moves_by_the_given_step_without_an_address_of_a_gripper(lab: Lab) -> None:
    before_m = lab.height_m
    assert "after x +0, y +0, z +3 mm" in lab.run_confirmed("arm", "step", "--z", "3")
    assert lab.height_m - before_m == pytest.approx(0.003, abs=0.0003)
    host = f"ur.host={lab.config.ur.host}"
    alone = sets((host, "ur.watchdog_hz=1", "ur.heartbeat_timeout_s=2", "arm.stale_after_s=1"))

    def back() -> bool:
        moved = grasp("arm", "step", "--z", "-3", *HARDWARE, *alone, *CONFIRMED)
        # a real program ends too if this computer is too busy to kick its watchdog each second
        assert moved.code == 0 or "too busy to keep the program's watchdog" in moved.err, moved
        return moved.code == 0

    until(back)
    assert "safety mode 1: normal" in lab.grasp("status", "arm").out


@needs_ur_rtde
def test_arm_moves_back_to_the_start_of_a_run_but_not_sideways(lab: Lab, tmp_path: Path) -> None:
    host = lab.config.ur.host
    _, now = read_status(host, PATIENCE_S)
    x, y, z = now.pose[:3]

    def back(*start_m: float, arm: str = host, more: tuple[str, ...] = ()) -> Any:
        (tmp_path / "result.json").write_text(json.dumps({"arm": arm, "home_m": start_m}))
        return lab.grasp("arm", "back", str(tmp_path), *CONFIRMED, *more)

    before_m = lab.height_m
    moved = back(x, y, z - 0.02)
    assert moved.code == 0 and "by z -20.0 mm, to where" in moved.err, moved
    assert lab.height_m - before_m == pytest.approx(-0.02, abs=0.0003)
    assert back(x, y, z).code == 0
    for start_m in ((x + 0.01, y, z), (x, y, z - 0.31)):
        refused = back(*start_m)
        assert refused.code == 4 and "not straight above or below" in refused.err
    other = ("--set", "ur.tcp_offset=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0]")  # than the controller's
    refused = back(x, y, z, more=other)
    assert refused.code == 4 and "tool position differs by 100 mm" in refused.err, refused
    assert f"was of 127.0.0.98, not of {host}" in back(x, y, z, arm="127.0.0.98").err
    assert lab.height_m == pytest.approx(before_m, abs=0.0003)


@needs_ur_rtde
def test_arm_with_a_running_program_is_not_moved_and_the_program_can_be_ended(lab: Lab) -> None:
    with socket.create_connection((lab.config.ur.host, 30003), PATIENCE_S) as peer:
        peer.sendall(b"def theirs():\n while True:\n  sleep(0.1)\n end\nend\n")
    until(lambda: "program: runs" in lab.grasp("status", "arm").out)
    soon = sets(("ur.step_timeout_s=0.5",))  # time in which a program may end by itself
    doctor = lab.grasp("doctor", *HARDWARE, *soon)
    assert doctor.code == 3
    assert re.search("^FAIL +arm program .*already", doctor.out, re.MULTILINE)
    for words in (("arm", "step", "--z", "1"), ("run", "lift", *HARDWARE, *ALONE)):
        refused = lab.grasp(*words, *CONFIRMED, *soon)
        assert refused.code == 3, refused
        assert "a program runs on the arm already" in refused.err
    assert "would end any program" in lab.grasp("arm", "stop", "--dry-run").out
    assert "no program runs on it" in lab.grasp("arm", "stop").out


@needs_ur_rtde
def test_arm_with_a_low_speed_slider_is_refused(lab: Lab) -> None:
    lab.ask("fault", name="speed_slider", fraction=0.05)
    for words in (("arm", "step", "--z", "1"), ("run", "lift", *HARDWARE, *ALONE)):
        refused = lab.grasp(*words, *CONFIRMED)
        assert refused.code == 3, refused
        assert "speed slider at 5 %" in refused.err
    with Rtde(lab.config.ur.host, 10.0) as rtde:  # as a pendant's client sets it
        rtde.request(b"V", struct.pack(">H", 2))
        (recipe,) = rtde.request(b"I", b"speed_slider_mask,speed_slider_fraction")[:1]
        rtde.request(b"S", b"")
        rtde.send(b"U", struct.pack(">BId", recipe, 1, 0.6))
        until(lambda: "speed slider: 60 %" in lab.grasp("status", "arm").out)


@needs_ur_rtde
def test_arm_stop_also_stops_an_arm_that_another_program_drives(lab: Lab) -> None:
    clock, moves, ended = WallClock(), threading.Event(), threading.Event()

    def drive() -> None:
        with open_arm(lab.config, lambda: clock.now_ns) as arm:
            try:
                while True:
                    arm.poll(clock.now_ns)
                    arm.drive((0.0, 0.0, 0.01), 0.0, 0.5)
                    if arm.state is not None and arm.state.velocity_mps[2] > 0.005:
                        moves.set()
                    time.sleep(0.01)
            except DeviceFault:  # its program has ended
                ended.set()

    driver = threading.Thread(target=drive)
    driver.start()
    assert moves.wait(PATIENCE_S)
    stopped = json.loads(lab.grasp("arm", "stop", "--json").out)
    assert "no program runs on it" in stopped["done"]
    assert ended.wait(PATIENCE_S)
    driver.join()
    until(lambda: lab.ask("motion")["arm_mps"] == 0.0)


def test_hand_is_activated_only_with_a_confirmation_that_it_is_empty(lab: Lab) -> None:
    refused = lab.grasp("gripper", "activate", *CONFIRMED)
    assert refused.code == 2 and "opens and closes the hand fully" in refused.err
    assert not lab.hand.active
    assert "active, fingers at (6, 6, 6)" in lab.run_confirmed("gripper", "activate", "--empty")
    assert "already" in lab.run_confirmed("gripper", "activate", "--empty")
    status = lab.grasp("status", "gripper").out
    assert all(name in status for name in ("gACT 1", "gIMC 3: ready", "finger C: at 6"))


@needs_ur_rtde
def test_no_run_activates_a_hand(lab: Lab, tmp_path: Path) -> None:
    """Activation opens and closes the hand fully with a force that cannot be set."""
    before, remedy = lab.positions, "`grasp gripper activate`"
    for words in (("lift",), ("lift", "--first"), ("tap",)):
        dry = lab.grasp("run", *words, *HARDWARE, "--dry-run")
        assert dry.code == 4, dry
        assert remedy in dry.err and dry.out.endswith("would not start\n")
        assert ("stop it at 1 m/s2" in dry.out) == ("--first" in words)
    words = ("run", "lift", *HARDWARE, *CONFIRMED, "--runs", str(tmp_path))
    for more in (ALONE, ("--trials", "2")):
        result = lab.grasp(*words, *more, operator=lambda question: "")
        assert result.code == 4, result
        assert f"the hand is not active: nothing was moved (empty it, then {remedy})" in result.err
    assert lab.positions == before and not lab.hand.active


@needs_ur_rtde
def test_nothing_moves_without_a_confirmation_or_in_a_dry_run(ready: Lab, tmp_path: Path) -> None:
    before, out = ready.positions, ("--out", str(tmp_path / "none.toml"))
    verbs = (
        ("release",), ("gripper", "close"), ("gripper", "step"), ("arm", "step", "--z", "2"),
        *(("calibrate", *words, *out) for words in CALIBRATIONS),
    )  # fmt: skip
    for words in verbs:
        scale = ("--scale",) if words[:1] == ("calibrate",) and "noise" not in words else ()
        assert ready.grasp(*words, *scale).code == 2, words
        dry = ready.grasp(*words, "--dry-run")
        assert dry.code == 0, (words, dry)
        assert dry.out.startswith("would move"), words
    for run, would in (("lift", "would lift the arm by 400 mm"), ("tap", "would do so 20 times")):
        dry = ready.grasp("run", run, *HARDWARE, "--dry-run")
        assert dry.code == 0, dry
        assert dry.out.endswith("would start\n") or would in dry.out
    assert ready.positions == before
    assert ready.ask("motion") == {"arm_mps": 0.0, "fingers_mps": 0.0}


def test_nothing_moves_without_an_operator(ready: Lab, tmp_path: Path) -> None:
    before, out = ready.positions, ("--out", str(tmp_path / "none.toml"))
    for words in (
        ("run", "tap", *HARDWARE, "--runs", str(tmp_path)),
        ("run", "lift", "--first", *HARDWARE, "--runs", str(tmp_path)),
        *(
            ("calibrate", *w, *out, *(() if w == ("noise",) else ("--scale",)))
            for w in CALIBRATIONS
        ),
    ):
        refused = ready.grasp(*words, *CONFIRMED)
        assert refused.code == 2, (words, refused)
        assert "no terminal for questions: standard input has ended" in refused.err
    assert ready.positions == before


@needs_ur_rtde
def test_motion_is_refused_while_another_program_drives_the_device(ready: Lab) -> None:
    with driving(gripper_of(ready.config)):
        for words in (
            ("gripper", "close"),
            ("run", "lift", *HARDWARE, *ALONE),
            ("release", *HARDWARE),
        ):
            driven = ready.grasp(*words, *CONFIRMED)
            assert driven.code == 4, (words, driven)
            assert "is driven by process" in driven.err and "`kill " in driven.err


def test_finger_moves_a_step_forward_and_back(ready: Lab) -> None:
    stepped = ready.grasp("gripper", "step", "--finger", "B", "--mm", "5", *CONFIRMED)
    assert "fingers at (6, 12, 6)" in stepped.out
    assert "will move fingers from (6, 6, 6) to (6, 12, 6) counts at 22 mm/s" in stepped.err
    assert "fingers at (6, 10, 6)" in ready.run_confirmed(
        "gripper", "step", "--finger", "B", "--open"
    )
    assert ready.grasp("gripper", "step", "--mm", "6", *CONFIRMED).code == 2


def test_thumb_never_bears_the_force_of_two_fingers(ready: Lab) -> None:
    """B and C would push the can against the open thumb, unless they stop at contact."""
    ready.ask("place")
    closed = ready.run_confirmed("gripper", "close")
    truth = ready.ask("truth")["truth"]
    assert "contact of finger A" in closed
    assert 5.0 < truth["normal_n"][0] < 10.5
    assert truth["peak_n"][0] < 11.0
    further = ready.grasp("gripper", "step", "--finger", "B", *CONFIRMED)
    assert further.code == 4, further
    kept = ready.grasp("gripper", "activate", "--empty", *CONFIRMED)
    assert "already" in kept.out
    ready.ask("fault", name="gripper_fault", code=10)
    refused = ready.grasp("gripper", "activate", "--empty", *CONFIRMED)
    assert refused.code == 4 and "would drop" in refused.err
    assert ready.hand.active


def test_closing_is_refused_where_a_run_would_be_refused(ready: Lab) -> None:
    before = ready.positions
    weak = ready.grasp("gripper", "close", *CONFIRMED, "--set", "gripper.calibration=manual")
    assert weak.code == 2 and "cannot close with less than 15 N" in weak.err
    assert ready.grasp("gripper", "close", *CONFIRMED, *NO_BOARD).code == 3
    assert ready.grasp("release", *CONFIRMED, *NO_BOARD).code == 0  # it reads no fingertips
    ready.ask("fault", name="gripper_fault", code=5)
    refused = ready.grasp("gripper", "close", *CONFIRMED)
    assert refused.code == 3 and "the gripper reports a fault, action delayed" in refused.err
    assert ready.grasp("release", "--dry-run").code == 0  # releasing is still possible
    assert ready.positions == before


@pytest.mark.parametrize("event", ["Ctrl-C", "fingertips unplugged"])
def test_closing_stops_at_once(event: str, ready: Lab) -> None:
    with ready.started("gripper", "close", "--finger", "A", *CONFIRMED) as run:
        until(lambda: ready.positions[0] >= 30, "the finger is on its way")
        if event == "Ctrl-C":
            run.send_signal(signal.SIGINT)
        else:
            ready.ask("fault", name="unplug")
        _, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode in ((130,) if event == "Ctrl-C" else (3, 4)), err
    assert "the fingers have stopped at (" in err
    assert ready.ask("motion")["fingers_mps"] == 0.0
    assert 30 <= ready.positions[0] < 200


@needs_ur_rtde
def test_hand_in_scissor_mode_is_only_opened(ready: Lab) -> None:
    """Another program has set the mode, and the hand may hold something."""
    at, near = AxisCommand(60, 255, 0), AxisCommand(200, 255, 0)
    ready.write(CommandRegisters(activate=True, mode=SCISSOR))
    until(lambda: ready.hand.ready and ready.hand.mode == SCISSOR)
    ready.write(
        CommandRegisters(
            activate=True, mode=SCISSOR, go_to=True, individual_fingers=True,
            individual_scissor=True, a=at, b=at, c=at, scissor=near,
        )
    )  # fmt: skip
    until(lambda: (ready.positions, ready.hand.scissor.position) == ((60, 60, 60), 200))
    message = "the hand is in scissor mode, in which it may only be opened"
    for words in (
        ("run", "lift", *HARDWARE, *ALONE), ("gripper", "close"),
        ("gripper", "step", "--finger", "A"),
    ):  # fmt: skip
        for how in (CONFIRMED, ("--dry-run",)):
            refused = ready.grasp(*words, *how)
            assert refused.code == 4, (words, refused)
            assert message in refused.err
    kept = ready.grasp("gripper", "activate", "--empty", *CONFIRMED)
    assert kept.code == 4 and "would drop the object" in kept.err
    assert (ready.hand.mode, ready.positions) == (SCISSOR, (60, 60, 60))
    ready.run_confirmed("release", *HARDWARE)
    now = ready.hand
    assert (now.mode, now.scissor.position) == (SCISSOR, 0), "its mode is not changed by that"
    assert max(ready.positions) < 10
    assert "active, fingers at (6, 6, 6)" in ready.run_confirmed("gripper", "activate", "--empty")
    assert (ready.hand.mode, ready.hand.scissor.position) == (0, 137)


def closed(lab: Lab) -> None:
    """Close the hand, as it is after a run that ended in a fault."""
    at = AxisCommand(120, 255, 0)
    lab.write(
        CommandRegisters(activate=True, go_to=True, individual_fingers=True, a=at, b=at, c=at)
    )
    until(lambda: lab.positions == (120, 120, 120))


def test_hand_opens_without_arm_and_fingertips(ready: Lab) -> None:
    closed(ready)
    ready.ask("fault", name="unplug")
    result = ready.grasp("release", *HARDWARE, *CONFIRMED, "--json", "--set", "ur.host=127.0.0.99")
    assert result.code == 0, result
    report = json.loads(result.out)
    assert max(report["positions_counts"]) < 10
    assert "Connection refused" in report["arm"]
    assert "no TakkTile board" in report["fingertips"]


def test_inactive_hand_is_opened_only_with_activate(lab: Lab) -> None:
    release = ("release", *HARDWARE)
    for how in (CONFIRMED, ("--dry-run",)):
        result = lab.grasp(*release, *how)
        assert result.code == 4
        assert "the hand is not active: nothing was moved" in result.err
    assert f"--config {lab.file} --activate`" in lab.grasp(*release, *CONFIRMED).err
    assert not lab.hand.active
    lab.run_confirmed(*release, "--activate")
    lab.ask("fault", name="gripper_fault", code=0x0E)
    assert "the hand is not active (" in lab.grasp(*release, *CONFIRMED).err
    lab.run_confirmed(*release, "--activate")
    lab.run_confirmed(*release)
