"""The pytest plugin: light to load, of use to a stranger, and nothing is left behind."""

import math
import re
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from tests.wire.drivers.ur.emulator.test_process import Rtde, ask_dashboard

ROOT = Path(__file__).parents[4]
PATIENCE_S = 20.0
DEADLINE_S = 100.0


def python(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment,
        capture_output=True, text=True, timeout=DEADLINE_S, check=False,
    )  # fmt: skip


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_loading_it_imports_nothing_heavy(tmp_path: Path) -> None:
    code = (
        "import scenarios.testing.plugin, sys\n"
        "heavy = {'numpy', 'numba', 'msgspec', 'usb', 'pymodbus', 'drivers', 'grasp', 'detector'}\n"
        "print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = python("-c", code, cwd=tmp_path)
    assert done.stdout == "[]\n", done.stderr


def test_example_of_the_documentation_runs_in_a_strangers_project(tmp_path: Path) -> None:
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


def test_cell_breaks_by_name_at_once_and_later(emulated_cell) -> None:
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
    assert emulated_cell.truth().height_m == 0.0


@pytest.mark.parametrize(
    ("request_", "complaint"),
    [
        ({"name": "gripper_dorp"}, "one of gripper_drop, gripper_delay"),
        ({"name": "unplug", "times": 3}, "takes no times"),
        ({"name": "gripper_drop", "times": 0}, "times"),
        ({"name": "arm_freeze", "seconds": 1e9}, "seconds"),
        ({"name": "gripper_fault", "code": 16}, "code"),
        ({"name": "unplug", "tomorrow": True}, "tomorrow"),
        ({"name": "unplug", "after_s": "soon"}, "after_s"),
    ],
    ids=lambda value: value["name"] if isinstance(value, dict) else "",
)
def test_cell_refuses_what_makes_no_sense(request_, complaint) -> None:
    from scenarios.rigs.cell_faults import CellFaults

    faults = CellFaults(Mock(), Mock(), Mock())  # refused before it is used
    with pytest.raises(ValueError, match=complaint):
        faults.order(request_, 0)


def test_unknown_faults_are_refused(emulated_gripper, emulated_board, emulated_arm) -> None:
    for device in (emulated_gripper, emulated_board, emulated_arm):
        with pytest.raises(ValueError):
            device.fault("gremlins")


def test_fault_put_off_does_not_outlive_the_test(emulated_arm) -> None:
    emulated_arm.fault("protective_stop", after_s=3600.0)
    assert emulated_arm.state()["safety_mode"] == 1


@pytest.fixture
def asks(emulated_cell) -> Iterator[Callable[..., dict[str, Any]]]:
    """The cell's control channel."""
    from scenarios.rigs.cell_control import ControlClient

    with closing(ControlClient(**emulated_cell.endpoints["control"])) as control:
        yield control.ask


def test_fault_of_the_arm_is_answered_once_it_is_in_force(emulated_cell) -> None:
    host = emulated_cell.endpoints["host"]
    assert ask_dashboard(host, "robotmode") == "Robotmode: RUNNING"
    emulated_cell.fault("emergency_stop")
    assert ask_dashboard(host, "robotmode") == "Robotmode: POWER_OFF"
    emulated_cell.fault("emergency_stop", pressed=False)
    assert ask_dashboard(host, "power on") == "Powering on"
    assert ask_dashboard(host, "robotmode") == "Robotmode: IDLE"


def test_arm_goes_home_with_its_tool_turned_as_it_was(emulated_cell, asks) -> None:
    arm = emulated_cell.endpoints["arm"]
    turn = (
        "def turn():\n  q = get_actual_joint_positions()\n"
        "  movej([q[0] + 0.1, q[1], q[2], q[3], q[4] + 0.4, q[5] + 0.5], a=4, v=2)\nend\n"
    )
    with Rtde(arm["host"]) as rtde:
        rtde.ask("O", struct.pack(">d", 125.0) + b"runtime_state,actual_q")
        rtde.ask("S")

        def state() -> tuple[int, tuple[float, ...]]:
            _, runtime, *q = struct.unpack(">BI6d", rtde.read()[1])
            return runtime, tuple(q)

        began = state()[1]
        with socket.create_connection((arm["host"], arm["script"]), PATIENCE_S) as sock:
            sock.sendall(turn.encode())
            until(lambda: math.dist(state()[1], began) > 0.64)
            until(lambda: state()[0] == 1)

        def home() -> bool:
            reply = asks("home")
            return not (reply["away_m"] or reply["turned_rad"])

        assert not home()
        until(home)
        for _ in range(500):  # what was sent meanwhile
            if math.dist(state()[1], began) < 1e-4:
                return
    raise AssertionError("joints are others than they were")


def test_arm_is_not_driven_home_while_its_slider_stands_at_nought(emulated_cell, asks) -> None:
    emulated_cell.fault("speed_slider", fraction=0.0)
    with pytest.raises(ValueError, match="speed slider stands at 0"):
        until(lambda: bool(asks("home")["away_m"]))


def test_emergency_stop_of_the_cell(emulated_cell) -> None:
    from drivers.errors import GraspError
    from drivers.ur.driver import ArmDriver, ArmSettings
    from drivers.ur.link.client import UrLink, UrSettings

    with UrLink(UrSettings(host=emulated_cell.endpoints["arm"]["host"])) as link:
        driver = ArmDriver(link, ArmSettings())
        driver.pump(time.monotonic_ns())
        emulated_cell.fault("emergency_stop")

        def stopped() -> bool:
            try:
                driver.pump(time.monotonic_ns())
            except GraspError:
                return True
            return driver.state.stopped_by_safety

        until(stopped)
