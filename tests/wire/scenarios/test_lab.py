"""A lab's verbs at an emulated cell: what is there, what they move, what they refuse, what stops
them. What a polled core answers in virtual time is in tests/unit."""

import json
import re
import signal
import socket
import struct
import threading
import time
import tomllib
from pathlib import Path

import pytest

from drivers.errors import DeviceFault
from drivers.robotiq.protocol import AxisCommand, CommandRegisters
from drivers.ur.link.preflight import Rtde
from grasp.clock import WallClock
from scenarios.campaign.config import load_config
from scenarios.rigs.permission import driving, gripper_of
from scenarios.rigs.wired import open_arm
from tests.wire.lab import CONFIRMED, HARDWARE, PATIENCE_S, Done, Lab, grasp, sets, until

NOWHERE = ("--set", "usb.url=tcp://127.0.0.99:9")
SCISSOR = 3
CALIBRATIONS = (("hand", "--up-to", "16"), ("noise",))


def checks(done: Done) -> dict[str, dict[str, str]]:
    return {check["name"]: check for check in json.loads(done.out)["checks"]}


def test_devices_that_answer_are_found_with_what_to_write_down(lab: Lab) -> None:
    gripper, url = lab.endpoints["gripper"], lab.endpoints["tactile"]["url"]
    done = grasp("doctor", lab.config.ur.host, f"{gripper['host']}:{gripper['port']}", url)
    assert done.code == 0, done.err
    assert "not activated, no fault" in done.out and "robot mode 7: running" in done.out
    for line in (f"port = {gripper['port']}", f'url = "{url}"', f'host = "{lab.config.ur.host}"'):
        assert line in done.out
    assert grasp("doctor", "127.0.0.1/24").code == 2


def test_doctor_hears_every_device_and_fails_where_a_run_would(lab: Lab) -> None:
    doctor = ("doctor", *HARDWARE, "--json")
    asleep = lab.grasp(*doctor)
    found = checks(asleep)
    assert asleep.code == 3
    assert [name for name, check in found.items() if check["status"] == "fail"] == ["gripper"]
    assert "`grasp gripper activate`" in found["gripper"]["remedy"]
    assert "18 taxels, rest 4" in found["fingertips"]["detail"]
    lab.wake()
    assert lab.grasp(*doctor).code == 0
    for words, check, told in (
        (("--set", "gripper.calibration=manual"), "force guard", "cannot close with less than 15"),
        (("--set", "tactile.rest_min_counts=460"), "fingertips", "outside 460..512"),
    ):
        failed = lab.grasp(*doctor, *words)
        assert failed.code == 3
        assert checks(failed)[check]["status"] == "fail"
        assert told in checks(failed)[check]["detail"]


def test_rest_is_a_file_that_settings_read_and_none_is_overwritten(
    lab: Lab, tmp_path: Path
) -> None:
    out = tmp_path / "rest.toml"
    words = ("tactile", "watch", "--rest", "--seconds", "1", "--out", str(out))
    done = lab.grasp(*words)
    assert done.code == 0, done.err
    codes = tomllib.loads(out.read_text())["tactile"]["rest_reference"]
    config = load_config("can", "hardware", "energy", [lab.file, out])
    assert config.tactile.rest_reference == tuple(map(tuple, codes))
    again = lab.grasp(*words)
    assert again.code == 2 and "is there already" in again.err


def test_taxels_are_watched(lab: Lab) -> None:
    told = json.loads(lab.grasp("tactile", "watch", "--seconds", "1", "--json").out)
    assert all(400 < rest < 512 for finger in told["rest"] for rest in finger)
    assert all(abs(counts) < 2.0 for finger in told["counts"] for counts in finger)
    nobody = lab.grasp("tactile", "watch", *NOWHERE)
    assert nobody.code == 3
    assert "no TakkTile board (59e3:74c7) at tcp://127.0.0.99:9" in nobody.err


def test_arm_steps_by_what_was_asked_and_needs_no_address_of_a_gripper(lab: Lab) -> None:
    before_m = lab.height_m
    assert "after x +0, y +0, z +3 mm" in lab.done("arm", "step", "--z", "3")
    assert lab.height_m - before_m == pytest.approx(0.003, abs=0.0003)
    host = f"ur.host={lab.config.ur.host}"
    alone = sets((host, "ur.watchdog_hz=1", "ur.heartbeat_timeout_s=2", "arm.stale_after_s=1"))
    back = grasp("arm", "step", "--z", "-3", *HARDWARE, *alone, *CONFIRMED)
    assert back.code == 0, back
    assert "safety mode 1: normal" in lab.grasp("status", "arm").out


