"""A detector of one's own runs wherever a packaged one does, and nowhere by itself."""

import json
import os
import shutil
import sqlite3
from pathlib import Path

import pytest

import grasp
from detector.decision import RuleSettings
from detector.network_file import weights_path
from drivers.errors import ConfigError, UsageError
from grasp.cli.main import main
from grasp.cli.rules import rule_of_weights
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import combinations, read_spec
from tests.unit.detector.test_own import WHOLE, weights
from tests.unit.grasp.cli.test_recordings_cli import stroke_csv

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_detector.py"
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def mine(tmp_path: Path) -> str:
    path = tmp_path / "mine.py"
    path.write_text(EXAMPLE.read_text())
    return f"{path}:Tremble"


def told(capsys: Capture) -> dict[str, object]:
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_a_lift_its_replay_and_its_page(mine: str, tmp_path: Path, capsys: Capture) -> None:
    words = ["run", "lift", "--rig", "simulated", "--pace", "max", "--detector", mine, "--json"]
    assert main([*words, "--runs", str(tmp_path / "runs")]) == 0
    result = told(capsys)
    assert result["detector"] == mine
    run = str(Path(str(result["recording"])).parent)
    assert main(["replay", run, "--check", "--detector", mine]) == 0
    capsys.readouterr()
    assert main(["report", run]) == 0
    page = Path(capsys.readouterr().out.strip().splitlines()[-1])
    assert "mine.py:Tremble" in page.read_text()


def test_no_recording_runs_code_that_nobody_named(
    mine: str, tmp_path: Path, capsys: Capture
) -> None:
    folder = grasp.lift(detector=mine, runs=tmp_path / "runs").folder
    Path(mine.rpartition(":")[0]).write_text("raise RuntimeError('it was run')")
    assert main(["replay", str(folder), "--check"]) == 2
    said = capsys.readouterr().err
    assert "code that no replay runs by itself" in said
    assert "it was run" not in said
    with pytest.raises(UsageError, match="no replay runs by itself"):
        grasp.replay(folder)


def test_a_replay_with_another_version_of_the_code_says_so(mine: str, tmp_path: Path) -> None:
    folder = grasp.lift(detector=mine, runs=tmp_path / "runs").folder
    file = tmp_path / "moved.py"
    file.write_text(EXAMPLE.read_text())
    same = grasp.replay(folder, detector=f"{file}:Tremble")
    assert same.same  # type: ignore[union-attr]
    file.write_text(EXAMPLE.read_text().replace("0.8 *", "0.7 *"))
    other = grasp.replay(folder, detector=f"{file}:Tremble")
    assert other.replay.differences[0].what == "hash of the settings"  # type: ignore[union-attr]


def test_a_run_with_a_packaged_detector_is_replayed_with_that_alone(
    mine: str, tmp_path: Path
) -> None:
    folder = grasp.lift(detector="energy", runs=tmp_path / "runs").folder
    with pytest.raises(UsageError, match="recorded with energy"):
        grasp.replay(folder, detector=mine)


def test_scoring_and_a_fingertip_s_recording(mine: str, tmp_path: Path, capsys: Capture) -> None:
    csv = str(stroke_csv(tmp_path / "s.csv"))
    words = ["--set", "own.counts=9", "--json"]
    assert main(["detector", "evaluate", mine, "--recording", csv, *words]) == 0
    assert told(capsys)["detector"] == mine
    assert main(["replay", "--tactile", csv, "--detector", mine]) == 0
    assert "Tremble on" in capsys.readouterr().out


def test_two_of_one_name_are_told_apart_in_scores(
    mine: str, tmp_path: Path, capsys: Capture
) -> None:
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "mine.py").write_text(EXAMPLE.read_text())
    other = f"{tmp_path}/b/mine.py:Tremble"
    csv, out = str(stroke_csv(tmp_path / "s.csv")), tmp_path / "scores.json"
    assert main(["detector", "evaluate", mine, other, "--recording", csv, "--out", str(out)]) == 0
    assert f"{mine} on " in (said := capsys.readouterr().out) and f"{other} on " in said
    assert [each["detector"] for each in json.loads(out.read_text())["detectors"]] == [mine, other]


