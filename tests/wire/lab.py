"""An emulated lab: a cell, the settings with its addresses, and `grasp` commands on it.

One cell serves all tests of a worker and is reset between them (`Lab.reset`). Commands run in this
process, which saves a second of imports each; those that a signal ends run in their own process.
"""

import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.protocol import AxisCommand, CommandRegisters, StatusRegisters
from grasp.cli.main import main
from grasp.run.clock import WallClock
from grasp.settings import config_dir
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.device_checks import read_gripper
from scenarios.rigs.emulated import ControlClient
from scenarios.rigs.wired import open_arm
from tests.calibrations import OF_A_LAB
from tests.wire.waiting import PATIENCE_S, until

ROOT = Path(__file__).parents[2]
GRASP = [sys.executable, "-c", "import sys; from grasp.cli.main import main; sys.exit(main())"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
QUICK = (
    "hand.activation_s=0.1", "controller.hold_s=0.3", "controller.lift_height_m=0.08",
    "controller.lower_speed_mps=0.2", "controller.settle_s=0.2", "controller.baseline_s=0.2",
)  # fmt: skip
OPEN = 10  # counts
CONFIRMED = ("--confirm-motion",)
ALONE = ("--unattended",)  # of a lift: its tests have no terminal
HARDWARE = ("--rig", "hardware")


def sets(assignments: Sequence[str] = QUICK) -> list[str]:
    return [word for assignment in assignments for word in ("--set", assignment)]


class CommandResult(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


class _OperatorStderr(io.StringIO):
    """Standard error on which an operator replies to each question."""

    def __init__(self, operator: Callable[[str], str | None], typed: int) -> None:
        super().__init__()
        self._operator, self._typed, self._line = operator, typed, ""

    def write(self, text: str) -> int:
        *lines, self._line = (self._line + text).split("\n")
        written = super().write(text)
        for line in lines:
            question = line.removeprefix(">>> ")
            is_question = question != line and any(w in line for w in ("type", "Enter", "?"))
            if is_question and (reply := self._operator(question)) is not None:
                os.write(self._typed, f"{reply}\n".encode())
        return written


def grasp(*words: str, operator: Callable[[str], str | None] | None = None) -> CommandResult:
    """Run a command in this process. ``operator``: reply to a question, None for no reply; without
    an operator standard input is closed."""
    reads, types = os.pipe()
    out = io.StringIO()
    err = io.StringIO() if operator is None else _OperatorStderr(operator, types)
    if operator is None:
        os.close(types)
    try:
        with (
            os.fdopen(reads) as stdin, patch.object(sys, "stdin", stdin),
            redirect_stdout(out), redirect_stderr(err),
        ):  # fmt: skip
            code = main(list(words))
    finally:
        if operator is not None:
            os.close(types)
    return CommandResult(code, out.getvalue(), err.getvalue())


@contextmanager
def started(*words: str, **options: Any) -> Iterator["subprocess.Popen[str]"]:
    """A command in its own process, killed at the end at the latest."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(
        [*GRASP, *words], env=ENVIRONMENT, text=True, **{**pipes, **options}
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def emulate(*words: str) -> Iterator[dict[str, Any]]:
    """`grasp emulate` in its own process; gives the addresses of its devices."""
    with started("emulate", *sets(), *words, stderr=None) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0


def lab_file(path: Path, endpoints: dict[str, Any]) -> Path:
    """Write the settings of a lab, with the timeouts of the rig `emulated`."""
    hand = path.with_name("paper.toml")
    hand.write_text(OF_A_LAB)
    gripper = endpoints["gripper"]
    text = (config_dir() / "rigs" / "emulated.toml").read_text(encoding="utf-8")
    for section, lines in (
        ("modbus", f'host = "{gripper["host"]}"\nport = {gripper["port"]}\n'),
        ("ur", f'host = "{endpoints["arm"]["host"]}"\n'),
    ):
        text = text.replace(f"[{section}]\n", f"[{section}]\n{lines}")
    text = text.replace('calibration = "paper"', f'calibration = "{hand}"')
    text += "[guard]\ncounts_per_newton = [160, 160, 160]\n"
    path.write_text(f'{text}[usb]\nurl = "{endpoints["tactile"]["url"]}"\n', encoding="utf-8")
    return path


class Lab:
    """A cell, its settings file, commands on it, and its state."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        self.endpoints = endpoints
        self.file = lab_file(folder / "lab.toml", endpoints)
        self.config: RunConfig = load_config("can", "hardware", "energy", self.file)
        self.cell = ControlClient(endpoints["control"]["host"], endpoints["control"]["port"])
        self.ask = self.cell.ask

    def reset(self) -> None:
        """Restore the state after the start of `grasp emulate`, without the object."""
        self.ask("fault", name="replug")
        self.ask("fault", name="gripper_fault", code=0)
        self.ask("fault", name="speed_slider", fraction=1.0)
        self.dashboard("stop")
        self.ask("take")
        self._open()
        self.write(CommandRegisters())
        until(lambda: not self.hand.active, "the hand is reset")
        until(lambda: not self.ask("home")["away_m"], "the arm is at its start pose")

    def activate_hand(self) -> None:
        """Activate the hand, which is open."""
        self.write(CommandRegisters(activate=True))
        until(lambda: self.hand.ready, "the hand is active")

    def _open(self) -> None:
        """Open the hand from any mode or fault. The short activation moves no finger far."""
        hand = self.hand
        if max(self.positions) < OPEN and not hand.mode and not hand.fault:
            return
        self.write(CommandRegisters())
        until(lambda: not self.hand.active, "the hand is reset")
        self.activate_hand()
        self.write(CommandRegisters(activate=True, go_to=True, a=AxisCommand(0, 255, 0)))
        until(lambda: max(self.positions) < OPEN, "the hand is open")

    def grasp(
        self, *words: str, operator: Callable[[str], str | None] | None = None
    ) -> CommandResult:
        return grasp(*words, "--config", str(self.file), operator=operator)

    def run_confirmed(self, *words: str) -> str:
        """Output of a successful command with --confirm-motion; repeated while recently pressed
        rubber still creeps back."""
        results: list[CommandResult] = []

        def is_steady() -> bool:
            results.append(self.grasp(*words, *CONFIRMED))
            return "unsteady at rest" not in results[-1].err

        until(is_steady)
        assert results[-1].code == 0, results[-1]
        return results[-1].out

    @contextmanager
    def started(self, *words: str, **options: Any) -> Iterator["subprocess.Popen[str]"]:
        with started(*words, "--config", str(self.file), **options) as process:
            yield process

    def dashboard(self, line: str) -> str:
        host = self.config.ur.host
        with socket.create_connection((host, 29999), PATIENCE_S) as sock, sock.makefile("rw") as f:
            f.readline()
            f.write(line + "\n")
            f.flush()
            return f.readline()

    def write(self, command: CommandRegisters) -> None:
        """Write a command to the hand, as any other program could."""
        with closing(ModbusTransport(self.config.modbus, self.config.gripper.link)) as link:
            link.write(0, command.to_registers(), time.monotonic_ns())

    @property
    def hand(self) -> StatusRegisters:
        return read_gripper(self.config)[1]

    @property
    def positions(self) -> tuple[int, ...]:
        return tuple(finger.position for finger in self.hand.fingers)

    @property
    def height_m(self) -> float:
        clock = WallClock()
        with open_arm(self.config, lambda: clock.now_ns) as arm:
            arm.poll(clock.now_ns)
            assert arm.state is not None
            return arm.state.position_m[2]