def test_arm_on_which_a_program_runs_is_not_moved_and_the_program_can_be_ended(lab: Lab) -> None:
    with socket.create_connection((lab.config.ur.host, 30003), PATIENCE_S) as peer:
        peer.sendall(b"def theirs():\n while True:\n  sleep(0.1)\n end\nend\n")
    until(lambda: "program: runs" in lab.grasp("status", "arm").out)
    soon = sets(("ur.step_timeout_s=0.5",))  # that a program may still end by itself
    told = lab.grasp("doctor", *HARDWARE, *soon)
    assert told.code == 3
    assert re.search("^FAIL +arm program .*already", told.out, re.MULTILINE)
    for words in (("arm", "step", "--z", "1"), ("run", "lift", *HARDWARE)):
        refused = lab.grasp(*words, *CONFIRMED, *soon)
        assert refused.code == 3, refused
        assert "a program runs on the arm already" in refused.err
    assert "would end any program" in lab.grasp("arm", "stop", "--dry-run").out
    assert "no program runs on it" in lab.grasp("arm", "stop").out


def test_arm_whose_speed_slider_is_low_is_refused(lab: Lab) -> None:
    lab.ask("fault", name="speed_slider", fraction=0.05)
    for words in (("arm", "step", "--z", "1"), ("run", "lift", *HARDWARE)):
        refused = lab.grasp(*words, *CONFIRMED)
        assert refused.code == 3, refused
        assert "speed slider at 5 %" in refused.err
    with Rtde(lab.config.ur.host, 10.0) as rtde:  # as a pendant's client sets it
        rtde.ask(b"V", struct.pack(">H", 2))
        (recipe,) = rtde.ask(b"I", b"speed_slider_mask,speed_slider_fraction")[:1]
        rtde.ask(b"S", b"")
        rtde.tell(b"U", struct.pack(">BId", recipe, 1, 0.6))
        until(lambda: "speed slider: 60 %" in lab.grasp("status", "arm").out)


def test_arm_that_somebody_drives_is_stopped_without_asking_them(lab: Lab) -> None:
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


def test_hand_is_activated_only_by_whoever_says_that_it_is_empty(lab: Lab) -> None:
    asked = lab.grasp("gripper", "activate", *CONFIRMED)
    assert asked.code == 2 and "opens and closes the hand fully" in asked.err
    assert not lab.hand.active
    assert "active, fingers at (6, 6, 6)" in lab.done("gripper", "activate", "--empty")
    assert "already" in lab.done("gripper", "activate", "--empty")
    told = lab.grasp("status", "gripper").out
    assert all(name in told for name in ("gACT 1", "gIMC 3: ready", "finger C: at 6"))


def test_no_run_activates_a_hand(lab: Lab, tmp_path: Path) -> None:
    """Activation is a full open and close at a force that nobody sets."""
    before, told = lab.places, "`grasp gripper activate`"
    for words in (("lift",), ("lift", "--first"), ("tap",)):
        dry = lab.grasp("run", *words, *HARDWARE, "--dry-run")
        assert dry.code == 4, dry
        assert told in dry.err and dry.out.endswith("would not start\n")
    words = ("run", "lift", *HARDWARE, *CONFIRMED, "--runs", str(tmp_path))
    for more in ((), ("--trials", "2")):
        done = lab.grasp(*words, *more, answer=lambda question: "")
        assert done.code == 4, done
        assert f"the hand is not active: nothing was moved (empty it, then {told})" in done.err
    assert lab.places == before and not lab.hand.active


def test_nothing_moves_unconfirmed_or_dry(ready: Lab, tmp_path: Path) -> None:
    before, out = ready.places, ("--out", str(tmp_path / "none.toml"))
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
    assert ready.places == before
    assert ready.ask("motion") == {"arm_mps": 0.0, "fingers_mps": 0.0}


def test_nothing_moves_where_nobody_can_answer(ready: Lab, tmp_path: Path) -> None:
    before, out = ready.places, ("--out", str(tmp_path / "none.toml"))
    for words in (
        ("run", "tap", *HARDWARE, "--runs", str(tmp_path)),
        ("run", "lift", "--first", *HARDWARE, "--runs", str(tmp_path)),
        *(
            ("calibrate", *w, *out, *(() if w == ("noise",) else ("--scale",)))
            for w in CALIBRATIONS
        ),
    ):
        nobody = ready.grasp(*words, *CONFIRMED)
        assert nobody.code == 2, (words, nobody)
        assert "nobody is there to be asked: standard input has ended" in nobody.err
    assert ready.places == before


def test_motion_is_refused_while_another_program_drives_the_device(ready: Lab) -> None:
    with driving(gripper_of(ready.config)):
        for words in (("gripper", "close"), ("run", "lift", *HARDWARE), ("release", *HARDWARE)):
            driven = ready.grasp(*words, *CONFIRMED)
            assert driven.code == 4, (words, driven)
            assert "is driven by process" in driven.err and "`kill " in driven.err


def test_finger_steps_there_and_back(ready: Lab) -> None:
    stepped = ready.grasp("gripper", "step", "--finger", "B", "--mm", "5", *CONFIRMED)
    assert "fingers at (6, 12, 6)" in stepped.out
    assert "will move fingers from (6, 6, 6) to (6, 12, 6) counts at 22 mm/s" in stepped.err
    assert "fingers at (6, 10, 6)" in ready.done("gripper", "step", "--finger", "B", "--open")
    assert ready.grasp("gripper", "step", "--mm", "6", *CONFIRMED).code == 2


