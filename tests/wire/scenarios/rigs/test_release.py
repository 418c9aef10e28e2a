"""`grasp release` on the hardware rig, pointed at an emulated cell: needs the gripper's link."""

import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from grasp.clock import WallClock
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.cell_control import ControlClient
from scenarios.rigs.permission import driving, gripper_of
from scenarios.rigs.rig import activate
from scenarios.rigs.wired import wired_gripper
from tests.wire.scenarios.test_rigs import ENVIRONMENT, GRASP, emulate, lab_file

HOLDING_COUNTS = (120, 120, 120)


class Lab:
    """An emulated cell, the file that points at it, and `grasp release` with that file."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        self.file = lab_file(folder / "lab.toml", endpoints)
        control = endpoints["control"]
        self.cell = ControlClient(control["host"], control["port"])
        self.command = f"grasp release --rig hardware --confirm-motion --config {self.file}"

    @property
    def config(self) -> RunConfig:
        return load_config("can", "hardware", "energy", self.file)

    def release(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [*GRASP, *self.command.split()[1:], *words], env=ENVIRONMENT, capture_output=True,
            text=True, check=False, timeout=60,
        )  # fmt: skip

    def leave_closed(self, *, active: bool = True) -> None:
        """As a run leaves the hand that ended in a fault."""
        clock = WallClock(WallClock().now_ns)
        with wired_gripper(self.config, lambda: clock.now_ns) as gripper:
            activate(gripper, clock)
            if active:
                gripper.move_to(HOLDING_COUNTS, 0.11, 10.0)
                end_s = time.monotonic() + 20.0
                while gripper.state is None or not gripper.state.at_rest:
                    assert time.monotonic() < end_s
                    time.sleep(0.02)
                    gripper.pump(clock.now_ns)


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with emulate() as endpoints:
        found = Lab(endpoints, tmp_path)
        yield found
        found.cell.close()


def test_hand_opens_whatever_arm_and_fingertips_do(lab: Lab) -> None:
    lab.leave_closed()
    lab.cell.ask("fault", name="protective_stop")
    lab.cell.ask("fault", name="unplug")
    done = lab.release("--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["rig"] == "hardware"
    assert lab.config.modbus.host in told["gripper"]
    assert max(told["positions_counts"]) < 10
    assert "PROTECTIVE_STOP" in told["arm"]
    assert "no TakkTile board" in told["fingertips"]


def test_hand_opens_where_nobody_has_said_which_arm_and_fingertips(lab: Lab) -> None:
    lab.leave_closed()
    config = lab.config.modbus
    address = f'host = "{config.host}"\nport = {config.port}\n'
    lab.file.write_text(f'[gripper]\ncalibration = "paper"\n[modbus]\n{address}')
    done = lab.release()
    assert done.returncode == 0, done.stderr
    assert f"released on rig hardware: gripper at {config.host}:{config.port}" in done.stdout
    assert "arm: ur: host" in done.stdout


def test_hand_that_is_not_active_is_opened_only_when_told_to_activate_it(lab: Lab) -> None:
    done = lab.release()
    assert done.returncode == 4
    assert "the hand is not active: nothing was moved" in done.stderr
    assert f"`{lab.command} --activate`" in done.stderr
    assert "empty the hand or support" in done.stderr
    assert lab.cell.ask("truth")["placed"] is False  # nothing has opened
    assert lab.release("--activate").returncode == 0
    assert lab.release().returncode == 0  # it is active now


def test_hand_in_a_fault_says_which_and_is_opened_when_told_to_activate_it(lab: Lab) -> None:
    lab.leave_closed()
    lab.cell.ask("fault", name="gripper_fault", code=0x0E)
    done = lab.release()
    assert done.returncode == 4
    assert "the hand is not active (" in done.stderr
    assert lab.release("--activate").returncode == 0


def test_release_names_whoever_drives_the_gripper(lab: Lab) -> None:
    lab.leave_closed()
    with driving(gripper_of(lab.config)):
        done = lab.release()
    assert done.returncode == 4
    assert "is driven by process" in done.stderr
    assert "`kill " in done.stderr
    assert lab.release().returncode == 0


def test_dry_run_of_a_release_ends_as_the_release_would(lab: Lab) -> None:
    asleep = lab.release("--dry-run")
    assert asleep.returncode == lab.release().returncode == 4
    assert "the hand is not active: nothing was moved" in asleep.stderr
    activated = lab.release("--dry-run", "--activate")
    assert activated.returncode == 0
    assert "would activate the gripper at" in activated.stdout
    assert lab.cell.ask("truth")["placed"] is False  # nothing has opened
    lab.leave_closed()
    with driving(gripper_of(lab.config)):
        driven = lab.release("--dry-run")
    assert driven.returncode == 4
    assert "is driven by process" in driven.stderr
    dry = lab.release("--dry-run")
    assert dry.returncode == 0, dry.stderr
    assert "would open the fingers of the gripper at" in dry.stdout
    assert lab.cell.ask("motion")["fingers_mps"] == 0.0


def test_run_on_a_driven_cell_is_refused_before_anything_is_opened(
    lab: Lab, tmp_path: Path
) -> None:
    with driving(gripper_of(lab.config)):
        done = subprocess.run(
            [*GRASP, "run", "lift", "--rig", "hardware", "--confirm-motion", "--config",
             str(lab.file), "--runs", str(tmp_path / "runs")],
            env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=60,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    assert done.returncode == 4
    assert "is driven by process" in done.stderr
    assert lab.cell.ask("truth")["placed"] is False
    assert not any((tmp_path / "runs").iterdir())


def test_hand_that_is_left_closed_is_told_with_the_whole_command(lab: Lab, tmp_path: Path) -> None:
    lab.leave_closed()
    config = lab.config
    done = subprocess.run(
        [*GRASP, "run", "lift", "--rig", "hardware", "--confirm-motion", "--config",
         str(lab.file), "--runs", str(tmp_path / "runs"), "--set",
         f"modbus.port={config.modbus.port}"],
        env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=60,
        input="\n\n\n",
    )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "the hand is not open, at (" in done.stderr
    way_out = f"`{lab.command} --set modbus.port={config.modbus.port}`"
    assert f"to let go, support the object and run {way_out}" in done.stderr
