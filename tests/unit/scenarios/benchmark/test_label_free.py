"""Label-free calibration of a rule on the recording of a hold."""

import json
import re
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import write
from drivers.errors import UsageError
from grasp.cli.main import main
from scenarios.benchmark.label_free import read_hold
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from tests.unit.detector.toy_recordings import toy


def write_hold(path: Path, noise: float) -> Path:
    """Three fingers that press for 50 s with that noise (counts), then open."""
    n = 6000
    counts = np.random.default_rng(0).normal(0.0, noise, (n, 3, 6))
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
    return write_hold(tmp_path / "hold.npz", 1.5)


def test_calibrated_rule_is_a_settings_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hold = write_hold(tmp_path / "noisy.npz", 20.0)
    assert main(["detector", "tune", "energy", "--unlabelled", str(hold)]) == 0
    text = capsys.readouterr().out
    assert "load_counts" in text and "is kept" not in text
    rule = tomllib.loads(text)["rule"]
    rule_file = tmp_path / "rule.toml"
    rule_file.write_text(text)
    words = ["detector", "evaluate", "energy", "--recording", str(hold), "--config", str(rule_file)]
    assert main([*words, "--json"]) == 0
    sheet = json.loads(capsys.readouterr().out)
    assert 0.5 < rule["threshold"] < 1.0  # above the packaged one, because of the noise
    assert sheet["figures"]["events"]["value"] <= 4  # one a minute, and its motion


def test_calibrated_threshold_is_not_below_the_configured_one(
    hold: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["detector", "tune", "energy", "--unlabelled", str(hold)]) == 0
    text = capsys.readouterr().out
    assert re.search(r"load_counts +108\d", text) and "is kept" in text
    assert tomllib.loads(text)["rule"]["threshold"] == 0.5


def test_count_and_sum_of_a_rule_are_both_calibrated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hold = write_hold(tmp_path / "noisy.npz", 20.0)
    words = ["detector", "tune", "energy", "--unlabelled", str(hold)]
    found = []
    for kind in ("consecutive", "cusum", "either"):
        given = [f"rule.kind={kind}"]
        given += ["rule.drift=2", "rule.limit=0.1"] if kind != "consecutive" else []
        assert main([*words, *(word for each in given for word in ("--set", each))]) == 0
        found.append(tomllib.loads(capsys.readouterr().out)["rule"])
    count, total, both = found
    assert (both["threshold"], both["limit"]) == (count["threshold"], total["limit"])
    assert both["limit"] > 0.2
    words += ["--set", "rule.kind=either", "--set", "rule.drift=-5"]
    assert main(words) == 2  # at rest the sum rises without end
    assert "classifies the hold without slip as slip" in capsys.readouterr().err


def test_a_run_that_ended_before_its_first_frame_has_no_hold(tmp_path: Path) -> None:
    noisy = load_config("can", "simulated", assignments=["fingertip.noise_counts=1.5"]).for_lift()
    lift.run(noisy, 0, tmp_path)
    (recording,) = tmp_path.glob("*/recording.mcap")
    with pytest.raises(UsageError, match="has no hold"):
        read_hold(recording)
