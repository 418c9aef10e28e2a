"""Device commands work where nothing can be compiled or cached."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from grasp.cli import exits
from grasp.cli.main import main
from tests.ur_rtde import needs_ur_rtde

ROOT = Path(__file__).parents[4]
NOBODY = "127.9.8.7"  # no server is there
LAB = f"""\
[gripper]
calibration = "paper"
[calibration]
pressed_bytes = [0]
presses = 10
[guard]
counts_per_newton = [160, 160, 160]
[modbus]
host = "{NOBODY}"
port = 9
[usb]
url = "tcp://{NOBODY}:9"
[ur]
host = "{NOBODY}"
"""
STOP = ("arm stop", 3, f"dashboard at {NOBODY}")
RELEASE = ("release --rig hardware --confirm-motion", 3, f"the gripper at {NOBODY}:9")
COMMANDS = [
    ("arm stop --help", 0, ""),
    STOP,
    ("status arm", 3, f"arm at {NOBODY}"),
    ("arm step --z 1 --confirm-motion", 3, f"arm at {NOBODY}"),
    ("status gripper", 3, f"the gripper at {NOBODY}:9"),
    ("release --confirm-motion", 3, f"the gripper at {NOBODY}:9"),
    ("gripper activate --empty --confirm-motion", 3, f"the gripper at {NOBODY}:9"),
    ("gripper close --confirm-motion", 3, NOBODY),
    RELEASE,
    ("tactile watch --rest", 3, NOBODY),
    ("run lift --rig hardware --confirm-motion --unattended --runs {folder}", 3, NOBODY),
]
WITHOUT_COMPILER = """
import json, sys
sys.modules["numba"] = None  # its import raises
from grasp.cli.main import main
for command in json.loads(sys.argv[1]):
    print(">>>", flush=True, file=sys.stderr)
    try:
        code = main(command)
    except SystemExit as left:  # argparse, after printing the help
        code = left.code
    print("exit", code, flush=True, file=sys.stderr)
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    file = tmp_path / "lab.toml"
    file.write_text(LAB)
    return file


def words_of(command: str, lab: Path) -> list[str]:
    of_lab = [] if "--help" in command else ["--config", str(lab)]
    return [*command.format(folder=lab.parent / "runs").split(), *of_lab]


def python(*arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment}, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip


@needs_ur_rtde
def test_a_command_of_devices_imports_nothing_that_compiles(lab: Path) -> None:
    commands = [words_of(command, lab) for command, _, _ in COMMANDS]
    done = python(WITHOUT_COMPILER, json.dumps(commands))
    outputs = done.stderr.split(">>>\n")[1:]
    assert len(outputs) == len(COMMANDS), done.stderr
    for (command, code, problem), text in zip(COMMANDS, outputs, strict=True):
        assert text.endswith(f"exit {code}\n") and problem in text, (command, text)


@pytest.mark.parametrize("rig", ["emulated", "hardware"])
def test_a_ur_arm_without_ur_rtde_is_refused_before_anything_starts(
    rig: str, lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rtde_control", None)
    monkeypatch.setattr(subprocess, "Popen", None)  # an emulated cell
    settings = (
        ["--config", str(lab), "--confirm-motion", "--unattended"] if rig == "hardware" else []
    )
    runs = str(lab.parent / "runs")
    code = main(["run", "lift", "--rig", rig, "--json", "--runs", runs, *settings])
    error = json.loads(capsys.readouterr().out)["error"]
    assert code == exits.USAGE
    assert "ur-rtde has wheels for Python 3.11 and 3.12 on x86_64" in error["message"]
    assert "the rig simulated" in error["remedy"]
