"""Lifts on real protocols: the emulated rig, and the hardware rig with an emulated cell."""

import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs.emulated import cell_process
from scenarios.trial.run_folder import open_trial
from tests.unit.scenarios.conftest import by_default
from tests.ur_rtde import needs_ur_rtde
from tests.wire.lab import (
    ALONE,
    CONFIRMED,
    ENVIRONMENT,
    GRASP,
    HARDWARE,
    QUICK,
    Lab,
    grasp,
    sets,
    started,
)
from tests.wire.waiting import PATIENCE_S, until

TRUTH_FIELDS = ("slip_onset_s", "slip_distance_m", "peak_force_n", "settled_force_n")
LOWERING_STEPS = {"lower.feel"}  # their number depends on noise


def hardware_lift(folder: Path) -> tuple[str, ...]:
    return ("run", "lift", *HARDWARE, *CONFIRMED, *ALONE, "--runs", str(folder / "runs"), *sets())


def wait_for_phase(process: "subprocess.Popen[str]", phase: str) -> None:
    """Read until a phase has begun."""
    assert process.stdout is not None
    assert any(phase in line.split() for line in process.stdout), f"no phase {phase}"


@needs_ur_rtde
def test_lift_on_the_emulated_rig_equals_that_on_the_simulated_rig(tmp_path: Path) -> None:
    """By touch, a delay of some milliseconds can change the number of counts."""
    quick = ("controller.first_grasp=counts", *QUICK)
    done = grasp(
        "run", "lift", "--rig", "emulated", "--runs", str(tmp_path), "--json", *sets(quick)
    )
    wired, simulated = json.loads(done.out), lift.run(by_default(*quick), 0, None).result
    assert simulated is not None
    assert done.code == 0, wired
    assert wired["outcome"] == simulated.outcome
    expected = [
        p for p in dict.fromkeys(p.phase for p in simulated.phases) if p not in LOWERING_STEPS
    ]
    found = dict.fromkeys(p["phase"] for p in wired["phases"])
    assert [p for p in found if p not in LOWERING_STEPS] == expected
    assert simulated.slip_distance_m is not None and simulated.reaction_latency_ms is not None
    # 0.1 mm for each millisecond of difference in reaction latency, plus 2 mm
    later_ms = abs(wired["reaction_latency_ms"] - simulated.reaction_latency_ms)
    assert abs(wired["slip_distance_m"] - simulated.slip_distance_m) < 0.002 + 1e-4 * later_ms
    assert wired["commanded_force_n"] <= 10.0
    assert grasp("replay", wired["recording"], "--check").code == 0


@needs_ur_rtde
def test_hardware_rig_with_a_cell_gives_the_outcome_without_ground_truth(
    ready: Lab, tmp_path: Path
) -> None:
    ready.ask("place")
    done = ready.grasp(*hardware_lift(tmp_path), "--json")
    result = json.loads(done.out)
    error, timing = result.get("error", {}), result.get("result", result)["timing"]
    if (
        "program on the arm controller has ended" in error.get("message", "")
        and (timing["missed_periods"])
    ):
        pytest.skip("this machine stalled for longer than the arm's watchdog allows")
    assert done.code == 0, result
    assert (result["success"], result["outcome"]) == (True, "held")
    assert all(result[name] is None for name in TRUTH_FIELDS)
    assert 5.0 < result["peak_estimated_n"]["A"] < 13.0  # only an estimate is available


@needs_ur_rtde
def test_signal_stops_the_arm_keeps_the_grip_and_is_reported(ready: Lab, tmp_path: Path) -> None:
    ready.ask("place")
    with ready.started(*hardware_lift(tmp_path)) as process:
        wait_for_phase(process, "lift")
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + signal.SIGTERM, err
    (path,) = (tmp_path / "runs").glob("*/result.json")
    result = json.loads(path.read_text())
    assert (result["outcome"], result["success"]) == ("interrupted", None)
    assert result["phases"][-1]["phase"] == "stopped"
    assert result["end"]["arm"] == "the arm is stationary"
    assert "grasp release --rig hardware" in err
    assert ready.ask("motion")["arm_mps"] == 0.0
    assert max(ready.positions) > 20  # it was not opened


@needs_ur_rtde
@pytest.mark.parametrize(
    ("fault", "phase"), [("unplug", "grasp.brace"), ("arm_disconnect", "lift")]
)
def test_fault_of_a_device_ends_in_the_safe_state(
    fault: str, phase: str, ready: Lab, tmp_path: Path
) -> None:
    """All faults in all phases: tests/nightly, and in virtual time tests/unit/scenarios/lift."""
    ready.ask("place")
    with ready.started(*hardware_lift(tmp_path)) as process:
        wait_for_phase(process, phase)
        ready.ask("fault", name=fault)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode in (3, 4), err
    (path,) = (tmp_path / "runs").glob("*/result.json")
    result = json.loads(path.read_text())
    assert (result["outcome"], result["phases"][-1]["phase"]) == ("fault", "fault")
    assert ("tactile" if fault == "unplug" else "arm") in result["phases"][-1]["cause"]
    until(lambda: ready.ask("motion") == {"arm_mps": 0.0, "fingers_mps": 0.0})
    truth = ready.ask("truth")["truth"]
    assert (truth["normal_n"][0] > 5.0) == (phase == "lift")  # the first grasp has 2 to 3 N
    assert max(truth["peak_n"]) < 11.5


