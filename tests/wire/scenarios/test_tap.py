"""A tap on real wires: delivered by the cell's world, and by a person at the hardware rig."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from scenarios.rigs.cell_control import ControlClient
from tests.wire.scenarios.test_rigs import (
    ENVIRONMENT,
    GRASP,
    call,
    emulate,
    lab_file,
    sets,
    woken,
)

QUICK_TAP = ("tap.watch_s=1.6", "tap.wait_s=0")


def tap_sets() -> list[str]:
    return sets() + [word for assignment in QUICK_TAP for word in ("--set", assignment)]


def test_two_taps_on_the_emulated_rig_move_the_object_and_are_felt(tmp_path: Path) -> None:
    code, series = call(
        "run", "tap", "--trials", "2", "--rig", "emulated", "--runs", str(tmp_path), *tap_sets()
    )
    assert series["summary"]["total"]["struck"] == 2, (code, series)
    assert [t["direction"] for t in series["taps"]] == ["top", "side"]
    for tap in series["taps"]:
        assert tap["moved"] is True
        assert 0.002 < tap["displacement_m"] < 0.02
        assert tap["struck_s"] < tap["slip_onset_s"] < tap["slip_registered_s"]
        assert 9.0 < tap["grip_force_n"]["A"] < 11.0
        assert tap["commanded_force_n"] <= 10.0
        replayed = subprocess.run(
            [*GRASP, "replay", tap["recording"], "--check"], env=ENVIRONMENT, check=False,
            capture_output=True, text=True,
        )  # fmt: skip
        assert replayed.returncode == 0, replayed.stdout


class Person:
    """Answers the prompts of a run on the hardware rig; strikes through the cell's world."""

    def __init__(self, process: "subprocess.Popen[str]", control: dict[str, Any]) -> None:
        self.process = process
        self.prompts: list[str] = []
        self._world = ControlClient(control["host"], control["port"])

    def answer(self, moved_mm: str) -> None:
        """Until the tape mark has been read."""
        assert self.process.stderr is not None and self.process.stdin is not None
        for line in self.process.stderr:
            self.prompts.append(line)
            if "Tap the object" in line:
                self._world.ask("tap", impulse_n_s=0.25, duration_s=0.008)
            self.process.stdin.write(f"{moved_mm}\n" if "tape mark moved" in line else "\n")
            self.process.stdin.flush()
            if "tape mark moved" in line:
                return

    def close(self) -> None:
        self._world.close()


@pytest.mark.parametrize(
    ("typed", "moved"), [("6.5", True), pytest.param("0", False, marks=pytest.mark.slow)]
)
def test_person_at_the_hardware_rig_strikes_measures_and_types(
    tmp_path: Path, typed: str, moved: bool
) -> None:
    with emulate() as endpoints:
        lab = woken(lab_file(tmp_path / "lab.toml", endpoints))
        with subprocess.Popen(
            [
                *GRASP, "run", "tap", "--rig", "hardware", "--confirm-motion", "--config", str(lab),
                "--trials", "1", "--runs", str(tmp_path / "runs"), "--json", *tap_sets(),
            ],
            env=ENVIRONMENT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:  # fmt: skip
            person = Person(process, endpoints["control"])
            person.answer(typed)
            out, _ = process.communicate(timeout=60)
            person.close()
    series = json.loads(out)
    assert "taps" in series, series
    tap = series["taps"][0]
    assert tap["moved"] is moved
    assert tap["displacement_m"] == pytest.approx(float(typed) * 1e-3)
    assert tap["impulse_n_s"] is None and tap["down_m"] is None
    assert tap["outcome"] == ("registered" if moved else "unmoved_registered")
    assert process.returncode == (0 if moved else 1)
    assert len([line for line in person.prompts if line.startswith(">>>")]) == 3


def test_terminal_that_closes_ends_the_run_with_the_grip_kept(tmp_path: Path) -> None:
    with emulate() as endpoints:
        lab = woken(lab_file(tmp_path / "lab.toml", endpoints))
        with subprocess.Popen(
            [
                *GRASP, "run", "tap", "--rig", "hardware", "--confirm-motion", "--config", str(lab),
                "--trials", "1", "--runs", str(tmp_path / "runs"), *tap_sets(),
            ],
            env=ENVIRONMENT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:  # fmt: skip
            assert process.stderr is not None and process.stdin is not None
            said: list[str] = []
            for line in process.stderr:
                said.append(line)
                process.stdin.write("\n")
                process.stdin.flush()
                if "Tap the object" in line:
                    break
            _, rest = process.communicate(timeout=60)  # closes its input
    err = "".join(said) + rest
    assert process.returncode == 130, err
    assert "standard input has ended" in rest
    assert "Traceback" not in err
    (result,) = [json.loads(p.read_text()) for p in (tmp_path / "runs").glob("*/result.json")]
    assert result["outcome"] == "interrupted"
    assert "closed" in result["end"]["hand"]


def test_taps_that_nobody_could_answer_are_refused_before_anything_moves(tmp_path: Path) -> None:
    with emulate() as endpoints:
        lab = woken(lab_file(tmp_path / "lab.toml", endpoints))
        done = subprocess.run(
            [
                *GRASP, "run", "tap", "--rig", "hardware", "--confirm-motion", "--config", str(lab),
                "--trials", "1", "--runs", str(tmp_path / "runs"), *tap_sets(),
            ],
            env=ENVIRONMENT, text=True, stdin=subprocess.DEVNULL, capture_output=True, check=False,
            timeout=100,
        )  # fmt: skip
    assert done.returncode == 2
    assert "nobody is there to be asked" in done.stderr
    assert not list((tmp_path / "runs").glob("*/recording*"))
