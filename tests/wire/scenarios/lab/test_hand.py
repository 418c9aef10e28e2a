"""`grasp gripper` at an emulated lab: what it moves, and what stops it."""

import signal
import time

import pytest

from scenarios.rigs.device_checks import read_gripper
from tests.wire.scenarios.lab.bench import CONFIRMED, Lab
from tests.wire.scenarios.lab.terminal import started


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
    ready.done("release")
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


def test_finger_steps_there_and_back(ready: Lab) -> None:
    ready.done("release")
    assert "fingers at (6, 12, 6)" in ready.done("gripper", "step", "--finger", "B", "--mm", "5")
    assert "fingers at (6, 10, 6)" in ready.done("gripper", "step", "--finger", "B", "--open")
    refused = ready.grasp("gripper", "step", "--mm", "6", *CONFIRMED)
    assert refused.returncode == 2


def test_thumb_never_bears_what_two_fingers_press(ready: Lab) -> None:
    """B and C push the can against the open thumb, unless they stand where they feel it."""
    ready.done("release")
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
    ready.done("release")
    ready.rested("tactile", "watch", "--rest", "--out", str(known))
    ready.done("gripper", "step", "--finger", "B", "--mm", "5")
    ready.done("gripper", "step", "--finger", "C", "--config", str(known))  # not open: by its rest
    ready.done("release")


def test_closing_is_refused_where_a_run_would_be(ready: Lab) -> None:
    before = ready.places
    weak = ready.grasp("gripper", "close", *CONFIRMED, "--set", "gripper.calibration=manual")
    assert weak.returncode == 2
    assert "cannot close with less than 15 N" in weak.stderr
    deaf = ready.grasp("gripper", "close", *CONFIRMED, "--set", "usb.url=tcp://127.0.0.99:9")
    assert deaf.returncode == 3
    assert ready.places == before


def test_nothing_closes_while_the_hand_reports_a_fault(ready: Lab) -> None:
    ready.done("release")
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
    assert ready.grasp("release", "--dry-run").returncode == 0  # what is held can be let go
    assert ready.places == before
    ready.cell.ask("fault", name="gripper_fault", code=0)
    ready.done("release")


def test_closing_is_stopped_by_ctrl_c_where_it_is(ready: Lab) -> None:
    ready.done("release")
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
    ready.done("release")


def test_fingers_stand_where_the_fingertips_fall_silent(ready: Lab) -> None:
    ready.done("release")
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
    ready.done("release")


@pytest.mark.parametrize(
    ("fingers", "watched"), [(("--finger", "A"), 0), ((), 1)], ids=["A", "B and C"]
)
def test_fingers_whose_link_freezes_go_no_further_than_a_step(
    ready: Lab, fingers: tuple[str, ...], watched: int
) -> None:
    ready.done("release")
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
    ready.done("release")
    ready.cell.ask("take")
