"""Warnings of user weights with a decision rule that was tuned for other weights."""

import shutil
from pathlib import Path

import pytest

from detector.network_file import weights_path
from grasp.cli.main import main
from tests.unit.detector.test_plugins import weights

Capture = pytest.CaptureFixture[str]
PACKAGED = "is used with the rule of the packaged tcn, tuned for other weights"
SHOW = ["config", "rule"]


@pytest.fixture
def lab(tmp_path: Path) -> str:
    return str(weights(tmp_path / "lab.onnx", ["n", 6]))


def test_printed_settings_warn_of_a_rule_tuned_for_other_weights(lab: str, capsys: Capture) -> None:
    for more in ([], ["--json"]):
        assert main([*SHOW, "--set", f"network.weights={lab}", *more]) == 0
        output = capsys.readouterr().err
        assert PACKAGED in output and f"tune tcn --set network.weights={lab} --data DIR" in output
    assert main([*SHOW, "--detector", lab]) == 0
    output = capsys.readouterr().err
    assert "no rule that was tuned for it" in output and f"tune {lab} --data DIR" in output
    assert main(["config", "gripper", "--set", f"network.weights={lab}"]) == 0
    assert capsys.readouterr().err == ""


def test_no_warning_for_a_user_rule_or_packaged_weights(
    lab: str, tmp_path: Path, capsys: Capture
) -> None:
    rule, copied = tmp_path / "rule.toml", tmp_path / "copied.onnx"
    rule.write_text("[rule]\nthreshold = 0.9\n")
    shutil.copy(weights_path("tcn"), copied)
    shutil.copy(
        weights_path("tcn").with_name("tcn.auxiliary.json"), tmp_path / "copied.auxiliary.json"
    )
    for words in (
        ["--set", f"network.weights={lab}", "--config", str(rule)],
        ["--set", f"network.weights={lab}", "--set", "rule.threshold=0.9"],
        ["--set", f"network.weights={copied}"],
        ["--detector", "energy"],
        [],
    ):
        assert main([*SHOW, *words]) == 0
        assert capsys.readouterr().err == "", words
    rule.rename(tmp_path / "lab.toml")
    assert main([*SHOW, "--detector", lab]) == 0
    assert capsys.readouterr().err == ""
