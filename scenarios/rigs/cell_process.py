"""A cell in another process: its start, where it is, what it is asked, its end."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from drivers.errors import LinkLost
from grasp.clock import WallClock
from scenarios.rigs import emulated_cell
from scenarios.rigs.cell_control import ControlClient
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, RigConfig
from scenarios.rigs.emulated_cell import CellOrder
from scenarios.rigs.rig import Stalls
from scenarios.world.settings import Blow
from scenarios.world.truth import PressedTruth, Truth

READY_S = 60.0  # compiling the world on a first run included
POLL_NS = 100_000_000
END_S = 3.0
ConfigT = TypeVar("ConfigT", bound=RigConfig)


class CellProcess:
    """The child, its endpoints, and its control channel. Ends when this process does."""

    def __init__(self, config: AnyRigConfig, seed: int) -> None:
        self._truth = Truth if isinstance(config, GraspRigConfig) else PressedTruth
        # -P: a folder called `drivers` where the user happens to stand must not shadow ours
        home = str(Path(__file__).parents[2])
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", emulated_cell.__name__],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            start_new_session=True,  # a terminal's Ctrl-C and hang-up are the run's affair
            env={**os.environ, "PYTHONPATH": home},
        )  # fmt: skip
        self._open = ExitStack()
        self._open.callback(self._end)
        try:
            assert self._child.stdin is not None and self._child.stdout is not None  # noqa: S101
            order = CellOrder.of(config, seed)
            self._child.stdin.write(msgspec.json.encode(order).decode() + "\n")
            self._child.stdin.flush()
            line = self._child.stdout.readline()
            if not line:
                raise LinkLost("the emulated cell did not start", "see its messages above")
            self.endpoints: dict[str, Any] = json.loads(line)
            control = self.endpoints["control"]
            self.control = self._open.enter_context(
                closing(ControlClient(control["host"], control["port"]))
            )
        except BaseException:
            self.close()
            raise

    def truth(self) -> Any:
        """The state of the world now: Truth of a grasp, PressedTruth of a pressed fingertip."""
        return msgspec.convert(self.control.ask("truth")["truth"], self._truth)

    def tap(self, blow: Blow) -> None:
        """Strike the object."""
        self.control.ask("tap", **msgspec.to_builtins(blow))

    def load(self, config: GraspRigConfig, seed: int) -> None:
        """Another trial's object; it is put in place as soon as the hand is open."""
        self.control.ask("load", **msgspec.to_builtins(CellOrder.of(config, seed)))

    def stalls(self) -> Stalls:
        """How often, and how long at worst, the cell stood still."""
        reply = self.control.ask("truth")
        return Stalls(reply["stalls"], reply["worst_stall_ms"])

    def close(self) -> None:
        self._open.close()

    def _end(self) -> None:
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                stream.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


@contextmanager
def cell_process(config: AnyRigConfig, seed: int) -> Iterator[CellProcess]:
    cell = CellProcess(config, seed)
    try:
        yield cell
    finally:
        cell.close()


def wait_placed(cell: CellProcess, clock: WallClock) -> None:
    """Until the cell has put the object between the fingers. Raises LinkLost when it never does."""
    end_ns = clock.now_ns + round(READY_S * 1e9)
    while not cell.control.ask("truth")["placed"]:
        if clock.now_ns > end_ns:
            raise LinkLost("the cell has not placed its object", "is the hand open? start again")
        clock.sleep_until_ns(clock.now_ns + POLL_NS)


def at_endpoints(config: ConfigT, endpoints: dict[str, Any]) -> ConfigT:
    """The configuration with the addresses of a cell in place of the lab's."""
    replace = msgspec.structs.replace
    config = replace(
        config,
        usb=replace(config.usb, url=endpoints["tactile"]["url"]),
        ur=replace(config.ur, host=endpoints["arm"]["host"]),
    )
    if isinstance(config, GraspRigConfig):
        at = endpoints["gripper"]
        return replace(config, modbus=replace(config.modbus, host=at["host"], port=at["port"]))
    return config
