"""A hand that somebody else has put into another mode: what is said of it, and how it is let go."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from drivers.robotiq.link.modbus import ModbusTransport
from drivers.robotiq.protocol import AxisCommand, CommandRegisters, StatusRegisters
from scenarios.rigs.device_checks import read_gripper
from tests.wire.scenarios.lab.bench import CONFIRMED, Lab

PINCH, SCISSOR = 1, 3
HARDWARE = ("--rig", "hardware")
CLOSED = [60, 60, 60, 200]  # A, B, C and the scissor
TOLD = "the hand is in scissor mode, in which it is only opened"
REMEDY = "`grasp gripper activate`, with an empty hand, sets basic mode"
CLOSING = (
    ("gripper", "close"),
    ("gripper", "step", "--finger", "A"),
    ("calibrate", "hand", "--up-to", "16", "--out", "none.toml", "--scale"),
)


def seen(lab: Lab) -> StatusRegisters:
    return read_gripper(lab.config)[1]


def places(now: StatusRegisters) -> list[int]:
    return [axis.position for axis in (*now.fingers, now.scissor)]


def until(lab: Lab, is_so: Callable[[StatusRegisters], bool]) -> None:
    deadline = time.monotonic() + 60
    while not is_so(seen(lab)):
        assert time.monotonic() < deadline, seen(lab)
        time.sleep(0.05)


def by_another(lab: Lab, **said: Any) -> None:
    """What another program writes to the hand."""
    link = ModbusTransport(lab.config.modbus, lab.config.gripper.link)
    try:
        command = CommandRegisters(activate=True, **said)
        link.write(0, command.to_registers(), time.monotonic_ns())
    finally:
        link.close()


def left_in(lab: Lab, mode: int) -> None:
    """Open and ready, nothing on the table."""
    lab.cell.ask("take")
    lab.done("release")
    by_another(lab, mode=mode)
    until(lab, lambda now: now.ready and now.mode == mode)


def left_closed_in_scissor_mode(lab: Lab) -> None:
    """B and C near each other, all fingers closed: around something, for all that anybody knows."""
    left_in(lab, SCISSOR)
    at, near = (AxisCommand(counts, 255, 0) for counts in CLOSED[2:])
    by_another(lab, mode=SCISSOR, go_to=True, individual_fingers=True, individual_scissor=True,
               a=at, b=at, c=at, scissor=near)  # fmt: skip
    until(lab, lambda now: places(now) == CLOSED)


@pytest.fixture
def scissor(ready: Lab) -> Iterator[Lab]:
    left_closed_in_scissor_mode(ready)
    yield ready
    ready.done("release")
    ready.done("gripper", "activate", "--empty")


def as_it_was(lab: Lab) -> bool:
    now = seen(lab)
    return (now.mode, places(now)) == (SCISSOR, CLOSED)


def test_scissor_mode_is_refused_by_doctor_dry_runs_and_verbs_alike(scissor: Lab) -> None:
    doctor = scissor.grasp("doctor", *HARDWARE)
    assert doctor.returncode == 3
    assert TOLD in doctor.stdout and REMEDY in doctor.stdout
    for words in (("lift",), ("lift", "--first"), ("tap",)):
        dry = scissor.grasp("run", *words, *HARDWARE, "--dry-run")
        assert dry.returncode == 4, dry.stderr
        assert TOLD in dry.stderr and dry.stdout.endswith("would not start\n")
    run = scissor.grasp("run", "lift", *HARDWARE, *CONFIRMED)
    assert run.returncode == 4
    assert TOLD in run.stderr and REMEDY in run.stderr
    for words in CLOSING:
        dry = scissor.grasp(*words, "--dry-run")
        assert dry.returncode == 4, dry.stdout
        assert TOLD in dry.stderr and REMEDY in dry.stderr
    for words in CLOSING[:2]:  # the third asks a person first
        done = scissor.grasp(*words, *CONFIRMED)
        assert done.returncode == 4, done.stdout
        assert TOLD in done.stderr
    status = scissor.grasp("gripper", "status")
    assert "the hand is in scissor mode" in status.stderr
    for how in (("--dry-run",), ("--empty", *CONFIRMED)):  # it may hold something
        kept = scissor.grasp("gripper", "activate", *how)
        assert kept.returncode == 4
        assert "would drop what the fingers hold" in kept.stderr
    assert as_it_was(scissor)


def test_hand_in_scissor_mode_is_let_go_and_its_dry_run_says_how(scissor: Lab) -> None:
    dry = scissor.grasp("release", "--dry-run")
    assert dry.returncode == 0, dry.stderr
    assert "it is in scissor mode: B and C are spread apart too" in dry.stdout
    assert as_it_was(scissor)
    done = scissor.grasp("release", *CONFIRMED)
    assert done.returncode == 0, done.stderr
    assert "the hand is in scissor mode" in done.stderr and REMEDY in done.stderr
    now = seen(scissor)
    assert (now.mode, now.scissor.position) == (SCISSOR, 0), "its mode is not changed by that"
    assert max(finger.position for finger in now.fingers) < 10
    would = scissor.grasp("gripper", "activate", "--dry-run")
    assert would.stdout == "would open all fingers and set basic mode\n"
    assert "active, fingers at (6, 6, 6)" in scissor.done("gripper", "activate", "--empty")
    now = seen(scissor)
    assert (now.ready, now.mode, now.scissor.position) == (True, 0, 137)
    assert scissor.grasp("gripper", "step", "--finger", "A", "--dry-run").returncode == 0


def test_one_finger_is_opened_in_scissor_mode(scissor: Lab) -> None:
    stepped = scissor.done("gripper", "step", "--finger", "B", "--mm", "3", "--open")
    assert "fingers at (60, 57, 60)" in stepped
    assert seen(scissor).scissor.position == 200


def test_pinch_mode_is_told_before_anything_closes_and_unset_by_activation(ready: Lab) -> None:
    left_in(ready, PINCH)
    told = "in pinch mode: positions, forces and calibrations here are of basic mode"
    doctor = ready.grasp("doctor", *HARDWARE)
    assert doctor.returncode == 0, doctor.stdout
    assert told in doctor.stdout and REMEDY in doctor.stdout
    for words in (("run", "lift", *HARDWARE), ("gripper", "step", "--finger", "A")):
        dry = ready.grasp(*words, "--dry-run")
        assert dry.returncode == 0, dry.stderr
        assert told in dry.stderr
    stepped = ready.grasp("gripper", "step", "--finger", "A", *CONFIRMED)
    assert stepped.returncode == 0, stepped.stderr
    assert told in stepped.stderr
    assert seen(ready).mode == PINCH
    ready.done("release")
    ready.done("gripper", "activate", "--empty")
    assert seen(ready).mode == 0
    assert told not in ready.grasp("doctor", *HARDWARE).stdout
