"""Where the figures of a lab's calibrations come from: in their files, with a note, and told by
every run on real devices."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from detector.scores import unlabelled
from grasp.cli import run
from grasp.cli.main import main
from grasp.cli.operator import TerminalOperator
from scenarios.benchmark import label_free as rules
from scenarios.campaign.config import load_config
from scenarios.lab import sessions
from scenarios.lab.fit import Line, law_of, of_byte
from scenarios.lab.scale import force_file, hand_file
from tests.calibrations import PRESSED

NOTE = 'after the "new" pads'
LAB = """
[gripper]
calibration = "hand.toml"
[guard]
force_limit_n = 20.0
[controller]
grip_force_n = 20.0
[modbus]
host = "127.0.0.99"
[ur]
host = "127.0.0.99"
[usb]
serial = "any"
"""


def stub(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A session that asks no device, its file written with the note that it is given."""
    presses = [of_byte(0, [16.0, 16.1, 16.2, 16.1])]
    line = Line(201.8, (200.3, 203.3), 0.04, 0.64, 2.63, 15, 3)
    files: dict[str, Callable[[str], str]] = {
        "calibrate_hand": lambda note: hand_file("A", presses, law_of(presses), None, {}, note),
        "press_force": lambda note: force_file("A", line, note),
        "calibrate_force": lambda note: force_file("A", line, note),
    }
    if name in files:
        monkeypatch.setattr(sessions, name, lambda *asked: files[name](asked[-1]))
        return
    kept = load_config("can", "hardware", "tcn").rule
    found = SimpleNamespace(
        rule=kept, interval=(-4.0, -3.0), level=-3.5, minutes=3.0, load_counts=900.0
    )
    monkeypatch.setattr(sessions, "held_still", lambda *asked: np.zeros((1, 3, 6), np.int16))
    monkeypatch.setattr(unlabelled, "hold_of", lambda counts: ())
    monkeypatch.setattr(rules, "rule_of", lambda *asked: found)


@pytest.mark.parametrize(
    ("session", "words", "section"),
    [
        ("calibrate_hand", "hand --up-to 16 --scale", "calibration"),
        ("press_force", "force --press --up-to 15 --scale", "source"),
        ("calibrate_force", "force", "source"),
        ("held_still", "noise", "source"),
    ],
)
def test_note_is_kept_in_the_source_of_every_calibration(
    session: str, words: str, section: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stub(session, monkeypatch)
    monkeypatch.setattr(TerminalOperator, "expect", lambda _: None)  # somebody is there
    out = tmp_path / "out.toml"
    typed = ["calibrate", *words.split(), "--out", str(out), "--note", NOTE, "--confirm-motion"]
    if words == "force":
        typed.remove("--confirm-motion")  # nothing moves
    words = ("gripper.calibration=paper", *PRESSED)
    assert main([*typed, *(word for text in words for word in ("--set", text))]) == 0
    if section == "calibration":
        known = load_config("can", "hardware", "energy", None, (f"gripper.calibration={out}",))
        assert known.calibration is not None
        told = known.calibration.source
    else:
        (told,) = load_config("can", "hardware", "energy", [out]).source.in_words()
    assert told.endswith(f"; {NOTE}")
    assert "20" in told  # a date


def told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> list[str]:
    """What a run says of sources before it opens anything."""
    begun: list[Any] = []
    monkeypatch.setattr(run, "run_trials", lambda *asked: begun.append(asked) or 0)
    typed = ["run", "lift", "--rig", "hardware", "--confirm-motion", "--config", "lab.toml"]
    assert main([*typed, *words]) == 0
    assert begun
    return [line for line in capsys.readouterr().err.splitlines() if " by: " in line]


def test_every_run_on_real_devices_tells_the_source_of_each_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(LAB)
    hand = '[calibration]\nsource = "a load cell, in May"\nleast_force_n = {}\n'
    Path("hand.toml").write_text(hand.format(16.0))
    Path("force.toml").write_text('[source]\ncounts_per_newton = "a kitchen scale"\n')
    Path("rule.toml").write_text('[source]\nrule = "a hold of three minutes"\n')
    manual = "calibration 'hand' has force byte 0 press with 16 N, by: a load cell, in May"
    assert told(monkeypatch, capsys) == [f"grasp: {manual}"]
    both = ("--config", "force.toml", "--config", "rule.toml")
    assert told(monkeypatch, capsys, *both)[1:] == [
        "grasp: counts a newton by: a kitchen scale",
        "grasp: rule on slip by: a hold of three minutes",
    ]
    Path("hand.toml").write_text(hand.format(9.0) + "pressed_bytes = [0]\npresses = 10\n")
    (weak,) = told(monkeypatch, capsys)
    assert "9 N, less than the manual's 15 N, by: a load cell, in May" in weak
