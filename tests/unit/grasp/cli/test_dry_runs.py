"""Dry runs of a lab's verbs in JSON: one object, nobody asked, nothing written."""

import json
from pathlib import Path

import pytest

from grasp.cli.main import main


@pytest.mark.parametrize(
    "words",
    ["calibrate hand --up-to 16 --out NEW", "calibrate force --press --out NEW",
     "calibrate noise --out NEW --set gripper.calibration=paper",
     "arm step --z 3 --set ur.host=127.0.0.1", "arm stop --set ur.host=127.0.0.1"],
)  # fmt: skip
def test_dry_run_says_in_json_what_it_would_do(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = tmp_path / "new.toml"
    typed = words.replace("NEW", str(new)).split()
    assert main([*typed, "--dry-run", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["would"].split()[0] in ("move", "end")
    assert told["exit_code"] == 0
    assert main([*typed, "--dry-run"]) == 0
    assert capsys.readouterr().out == f"would {told['would']}\n"
    assert not new.exists()


HAND = "--set gripper.calibration=paper --set modbus.host=127.0.0.1"


@pytest.mark.parametrize(
    ("words", "would"),
    [
        ("arm step --z 3 --set ur.host=127.0.0.1", "move the arm at 127.0.0.1 by x +0, y +0, z +3"),
        (f"gripper open {HAND}", "open all fingers at 22 mm/s, at most 10 N a motor"),
        (f"gripper close --to 90 {HAND}", "close finger ABC to 90 counts at 22 mm/s, at most 10 N"),
        (f"gripper step --finger B {HAND}", "move finger B by +2 counts at 22 mm/s, at most 10 N"),
        (f"gripper activate {HAND}", "open and close all fingers fully"),
        ("calibrate hand --up-to 16 --out NEW", "move finger A, 10 times with each of the force"),
        ("calibrate force --press --out NEW", "move finger A by single counts, up to 15 N"),
    ],
)
def test_refusal_without_confirmation_says_what_would_move(
    words: str, would: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.replace("NEW", str(tmp_path / "new.toml")).split()) == 2
    said = capsys.readouterr().err
    assert f"would {would}" in said
    assert "--confirm-motion" in said


@pytest.mark.parametrize("words", ["run lift", "run tap", "release"])
def test_dry_run_is_refused_on_a_rig_without_real_devices(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words.split(), "--rig", "simulated", "--dry-run"]) == 2
    assert "moves nothing real" in capsys.readouterr().err
