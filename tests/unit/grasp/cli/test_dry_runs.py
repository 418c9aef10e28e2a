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