def test_tuning_its_rule_on_labelled_recordings(
    mine: str, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    from detector.recordings import read
    from scenarios.benchmark import scoring

    recording = read(stroke_csv(tmp_path / "s.csv"))
    monkeypatch.setattr(scoring, "read_split", lambda folders, split, *tell: [recording])
    assert main(["detector", "tune", mine, "--data", str(tmp_path), "--budget", "600"]) == 0
    assert "[rule]" in capsys.readouterr().out


def test_a_campaign_finds_it_beside_its_own_file(
    mine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights(tmp_path / "lab.onnx", ["n", 20, 6])
    file = tmp_path / "c.toml"
    file.write_text(
        'name = "c"\nobjects = ["can"]\nrepetitions = 1\n'
        'detectors = ["mine.py:Tremble", "energy", "lab.onnx"]\n'
    )
    monkeypatch.chdir("/")
    out = tmp_path / "c.sqlite"
    assert main(["campaign", "run", str(file), "--out", str(out), "--jobs", "1", "--json"]) == 0
    with sqlite3.connect(out) as db:
        rows = db.execute("SELECT detector, status, detector_hash FROM trials").fetchall()
    db.close()
    assert [row[0] for row in rows] == [mine, "energy", str(tmp_path / "lab.onnx")]
    assert {row[1] for row in rows} == {"done"}
    assert len({row[2] for row in rows}) == 3
    places = combinations(read_spec(file))
    assert places[0].config.detector_name == mine


def test_its_rule_lies_beside_it(mine: str, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[rule]\nconsecutive = 7\n[own]\ncounts = 3.0\n")
    config = load_config("can", "simulated", mine)
    assert config.rule.consecutive == 7
    assert config.own == {"counts": 3.0}


def test_a_rule_beside_it_that_says_nothing_is_refused_but_while_it_is_being_written(
    mine: str, tmp_path: Path
) -> None:
    """By a shell that has emptied the file for what `grasp detector tune` will print."""
    beside = tmp_path / "mine.toml"
    beside.write_text("")
    with pytest.raises(ConfigError, match="says nothing"):
        load_config("can", "simulated", mine)
    beside.unlink()
    beside.symlink_to("nowhere.toml")
    with pytest.raises(ConfigError, match="no such file"):
        load_config("can", "simulated", mine)
    beside.unlink()
    beside.mkdir()
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config("can", "simulated", mine)
    beside.rmdir()
    kept = os.dup(1)
    try:
        with beside.open("w") as printed:
            os.dup2(printed.fileno(), 1)
            assert load_config("can", "simulated", mine).rule == RuleSettings()
    finally:
        os.dup2(kept, 1)
        os.close(kept)


@pytest.mark.parametrize(
    "setting", ["[guard]\nforce_limit_n = 15.0", "[ur]\nheartbeat_timeout_s = 5.0", "seed = 3"]
)
def test_what_lies_beside_a_detector_sets_its_rule_and_no_limit(
    mine: str, tmp_path: Path, setting: str
) -> None:
    beside = tmp_path / "mine.toml"
    beside.write_text(f"{setting}\n[rule]\nconsecutive = 3\n")
    with pytest.raises(ConfigError, match="is not of a detector"):
        load_config("can", "simulated", mine)


def test_two_files_of_weights_at_once_are_refused(tmp_path: Path) -> None:
    mine, other = tmp_path / "mine.onnx", tmp_path / "other.onnx"
    for file, name in ((mine, "tcn"), (other, "gru")):
        shutil.copy(weights_path(name), file)
    config = load_config("can", "simulated", str(mine), None, [f"network.weights={other}"])
    with pytest.raises(UsageError, match="two files of weights"):
        config.make_detector(3)


def test_its_hash_tells_its_code_its_settings_and_not_its_place(mine: str, tmp_path: Path) -> None:
    def hashes(word: str, *words: str) -> tuple[str, str]:
        config = load_config("can", "simulated", word, None, words)
        return config.digest(), config.detector_hash()

    copy = tmp_path / "copy.py"
    copy.write_text(EXAMPLE.read_text())
    assert hashes(mine) == hashes(f"{copy}:Tremble")
    assert hashes(mine) != hashes(mine, "own.counts=9")
    before = hashes(mine)
    Path(mine.rpartition(":")[0]).write_text(WHOLE + "\nTremble = Mine\n")
    assert set(hashes(mine)) & set(before) == set()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = = 1", "SyntaxError"),
        ("raise RuntimeError('no')", "RuntimeError: no"),
        (WHOLE.replace("return self.buffer", "return 3"), "shape"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "evaluate", "campaign", "replay"])
def test_what_is_wrong_with_it_is_one_line_in_every_verb(
    verb: str, text: str, told: str, tmp_path: Path, capsys: Capture
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text)
    word, csv = f"{file}:Mine", str(stroke_csv(tmp_path / "s.csv"))
    (tmp_path / "c.toml").write_text(f'name = "c"\nobjects = ["can"]\ndetectors = ["{word}"]\n')
    runs = str(tmp_path / "runs")
    lines = {
        "run": ["run", "lift", "--rig", "simulated", "--detector", word, "--runs", runs],
        "evaluate": ["detector", "evaluate", word, "--recording", csv],
        "campaign": ["campaign", "run", str(tmp_path / "c.toml"), "--out", runs],
        "replay": ["replay", "--tactile", csv, "--detector", word],
    }
    assert main(lines[verb]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert "Traceback" not in said
    assert not any(Path(runs).glob("*"))


def test_one_that_fails_in_the_air_ends_in_the_safe_state(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "mine.py"
    file.write_text(WHOLE.replace("self.n += 1", "self.n += 1\n        if self.n > 60: 1 / 0"))
    words = ["run", "lift", "--rig", "simulated", "--pace", "max", "--detector", f"{file}:Mine"]
    assert main([*words, "--runs", str(tmp_path), "--json"]) == 4
    result = told(capsys)["result"]
    assert isinstance(result, dict)
    assert result["outcome"] == "fault"
    assert result["bug"] is None
    assert "update raised ZeroDivisionError" in json.dumps(result["phases"])


def test_a_name_that_nobody_knows_is_told_what_else_it_may_be(capsys: Capture) -> None:
    assert main(["run", "lift", "--rig", "simulated", "--detector", "tnc"]) == 2
    said = capsys.readouterr().err
    assert "did you mean 'tcn'" in said
    assert "FILE.py:NAME" in said


def test_its_settings_are_shown_and_what_they_cannot_be_is_refused(
    mine: str, capsys: Capture
) -> None:
    words = ["config", "show", "own", "--detector", mine, "--set"]
    assert main([*words, "own.counts=9"]) == 0
    assert "counts = 9  # dict[str, bool | int | float | str]" in capsys.readouterr().out
    for wrong in ("own.counts=[9]", "own.counts={a=1}", "own=3", "devices.gripper_settings=[1]"):
        assert main([*words, wrong]) == 2
        assert "Traceback" not in capsys.readouterr().err


def test_a_run_says_by_which_rule_a_network_of_ones_own_is_heard(tmp_path: Path) -> None:
    file = weights(tmp_path / "lab.onnx", ["n", 6])
    (tmp_path / "tuned.toml").write_text("[rule]\nthreshold = 0.9\n")
    under = [f"network.weights={file}"]
    packaged = rule_of_weights(load_config("can", "simulated", "tcn", None, under))
    assert packaged.startswith(f"tcn ({file}): slip is registered") and "0.7471" in packaged
    own = load_config("can", "simulated", str(file), None, [])
    assert "above 0.5 for 2 samples" in rule_of_weights(own)
    tuned = load_config("can", "simulated", str(file), [tmp_path / "tuned.toml"], [])
    assert "above 0.9 for 2 samples" in rule_of_weights(tuned)
    assert rule_of_weights(load_config("can", "simulated", "tcn")) == ""


def test_settings_are_not_shown_with_weights_that_a_run_would_refuse(
    tmp_path: Path, capsys: Capture
) -> None:
    file = tmp_path / "mine.onnx"
    shown = ["config", "show", "rule"]
    shutil.copy(weights_path("gru"), file)
    for words in ([f"--set=network.weights={file}"], ["--set=network.weights=gru"]):
        assert main([*shown, *words]) == 2
        told = capsys.readouterr()
        assert "holds a network 'gru', not 'tcn'" in told.err and "--detector gru" in told.err
        assert told.out == ""
        assert main([*shown, "--detector", "gru", *words]) == 0
        assert "threshold = 0.7625" in capsys.readouterr().out
    assert main([*shown, "--detector", str(file)]) == 0
    file.write_bytes(b"none")
    for words in (["--detector", str(file)], ["--set", f"network.weights={file}"]):
        assert main([*shown, *words]) == 2
        assert "damaged" in capsys.readouterr().err


def test_two_networks_are_told_apart_by_name(tmp_path: Path) -> None:
    file = weights(tmp_path / "lab.onnx", ["n", 6])
    config = load_config("can", "simulated", "gru", None, [f"network.weights={file}"])
    assert config.detector_label == f"gru ({file})"
    assert load_config("can", "simulated", "gru").detector_label == "gru"