# hangs 0.5 s after the start of the lift, which begins with the fourth reset
HANGING_DETECTOR = """
import time
import numpy as np

class Hangs:
    def __init__(self, fingers):
        self.fingers, self.resets, self.frames = fingers, 0, 0

    def reset(self):
        self.resets, self.frames = self.resets + 1, 0

    def update(self, counts):
        self.frames += 1
        if self.resets == 4 and self.frames > 50:
            time.sleep(3600)
        return np.zeros(self.fingers)
"""


@needs_ur_rtde
def test_grip_is_kept_with_a_hanging_detector_and_one_signal_ends_the_run(
    tmp_path: Path,
) -> None:
    detector = tmp_path / "hangs.py"
    detector.write_text(HANGING_DETECTOR)
    with started(
        "run", "lift", "--rig", "emulated", "--detector", f"{detector}:Hangs", "--runs",
        str(tmp_path / "runs"), *sets(), stdout=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        line = next((text for text in process.stderr if "no control step" in text), "")
        process.send_signal(signal.SIGTERM)
        _, rest = process.communicate(timeout=PATIENCE_S)
    assert line.startswith("grasp: no control step for 1 s; the gripper acts by itself: close A ")
    assert line.endswith(", at most 10 N\n")
    assert process.returncode == 5, rest
    assert "terminated (SIGTERM)" in rest and str(detector) in rest
    assert "the arm is stationary" in rest and "the hand is closed to" in rest
    (folder,) = (tmp_path / "runs").iterdir()
    assert open_trial(folder).complete


@needs_ur_rtde
def test_unreachable_devices_are_a_device_error_with_a_remedy(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(
        '[gripper]\ncalibration = "paper"\n[calibration]\npressed_bytes = [0]\npresses = 10\n'
        "[guard]\ncounts_per_newton = [160, 160, 160]\n"
        '[modbus]\nhost = "127.0.0.99"\nport = 9\n'
        '[usb]\nurl = "tcp://127.0.0.99:9"\n[ur]\nhost = "127.0.0.99"\n'
    )
    runs = tmp_path / "runs"
    words = ("run", "lift", *HARDWARE, *ALONE, "--config", str(lab), "--runs", str(runs), "--json")
    assert grasp(*words).code == 2  # without a confirmation
    done = grasp(*words, *CONFIRMED)
    error = json.loads(done.out)["error"]
    assert (done.code, error["kind"]) == (3, "link_lost") and error["remedy"]
    assert list(runs.iterdir()) == []  # the folder is writable and empty
    doctor = json.loads(grasp("doctor", *HARDWARE, "--config", str(lab), "--json").out)
    failed = {c["name"]: c["remedy"] for c in doctor["checks"] if c["status"] == "fail"}
    assert {"gripper", "arm rtde port", "fingertips"} <= set(failed) and all(failed.values())


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_cell_ends_when_its_parent_is_killed() -> None:
    script = (
        "from scenarios.campaign.config import load_config\n"
        "from scenarios.rigs.emulated import CellProcess\n"
        "import time\n"
        "cell = CellProcess(load_config('can', 'emulated', 'energy'), 0)\n"
        "print(cell.endpoints['pid'], flush=True)\n"
        "time.sleep(3600)\n"
    )
    with subprocess.Popen(
        [*GRASP[:2], script], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert alive(pid)
        os.kill(parent.pid, signal.SIGKILL)
    until(lambda: not alive(pid), "the cell has ended")


def test_control_channel_loads_another_scene_and_taps_its_object() -> None:
    first = load_config("can", "emulated", "energy", None, QUICK)
    ball = load_config("ball", "emulated", "energy", None, QUICK)
    with cell_process(first, 0) as cell:
        assert not cell.truth().touched
        cell.load(ball, 3)
        assert cell.control.ask("truth")["placed"] is False
        cell.control.ask("tap", impulse_n_s=0.1, duration_s=0.008)
        invalid: tuple[tuple[str, dict[str, Any], str], ...] = (
            ("dance", {}, "load, place, take, tap, press, lay, home, truth, motion, fault"),
            ("tap", {}, "impulse_n_s"),
            ("press", {"finger": "D", "taxel": 0}, "finger"),
            ("press", {"finger": "A", "taxel": 6}, "taxel"),
            ("fault", {"name": "gripper_dorp"}, "gripper_drop"),
        )
        for verb, arguments, error in invalid:
            with pytest.raises(ValueError, match=error):
                cell.control.ask(verb, **arguments)
        assert cell.truth().height_m == 0.0
