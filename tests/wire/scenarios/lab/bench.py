"""A lab whose devices are an emulated cell."""

import subprocess
import time
from pathlib import Path
from typing import Any

from grasp.clock import WallClock
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.cell_control import ControlClient
from scenarios.rigs.device_checks import read_gripper
from scenarios.rigs.wired import open_arm
from tests.wire.scenarios.lab.terminal import grasp
from tests.wire.scenarios.test_rigs import lab_file

Counts = tuple[int, ...]
CONFIRMED = ("--confirm-motion",)


class Lab:
    """An emulated cell, the file that points at it, and what a person sees of it."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        self.file = lab_file(folder / "lab.toml", endpoints)
        self.cell = ControlClient(endpoints["control"]["host"], endpoints["control"]["port"])

    @property
    def config(self) -> RunConfig:
        return load_config("can", "hardware", "energy", self.file)

    def grasp(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return grasp(*words, "--config", str(self.file))

    def done(self, *words: str) -> str:
        return self.rested(*words, *CONFIRMED).stdout

    def rested(self, *words: str) -> "subprocess.CompletedProcess[str]":
        """Asked again while rubber that was pressed a moment ago still creeps back."""
        deadline = time.monotonic() + 60
        while "unsteady at rest" in (done := self.grasp(*words)).stderr:
            assert done.returncode == 4, done.stderr
            assert time.monotonic() < deadline, done.stderr
        assert done.returncode == 0, done.stderr
        return done

    @property
    def places(self) -> Counts:
        return tuple(finger.position for finger in read_gripper(self.config)[1].fingers)

    @property
    def height_m(self) -> float:
        clock = WallClock()
        with open_arm(self.config, lambda: clock.now_ns) as arm:
            arm.pump(clock.now_ns)
            assert arm.state is not None
            return arm.state.position_m[2]
