"""A lab's path (docs/robustness.md, "A stranger's sensor"): from recordings of its own to a
detector with a rule and weights of its own, and a lift that is run with them."""

import json
from pathlib import Path

import pytest

from grasp.cli.main import main

pytest.importorskip("torch")
pytestmark = pytest.mark.train
STROKES = [("planar", 0), ("planar", 45), ("planar", 90), ("sphere", 0), ("sphere", 135)]


def said(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([str(word) for word in words]) == 0
    return capsys.readouterr().out


def test_a_lab_comes_from_its_own_recordings_to_a_lift_with_a_rule_and_weights_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, own = tmp_path / "runs", tmp_path / "own"
    for surface, direction in STROKES:
        said(capsys, "run", "acquire", "--rig", "simulated", "--surface", surface, "--direction",
             direction, "--speed", 0.05, "--seconds", 30, "--runs", runs)  # fmt: skip
    said(capsys, "dataset", "collect", *sorted(runs.iterdir()), "--out", own)
    scores = said(
        capsys, "detector", "evaluate", "tcn", "gru", "energy", "--data", own, "--split", "all"
    )
    assert all(name in scores for name in ("tcn", "gru", "energy"))

    rule, weights = tmp_path / "own.toml", tmp_path / "mine.onnx"
    rule.write_text(said(capsys, "detector", "tune", "tcn", "--data", own, "--budget", 20))
    said(capsys, "config", rule)
    said(capsys, "detector", "train", "tcn", "--data", own, "--steps", 60, "--validations", 1,
         "--out", weights)  # fmt: skip
    chosen = f"network.weights={weights}"
    rule.write_text(
        said(capsys, "detector", "tune", "tcn", "--data", own, "--budget", 20, "--set", chosen)
    )

    capsys.readouterr()
    code = main(["run", "lift", "--rig", "simulated", "--runs", str(runs), "--set", chosen,
                 "--config", str(rule), "--json"])  # fmt: skip
    result = json.loads(capsys.readouterr().out)
    assert code in (0, 1) and result["outcome"] != "fault"  # so short a training hears what it may
    shown = json.loads(said(capsys, "config", "--set", chosen, "--config", rule, "--json"))
    assert shown["network"]["weights"] == str(weights)
    assert shown["files"][str(rule)]
