"""Dry runs of device commands in JSON: one object, no question, nothing written."""

import json
from pathlib import Path

import pytest

from drivers.checks import Check
from drivers.errors import Refused, UsageError
from grasp.cli.main import main
from grasp.cli.plans import dry_code, press_plan
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.press import motion
from tests.calibrations import PRESSED

PRESSES = "--set " + " --set ".join(PRESSED)


def test_dry_run_without_an_address_is_refused_like_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = tmp_path / "new.toml"
    for words, missing in (
        ("calibrate hand --up-to 16 --out NEW", "modbus: host"),
        ("calibrate force --out NEW", "usb: serial"),
        (f"calibrate noise --out NEW --set gripper.calibration=paper {PRESSES}", "modbus: host"),
        ("gripper activate --set gripper.calibration=paper", "modbus: host"),
        ("release --set gripper.calibration=paper", "modbus: host"),
        ("arm step --z 3", "ur: host"),
        ("arm stop", "ur: host"),
    ):
        assert main([*words.replace("NEW", str(new)).split(), "--dry-run"]) == 2, words
        output = capsys.readouterr()
        assert output.out == "" and missing in output.err, words
        assert not new.exists()


def test_dry_run_of_a_stop_queries_no_device_also_with_json(
    capsys: pytest.CaptureFixture[str],
) -> None:
    typed = ["arm", "stop", "--dry-run", "--set", "ur.host=127.0.0.1"]
    assert main([*typed, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == {"would": "end any program that runs on the arm at 127.0.0.1",
                    "exit_code": 0}  # fmt: skip
    assert main(typed) == 0
    assert capsys.readouterr().out == f"would {result['would']}\n"


HAND = f"--set gripper.calibration=paper {PRESSES} --set modbus.host=127.0.0.1"


def test_refusal_without_confirmation_states_the_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, would in (
        ("arm step --z 3 --set ur.host=127.0.0.1", "move the arm at 127.0.0.1 by x +0, y +0, z +3"),
        (f"release {HAND}", "open all fingers at 22 mm/s, at most 10 N a motor"),
        (f"gripper close --to 90 {HAND}", "close finger ABC to 90 counts at 22 mm/s, at most 10 N"),
        (f"gripper step --finger B {HAND}", "move finger B by +2 counts at 22 mm/s, at most 10 N"),
        (f"gripper activate {HAND}", "open and close all fingers fully"),
        (
            "calibrate hand --up-to 16 --out NEW",
            "move finger A 10 times onto the scale, with force byte 0 (15 N by the manual, at most "
            "--up-to 16 N)",
        ),
    ):
        assert main(words.replace("NEW", str(tmp_path / "new.toml")).split()) == 2, words
        output = capsys.readouterr().err
        assert f"would {would}" in output and "--confirm-motion" in output, words


def test_dry_run_is_refused_on_a_rig_without_real_devices(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for scenario in ("lift", "tap", "acquire"):
        assert main(["run", scenario, "--rig", "simulated", "--dry-run"]) == 2
        assert "is for real devices" in capsys.readouterr().err


def test_a_named_object_is_lifted_also_in_a_first_lift(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = []

    def load(name: str | None, *others: object) -> None:
        loaded.append(name)
        raise UsageError("read", "")

    for loads in ("load_config", "load_lift"):
        monkeypatch.setattr(f"grasp.cli.run.{loads}", load)
    for words in ("", "--first", "--first --object can", "--first --object ball"):
        assert main(["run", "lift", "--dry-run", *words.split()]) == 2
    assert loaded == [None, "foam", "can", "ball"]


def test_first_lift_is_not_by_touch(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "lift", "--first", "--force", "3"]) == 2
    assert "use one of them" in capsys.readouterr().err


def test_dry_run_has_the_exit_code_of_the_first_failure_of_the_run() -> None:
    """The hand is checked after all devices are opened."""
    cell, hand = (Check(name, "fail", "", "", Refused.kind) for name in ("cell", "gripper"))
    arm = Check("arm program", "fail", "")
    for against, code in (([], 0), ([hand], 4), ([arm], 3), ([hand, arm], 3), ([cell, arm], 4)):
        assert dry_code(against) == code


def test_plan_of_an_acquisition_states_its_speeds_forces_and_end() -> None:
    config = load_acquire_config("planar", "simulated")
    plan = press_plan(config, motion("45", 0.05, 0.5), 20.0)
    assert plan[0].startswith("lower the arm at 10 mm/s until finger") and "15 s at most" in plan[0]
    assert "45 degrees of the fingertip, for 20 s" in plan[2]
    assert plan[3] == "stop, and return to the start position at 50 mm/s"
