"""The pytest plugin: fast to load, usable in another project, faults by name."""

import re
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from tests.wire.drivers.ur.emulator.test_process import ask_dashboard
from tests.wire.lab import ROOT
from tests.wire.waiting import PATIENCE_S, until


def python(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment,
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip


def test_loading_it_imports_nothing_heavy(tmp_path: Path) -> None:
    code = (
        "import scenarios.testing.plugin, sys\n"
        "heavy = {'numpy', 'numba', 'msgspec', 'usb', 'pymodbus', 'drivers', 'grasp', 'detector'}\n"
        "print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = python("-c", code, cwd=tmp_path)
    assert done.stdout == "[]\n", done.stderr


def test_documented_example_runs_in_another_project(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "testing.md").read_text(encoding="utf-8")
    example = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert example
    (tmp_path / "test_devices.py").write_text(example[1])
    installed = any(e.value == "scenarios.testing.plugin" for e in entry_points(group="pytest11"))
    load = () if installed else ("-p", "scenarios.testing.plugin")
    plugin = (*load, "-p", "no:cacheprovider", "-W", "error")
    done = python("-m", "pytest", "-q", *plugin, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"[34] passed", done.stdout), done.stdout


def test_faults_of_a_cell_are_injected_at_once_and_later(emulated_cell) -> None:
    import usb.core

    from drivers.takktile.emulator.bus import backend

    bus = backend(emulated_cell.endpoints["tactile"]["url"])

    def plugged() -> bool:
        return usb.core.find(backend=bus) is not None

    assert plugged()
    emulated_cell.fault("unplug")
    assert not plugged()
    emulated_cell.fault("replug", after_s=0.2)
    until(plugged)
    host = emulated_cell.endpoints["host"]
    emulated_cell.fault("emergency_stop")
    until(lambda: ask_dashboard(host, "robotmode") == "Robotmode: POWER_OFF")
    emulated_cell.fault("emergency_stop", pressed=False)
    assert ask_dashboard(host, "power on") == "Powering on"
    until(lambda: ask_dashboard(host, "robotmode") == "Robotmode: IDLE")


def test_unknown_faults_are_refused(emulated_gripper, emulated_board, emulated_arm) -> None:
    for device in (emulated_gripper, emulated_board, emulated_arm):
        with pytest.raises(ValueError):
            device.fault("gremlins")
    assert emulated_arm.state()["safety_mode"] == 1