def test_thumb_never_bears_what_two_fingers_press(ready: Lab) -> None:
    """B and C push the can against the open thumb, unless they stand where they feel it."""
    ready.ask("place")
    closed = ready.done("gripper", "close")
    truth = ready.ask("truth")["truth"]
    assert "finger A met something" in closed
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


def test_closing_is_refused_where_a_run_would_be(ready: Lab) -> None:
    before = ready.places
    weak = ready.grasp("gripper", "close", *CONFIRMED, "--set", "gripper.calibration=manual")
    assert weak.code == 2 and "cannot close with less than 15 N" in weak.err
    assert ready.grasp("gripper", "close", *CONFIRMED, *NOWHERE).code == 3
    assert ready.grasp("release", *CONFIRMED, *NOWHERE).code == 0  # which reads no fingertips
    ready.ask("fault", name="gripper_fault", code=5)
    refused = ready.grasp("gripper", "close", *CONFIRMED)
    assert refused.code == 3 and "the gripper reports a fault, action delayed" in refused.err
    assert ready.grasp("release", "--dry-run").code == 0  # what is held can be let go
    assert ready.places == before


@pytest.mark.parametrize("trouble", ["Ctrl-C", "fingertips unplugged"])
def test_closing_stops_where_it_is(trouble: str, ready: Lab) -> None:
    with ready.started("gripper", "close", "--finger", "A", *CONFIRMED) as run:
        until(lambda: ready.places[0] >= 30, "the finger is on its way")
        if trouble == "Ctrl-C":
            run.send_signal(signal.SIGINT)
        else:
            ready.ask("fault", name="unplug")
        _, said = run.communicate(timeout=PATIENCE_S)
    assert run.returncode in ((130,) if trouble == "Ctrl-C" else (3, 4)), said
    assert "the fingers stand, at (" in said
    assert ready.ask("motion")["fingers_mps"] == 0.0
    assert 30 <= ready.places[0] < 200


def test_hand_in_scissor_mode_closes_nothing_and_is_let_go(ready: Lab) -> None:
    """Somebody else has put it there, around something for all that anybody knows."""
    at, near = AxisCommand(60, 255, 0), AxisCommand(200, 255, 0)
    ready.write(CommandRegisters(activate=True, mode=SCISSOR))
    until(lambda: ready.hand.ready and ready.hand.mode == SCISSOR)
    ready.write(
        CommandRegisters(
            activate=True, mode=SCISSOR, go_to=True, individual_fingers=True,
            individual_scissor=True, a=at, b=at, c=at, scissor=near,
        )
    )  # fmt: skip
    until(lambda: (ready.places, ready.hand.scissor.position) == ((60, 60, 60), 200))
    told = "the hand is in scissor mode, in which it may only be opened"
    for words in (
        ("run", "lift", *HARDWARE), ("gripper", "close"), ("gripper", "step", "--finger", "A"),
    ):  # fmt: skip
        for how in (CONFIRMED, ("--dry-run",)):
            refused = ready.grasp(*words, *how)
            assert refused.code == 4, (words, refused)
            assert told in refused.err
    kept = ready.grasp("gripper", "activate", "--empty", *CONFIRMED)
    assert kept.code == 4 and "would drop the object" in kept.err
    assert (ready.hand.mode, ready.places) == (SCISSOR, (60, 60, 60))
    ready.done("release", *HARDWARE)
    now = ready.hand
    assert (now.mode, now.scissor.position) == (SCISSOR, 0), "its mode is not changed by that"
    assert max(ready.places) < 10
    assert "active, fingers at (6, 6, 6)" in ready.done("gripper", "activate", "--empty")
    assert (ready.hand.mode, ready.hand.scissor.position) == (0, 137)


def closed(lab: Lab) -> None:
    """As a run leaves the hand that ended in a fault."""
    at = AxisCommand(120, 255, 0)
    lab.write(
        CommandRegisters(activate=True, go_to=True, individual_fingers=True, a=at, b=at, c=at)
    )
    until(lambda: lab.places == (120, 120, 120))


def test_hand_opens_whatever_arm_and_fingertips_do(ready: Lab) -> None:
    closed(ready)
    ready.ask("fault", name="unplug")
    done = ready.grasp("release", *HARDWARE, *CONFIRMED, "--json", "--set", "ur.host=127.0.0.99")
    assert done.code == 0, done
    told = json.loads(done.out)
    assert max(told["positions_counts"]) < 10
    assert "Connection refused" in told["arm"]
    assert "no TakkTile board" in told["fingertips"]


def test_hand_that_is_not_active_is_opened_only_when_told_to_activate_it(lab: Lab) -> None:
    release = ("release", *HARDWARE)
    for how in (CONFIRMED, ("--dry-run",)):
        done = lab.grasp(*release, *how)
        assert done.code == 4
        assert "the hand is not active: nothing was moved" in done.err
    assert f"--config {lab.file} --activate`" in lab.grasp(*release, *CONFIRMED).err
    assert not lab.hand.active
    lab.done(*release, "--activate")
    lab.ask("fault", name="gripper_fault", code=0x0E)
    assert "the hand is not active (" in lab.grasp(*release, *CONFIRMED).err
    lab.done(*release, "--activate")
    lab.done(*release)
