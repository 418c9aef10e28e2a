"""From a lab's own recordings to a rule: a long lift, and a file of counts."""

import json
import re
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import write
from grasp.cli.main import main
from tests.unit.detector.toy_recordings import toy


def held(path: Path, restless: float) -> Path:
    """Three fingers that press for 50 s, as restlessly (counts), and open."""
    n = 6000
    counts = np.random.default_rng(0).normal(0.0, restless, (n, 3, 6))
    counts[200:5500] -= 60.0
    one = toy(0, "test")
    made = msgspec.structs.replace(
        one, t_s=np.arange(n) * 0.01, counts=counts.round().astype(np.int16),
        slip=np.zeros(n, bool), slip_true=None,
    )  # fmt: skip
    write(path, made)
    return path


@pytest.fixture
def hold(tmp_path: Path) -> Path:
    return held(tmp_path / "hold.npz", 1.5)


def test_a_rule_without_labels_is_toml_that_the_next_run_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hold = held(tmp_path / "restless.npz", 20.0)
    assert main(["detector", "tune", "energy", "--unlabelled", str(hold)]) == 0
    text = capsys.readouterr().out
    assert "load_counts" in text and "is kept" not in text
    rule = tomllib.loads(text)["rule"]
    own = tmp_path / "own.toml"
    own.write_text(text)
    words = ["detector", "evaluate", "energy", "--recording", str(hold), "--config", str(own)]
    assert main([*words, "--json"]) == 0
    sheet = json.loads(capsys.readouterr().out)
    assert 0.5 < rule["threshold"] < 1.0  # higher than the packaged one: this hand is restless
    assert sheet["registered_events"] <= 4  # a budget of one a minute, and the hand's own motion


def test_a_calm_hold_takes_no_rule_below_the_one_that_is_there(
    hold: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "tune", "energy", "--unlabelled", str(hold)]) == 0
    text = capsys.readouterr().out
    assert re.search(r"load_counts +108\d", text) and "is kept" in text
    assert tomllib.loads(text)["rule"]["threshold"] == 0.5
