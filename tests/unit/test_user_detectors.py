"""User detectors run wherever packaged ones do, and only if they are named."""

import json
import re
from pathlib import Path

import pytest

import grasp
from drivers.errors import ConfigError, UsageError
from grasp.cli.main import main
from scenarios.campaign.config import load_config
from tests.unit.detector.test_plugins import WHOLE
from tests.unit.grasp.cli.test_recordings_cli import stroke_csv

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_detector.py"
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def mine(tmp_path: Path) -> str:
    path = tmp_path / "mine.py"
    path.write_text(EXAMPLE.read_text())
    return f"{path}:Vibration"


def expected(capsys: Capture) -> dict[str, object]:
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_user_detector_in_a_lift_its_replay_and_its_page(
    mine: str, tmp_path: Path, capsys: Capture
) -> None:
    words = ["run", "lift", "--rig", "simulated", "--pace", "max", "--detector", mine, "--json"]
    assert main([*words, "--runs", str(tmp_path / "runs")]) == 0
    result = expected(capsys)
    assert result["detector"] == mine
    run = str(Path(str(result["recording"])).parent)
    assert main(["replay", run, "--check", "--detector", mine]) == 0
    capsys.readouterr()
    assert main(["report", run]) == 0
    page = Path(capsys.readouterr().out.strip().splitlines()[-1])
    row = re.search(r">detector</t.><td[^>]*>([^<]*)<", page.read_text())
    assert row is not None and row[1].endswith("mine.py:Vibration")


def test_trials_in_which_a_detector_raised_are_errors_with_its_line(
    tmp_path: Path, capsys: Capture
) -> None:
    path, spec = tmp_path / "mine.py", tmp_path / "spec.toml"
    lines = WHOLE.replace("self.n += 1", "assert not counts.any()\n        self.n += 1")
    path.write_text(lines)
    spec.write_text('name = "broken"\nscenarios = ["lift"]\nobjects = ["can"]\nrepetitions = 1\n')
    words = ["campaign", "run", str(spec), "--detector", f"{path}:Mine", "--jobs", "1"]
    assert main([*words, "--out", str(tmp_path / "a.sqlite")]) == 1
    shown = capsys.readouterr().out
    line = 1 + lines.splitlines().index("        assert not counts.any()")
    assert "1 trial, 1 error" in shown
    assert f"detector_failed: {path}, line {line}: update raised AssertionError" in shown


def test_a_recording_does_not_run_code_that_was_not_named(
    mine: str, tmp_path: Path, capsys: Capture
) -> None:
    folder = grasp.lift(detector=mine, runs=tmp_path / "runs").folder
    Path(mine.rpartition(":")[0]).write_text("raise RuntimeError('it was run')")
    assert main(["replay", str(folder), "--check"]) == 2
    output = capsys.readouterr().err
    assert "code that a replay does not run unasked" in output
    assert "it was run" not in output
    with pytest.raises(UsageError, match="a replay does not run unasked"):
        grasp.replay(folder)


def test_user_detector_scores_recordings(mine: str, tmp_path: Path, capsys: Capture) -> None:
    csv = str(stroke_csv(tmp_path / "s.csv"))
    words = ["--set", "plugin.counts=9", "--json"]
    assert main(["detector", "evaluate", mine, "--recording", csv, *words]) == 0
    assert expected(capsys)["detector"] == mine
    assert main(["replay", "--tactile", csv, "--detector", mine]) == 0
    assert "Vibration on" in capsys.readouterr().out


@pytest.mark.parametrize(
    "setting", ["[guard]\nforce_limit_n = 15.0", "[ur]\nheartbeat_timeout_s = 5.0", "seed = 3"]
)
def test_settings_next_to_a_detector_set_its_rule_but_no_limit(
    mine: str, tmp_path: Path, setting: str
) -> None:
    beside = tmp_path / "mine.toml"
    beside.write_text(f"{setting}\n[rule]\nconsecutive = 3\n")
    with pytest.raises(ConfigError, match="is no detector section"):
        load_config("can", "simulated", mine)


def test_hash_depends_on_code_and_settings_but_not_on_the_path(mine: str, tmp_path: Path) -> None:
    def hashes(word: str, *words: str) -> tuple[str, str]:
        config = load_config("can", "simulated", word, None, words)
        return config.digest(), config.detector_hash()

    copy = tmp_path / "copy.py"
    copy.write_text(EXAMPLE.read_text())
    assert hashes(mine) == hashes(f"{copy}:Vibration")
    assert hashes(mine) != hashes(mine, "plugin.counts=9")
    before = hashes(mine)
    Path(mine.rpartition(":")[0]).write_text(WHOLE + "\nVibration = Mine\n")
    assert set(hashes(mine)) & set(before) == set()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = = 1", "SyntaxError"),
        ("raise RuntimeError('no')", "RuntimeError: no"),
        (WHOLE.replace("return self.buffer", "return 3"), "shape"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "campaign"])
def test_errors_of_a_user_detector_are_one_line_in_every_command(
    verb: str, text: str, expected: str, tmp_path: Path, capsys: Capture
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text)
    word = f"{file}:Mine"
    (tmp_path / "c.toml").write_text(f'name = "c"\nobjects = ["can"]\ndetectors = ["{word}"]\n')
    runs = str(tmp_path / "runs")
    lines = {
        "run": ["run", "lift", "--rig", "simulated", "--detector", word, "--runs", runs],
        "campaign": ["campaign", "run", str(tmp_path / "c.toml"), "--out", runs],
    }
    assert main(lines[verb]) == 2
    output = capsys.readouterr().err
    assert expected in output
    assert "Traceback" not in output
    assert not any(Path(runs).glob("*"))


def test_user_detector_that_fails_in_the_air_ends_in_the_safe_state(
    tmp_path: Path, capsys: Capture
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(WHOLE.replace("self.n += 1", "self.n += 1\n        if self.n > 60: 1 / 0"))
    words = ["run", "lift", "--rig", "simulated", "--pace", "max", "--detector", f"{file}:Mine"]
    assert main([*words, "--runs", str(tmp_path), "--json"]) == 4
    result = expected(capsys)["result"]
    assert isinstance(result, dict)
    assert result["outcome"] == "fault"
    assert result["bug"] is None
    assert "update raised ZeroDivisionError" in json.dumps(result["phases"])
