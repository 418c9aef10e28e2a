"""Sources of calibrations: stored in their files with a note, and printed by every run."""

from pathlib import Path
from typing import Any

import pytest

from grasp.cli import trials
from grasp.cli.main import main

LAB = """
[gripper]
calibration = "hand.toml"
[guard]
force_limit_n = 20.0
counts_per_newton = [160, 160, 160]
[controller]
grip_force_n = 20.0
[modbus]
host = "127.0.0.99"
[ur]
host = "127.0.0.99"
[usb]
serial = "any"
"""


def output(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> list[str]:
    """Lines about sources that a run prints before it opens a device."""
    started: list[Any] = []
    monkeypatch.setattr(trials, "run_trials", lambda *arguments: started.append(arguments) or 0)
    typed = ["run", "lift", "--rig", "hardware", "--confirm-motion", "--unattended",
             "--config", "lab.toml"]  # fmt: skip
    assert main([*typed, *words]) == 0
    assert started
    lines = capsys.readouterr().err.splitlines()
    return [line for line in lines if " by: " in line or "; source: " in line]


def test_every_run_on_real_devices_prints_the_source_of_each_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(LAB)
    hand = '[calibration]\nsource = "a load cell, in May"\nleast_force_n = {}\n'
    Path("hand.toml").write_text(hand.format(16.0))
    Path("force.toml").write_text('[source]\ncounts_per_newton = "a kitchen scale"\n')
    Path("rule.toml").write_text('[source]\nrule = "a hold of three minutes"\n')
    manual = "calibration 'hand': force byte 0 gives 16 N; source: a load cell, in May"
    assert output(monkeypatch, capsys) == [f"grasp: {manual}"]
    both = ("--config", "force.toml", "--config", "rule.toml")
    assert output(monkeypatch, capsys, *both)[1:] == [
        "grasp: counts per newton by: a kitchen scale",
        "grasp: decision rule by: a hold of three minutes",
    ]
    Path("hand.toml").write_text(hand.format(9.0) + "pressed_bytes = [0]\npresses = 10\n")
    (weak,) = output(monkeypatch, capsys)
    assert "9 N, less than the manual's 15 N; source: a load cell, in May" in weak


def test_single_commands_do_not_repeat_the_warning_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(LAB)
    weak = '[calibration]\nsource = "a scale"\nleast_force_n = 9.0\n'
    Path("hand.toml").write_text(weak + "pressed_bytes = [0]\npresses = 10\n")
    for words in ("gripper close --dry-run", "gripper step --finger B --mm 3 --dry-run",
                  "calibrate noise --seconds 60 --out rule.toml --dry-run"):  # fmt: skip
        assert main([*words.split(), "--config", "lab.toml"]) == 3, words
        assert "less than the manual's" not in capsys.readouterr().err, words


def test_a_lift_without_a_terminal_says_that_nobody_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(trials, "run_trials", None)
    Path("lab.toml").write_text(LAB)
    Path("hand.toml").write_text('[calibration]\nsource = "a scale"\nleast_force_n = 16.0\n')
    typed = ["run", "lift", "--rig", "hardware", "--confirm-motion", "--config", "lab.toml"]
    for more, problem in (
        ((), "nobody is at a terminal to watch and to answer questions (start it at one; a script "
             "that may move the arm without a person: --unattended)"),
        (("--unattended", "--trials", "2"), "--unattended is for one lift"),
        (("--unattended", "--first"), "--unattended is for one lift"),
    ):  # fmt: skip
        assert main([*typed, *more]) == 2, more
        assert problem in capsys.readouterr().err


def test_a_confirmation_without_real_devices_gets_one_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(trials, "run_trials", lambda *_: 0)
    words = ["run", "lift", "--rig", "simulated", "--confirm-motion", "--runs", str(tmp_path)]
    assert main(words) == 0
    said = "--confirm-motion has no effect: rig simulated has no real devices"
    assert capsys.readouterr().err.count(said) == 1
