"""`grasp detector` on data sets: scores, tuning, cards."""

import json
from pathlib import Path
from typing import Any

import pytest

from detector.network_file import weights_path
from detector.recordings import write
from grasp.cli.main import main
from scenarios.campaign.config import load_config
from tests.unit.detector.network_files import write_network
from tests.unit.detector.toy_recordings import toys


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("toys")
    for recording in [*toys("validation", 3, 0), *toys("test", 3, 50)]:
        write(folder / f"{recording.source}.npz", recording)
    return folder


def results(capsys: pytest.CaptureFixture[str], *words: str) -> list[dict[str, object]]:
    assert main(list(words)) == 0
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_every_detector_gets_one_json_object(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = results(
        capsys, "detector", "evaluate", "energy", "psd-fair", "--data", str(data), "--json"
    )
    assert [sheet["detector"] for sheet in found] == ["energy", "psd-fair"]
    for sheet in found:
        figures: Any = sheet["figures"]
        assert figures["recordings"]["value"] == 3
        assert figures["samples"]["value"] == 3 * 800
        assert "false_per_min, slide" in figures
        assert all(figures[name]["low"] is not None for name in ("accuracy", "auc", "recall"))


def test_an_evaluation_states_its_weights_and_rule(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The evaluation states the same as the result of a run."""

    def hashed(name: str, *more: str) -> object:
        words = ["detector", "evaluate", name, "--data", str(data), "--json"]
        return results(capsys, *words, *more)[0]["detector_hash"]

    weights = tmp_path / "other.onnx"
    weights.write_bytes(weights_path("gru").read_bytes())
    packaged = hashed("gru")
    assert packaged == load_config("can", "simulated", "gru").detector_hash()
    assert hashed("gru", "--set", f"network.weights={weights}") == packaged
    assert hashed("gru", "--set", "guard.force_limit_n=8") == packaged
    trained = write_network(tmp_path, "gru", seed=7)
    others = {
        packaged,
        hashed("gru", "--set", "rule.release=9"),
        hashed(str(trained)),
        hashed("energy"),
        hashed("energy", "--set", "energy.threshold_counts=9"),
    }
    assert len(others) == 5


def test_a_tuned_rule_is_toml_that_a_run_accepts(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "tune", "energy", "--data", str(data), "--budget", "12"]) == 0
    path = tmp_path / "tuned.toml"
    path.write_text(capsys.readouterr().out)
    assert "few data" in path.read_text()
    words = ["detector", "evaluate", "energy", "--data", str(data), "--split", "validation"]
    assert "this rule misses 100% of the slips" in path.read_text()
    (sheet,) = results(capsys, *words, "--config", str(path), "--json")
    assert sheet["figures"]["false_per_min"]["value"] <= 12.0  # type: ignore[index]


def test_a_tuned_rule_that_detects_most_slips_has_no_warning(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "tune", "psd-fair", "--data", str(data), "--budget", "12"]) == 0
    assert "misses" not in capsys.readouterr().out


def test_a_budget_too_small_for_the_recorded_rest_is_refused(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tune = ["detector", "tune", "energy", "--data", str(data), "--budget"]
    assert main([*tune, "2"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert "2 false alarms a minute needs 30 s of a hand at rest (90 s of one" in output.err
    assert "there are 5.4 s" in output.err
    assert "or a greater --budget)" in output.err
    assert main([*tune, "12"]) == 0


def test_a_card_describes_the_weights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_network(tmp_path, "gru", seed=7)
    (found,) = results(capsys, "detector", "card", str(path), "--json")
    assert (found["name"], found["seed"], found["mode"]) == ("gru", 7, "stream")
    for word in ("energy", "mine.py:Vibration"):
        assert main(["detector", "card", word]) == 2
        assert f"{word!r} is no network, so it has no card" in capsys.readouterr().err
    assert main(["detector", "card", "tcm"]) == 2
    error = capsys.readouterr().err
    assert "'tcm' is no packaged network (did you mean 'tcn'?)" in error
    assert "one of freq-cnn-paper, gru, tcn, tcn-paper, or a file that ends in .onnx" in error
