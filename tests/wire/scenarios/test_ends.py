"""How runs end on real wires: by signals, and by devices that go or freeze."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from scenarios.rigs import emulated_cell
from scenarios.rigs.emulated_cell import CellOrder
from scenarios.trial.run_folder import open_trial
from tests.unit.scenarios.conftest import config
from tests.wire.scenarios.test_rigs import ENVIRONMENT, GRASP, emulate, lab_file, sets, woken

Ended = tuple[int, list[str], list[dict[str, Any]]]


@contextmanager
def lift_on_hardware(folder: Path, pid: list[int]) -> Iterator["subprocess.Popen[str]"]:
    with emulate() as endpoints:
        pid.append(endpoints["pid"])
        lab = woken(lab_file(folder / "lab.toml", endpoints))
        with subprocess.Popen(
            [*GRASP, "run", "lift", "--rig", "hardware", "--confirm-motion", "--config", str(lab),
             "--runs", str(folder / "runs"), *sets()],
            env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            stdin=subprocess.DEVNULL,
        ) as process:  # fmt: skip
            try:
                yield process
            finally:
                process.kill()
                os.kill(endpoints["pid"], signal.SIGCONT)


def until(process: "subprocess.Popen[str]", phase: str) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if phase in line.split():
            return


def ended(process: "subprocess.Popen[str]", folder: Path) -> Ended:
    _, err = process.communicate(timeout=60)
    results = [json.loads(p.read_text()) for p in (folder / "runs").glob("*/result.json")]
    claim, *lines = err.splitlines()
    assert "less than the manual's 15 N" in claim  # of the calibration, before anything moves
    plan = [line for line in lines if line.startswith("grasp: will ")]
    assert lines[: len(plan)] == plan and len(plan) == 3, err
    return process.returncode, lines[len(plan) :], results


@pytest.mark.parametrize(
    ("phase", "numbers"),
    [("lift", (signal.SIGTERM, signal.SIGHUP)), ("release", (signal.SIGHUP,)),
     ("hold", (signal.SIGINT, signal.SIGINT))],
)  # fmt: skip
def test_signal_stops_the_arm_keeps_the_grip_and_says_so(
    phase: str, numbers: tuple[signal.Signals, ...], tmp_path: Path
) -> None:
    with lift_on_hardware(tmp_path, []) as process:
        until(process, phase)
        for number in numbers:
            process.send_signal(number)
        code, lines, (result,) = ended(process, tmp_path)
    # of two at once the system gives the lower number first
    assert code - 128 in numbers, (lines, result)
    assert (result["outcome"], result["success"]) == ("interrupted", None)
    assert result["phases"][-1]["phase"] == "stopped"
    assert result["end"]["arm"] == "the arm stands"
    where = f"in phase {result['phases'][-2]['phase']}, "
    assert lines[1].strip().startswith(where)
    assert lines[1].endswith(f" mm above the grasp: the arm stands; {result['end']['hand']}")
    assert "grasp release --rig hardware" in lines[2] or result["end"]["hand"].endswith("open")
    listed = subprocess.run(
        [*GRASP, "runs", "--runs", str(tmp_path / "runs")], env=ENVIRONMENT, check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    assert "interrupted" in listed.stdout


def test_signal_while_the_rig_opens_leaves_no_run(tmp_path: Path) -> None:
    with lift_on_hardware(tmp_path, []) as process:
        until(process, "setting")
        process.send_signal(signal.SIGTERM)
        code, lines, results = ended(process, tmp_path)
    assert code == 143
    assert results == []
    assert len(lines) == 1


@pytest.mark.parametrize("ordered", [False, True])
def test_cell_that_nobody_waits_for_any_more_ends_without_a_word(ordered: bool) -> None:
    order = msgspec.json.encode(CellOrder.of(config(), 0)) + b"\n"
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", emulated_cell.__name__],
        env=ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert child.stdin is not None and child.stdout is not None and child.stderr is not None
    child.stdout.close()
    child.stdin.write(order if ordered else b"")
    child.stdin.close()
    with child.stderr as said:
        assert said.read() == b""
    assert child.wait() == 0


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_devices_that_freeze_or_go_are_all_named_and_cost_no_result(
    number: signal.Signals, tmp_path: Path
) -> None:
    pid: list[int] = []
    try:
        with lift_on_hardware(tmp_path, pid) as process:
            until(process, "lift")
            os.kill(pid[0], number)
            code, lines, (result,) = ended(process, tmp_path)
            if number == signal.SIGKILL:
                raise ProcessLookupError
    except ProcessLookupError:  # nobody is left to be told to end
        pass
    assert code in (3, 4)
    assert result["outcome"] == "fault"
    assert "gripper" in lines[0] and "arm" in lines[0]
    assert "tactile" in lines[0] or "fingertip" in lines[0]
    assert "when last heard" in result["end"]["arm"]
    assert "cannot be told anything and holds by itself" in result["end"]["hand"]
    assert "grasp release --rig hardware" in result["end"]["advice"]


# hangs 0.3 s into the lift: it is reset when it is made, once it grips and once the pads relaxed
HANGS = """
import ctypes, time
import numpy as np

class Hangs:
    def __init__(self, fingers):
        self.fingers, self.resets, self.frames = fingers, 0, 0

    def reset(self):
        self.resets, self.frames = self.resets + 1, 0

    def update(self, counts):
        self.frames += 1
        if self.resets == 4 and self.frames > 50:
            self.HANG()
        return np.zeros(self.fingers)

    def sleep(self):
        time.sleep(3600)

    def native(self):
        libc, mutex = ctypes.CDLL(None), ctypes.create_string_buffer(64)
        libc.pthread_mutex_lock(mutex)
        libc.pthread_mutex_lock(mutex)  # for ever: no signal ends it
"""


@pytest.mark.parametrize(("hang", "results"), [("sleep", 1), ("native", 0)])
def test_detector_that_never_returns_costs_no_grip_and_one_signal_ends_the_run(
    hang: str, results: int, tmp_path: Path
) -> None:
    detector = tmp_path / "hangs.py"
    detector.write_text(HANGS.replace("HANG()", f"{hang}()"))
    with subprocess.Popen(
        [*GRASP, "run", "lift", "--rig", "emulated", "--detector", f"{detector}:Hangs",
         "--runs", str(tmp_path / "runs"), *sets()],
        env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        stdin=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        give_up = threading.Timer(180.0, process.kill)
        give_up.start()
        try:
            assert process.stderr is not None
            line = next((text for text in process.stderr if "no control step" in text), "")
            process.send_signal(signal.SIGTERM)
            left = process.stderr.read().splitlines()
            process.wait(60)
        finally:
            give_up.cancel()
            process.kill()
    assert line.startswith("grasp: no control step for 1 s; the gripper acts by itself: close A ")
    assert line.endswith(", at most 10 N\n")
    assert process.returncode == 5, left
    assert left[0].startswith("grasp: internal_error: Interruption: told to end (SIGTERM)")
    assert str(detector) in left[0]
    assert "in phase lift" in left[1] and "the arm stands" in left[1]
    assert "the hand is closed to the limit of 10 N" in left[1]
    (folder,) = (tmp_path / "runs").iterdir()
    assert open_trial(folder).complete
    assert len(list(folder.glob("result.json"))) == results
