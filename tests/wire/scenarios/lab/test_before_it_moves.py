"""What is said, asked and refused at an emulated lab before anything moves."""

from pathlib import Path

import pytest

from scenarios.rigs.permission import driving, gripper_of
from tests.wire.scenarios.lab.bench import CONFIRMED, Lab
from tests.wire.scenarios.lab.person import played
from tests.wire.scenarios.lab.terminal import grasp


def test_a_run_leaves_an_inactive_hand_as_it_is_with_what_to_type(lab: Lab, tmp_path: Path) -> None:
    """Activation is a full open and close at a force that nobody sets."""
    before = lab.places
    rig = ("--rig", "hardware")
    told = "`grasp gripper activate`"
    for words in (("lift",), ("lift", "--first"), ("lift", "--trials", "3"), ("tap",)):
        dry = lab.grasp("run", *words, *rig, "--dry-run")
        assert dry.returncode == 4, dry.stderr  # as the run
        assert told in dry.stderr and dry.stdout.endswith("would not start\n")
    doctor = lab.grasp("doctor", *rig)
    assert doctor.returncode == 3
    assert told in doctor.stdout
    script = lab.grasp("run", "lift", *rig, *CONFIRMED, "--runs", str(tmp_path))
    code, _, said = played(lambda question: "", "run", "lift", "--trials", "2", *rig, *CONFIRMED,
                           "--runs", str(tmp_path), "--config", str(lab.file))  # fmt: skip
    for ended, err in ((script.returncode, script.stderr), (code, said)):
        assert ended == 4, err
        assert f"the hand is not active: nothing was moved (empty it, then {told})" in err
    assert lab.places == before
    assert lab.cell.ask("truth")["placed"] is False


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
    ("calibrate", "force", "--press", "--up-to", "15", "--out", "none.toml"),
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
    acquire = ready.grasp("run", "acquire", *hardware, "--set", "control.counts_per_newton=200")
    assert acquire.returncode == 0, acquire.stderr
    assert "would press with 5 N, by the arm, 5 mm deep at most\n" in acquire.stdout
    assert acquire.stdout.endswith("would start\n")
    unmeasured = ready.grasp("run", "acquire", *hardware)
    assert unmeasured.returncode == 2
    assert "control: counts_per_newton" in unmeasured.stderr
    weak = ready.grasp("run", "lift", *hardware, "--set", "guard.force_limit_n=9")
    assert weak.returncode == 2
    for words in (
        ("lift", *hardware, "--set", "modbus.port=9"),
        ("acquire", *hardware, "--set", "control.counts_per_newton=200", "--set",
         "usb.url=tcp://127.0.0.99:9"),
    ):  # fmt: skip
        nobody = ready.grasp("run", *words)
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
        ("calibrate", "force", "--press", "--up-to", "15", "--scale", *out),
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
