"""A cell in another process: its start, where it is, what it is asked, its end."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec

from drivers.errors import LinkLost
from grasp.clock import WallClock
from scenarios.rigs import emulated_cell
from scenarios.rigs.cell_control import ControlClient
from scenarios.rigs.config import GraspRigConfig, part
from scenarios.rigs.rig import Stalls
from scenarios.world.cell import Blow, Truth

READY_S = 60.0  # compiling the world on a first run included
POLL_NS = 100_000_000
END_S = 10.0


class CellProcess:
    """The child, its endpoints, and its control channel. Ends when this process does."""

    def __init__(
        self, config: msgspec.Struct, seed: int, program: ModuleType = emulated_cell
    ) -> None:
        # -P: a folder called `drivers` where the user happens to stand must not shadow ours
        home = str(Path(__file__).parents[2])
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", program.__name__],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": home},
        )  # fmt: skip
        self._open = ExitStack()
        self._open.callback(self._end)
        try:
            assert self._child.stdin is not None and self._child.stdout is not None  # noqa: S101
            order = {"config": msgspec.to_builtins(config), "seed": seed}
            self._child.stdin.write(json.dumps(order) + "\n")
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

    def truth(self) -> Truth:
        """The state of the world now."""
        return msgspec.convert(self.control.ask("truth")["truth"], Truth)

    def tap(self, blow: Blow) -> None:
        """Strike the object."""
        self.control.ask("tap", **msgspec.to_builtins(blow))

    def load(self, config: GraspRigConfig, seed: int) -> None:
        """Another trial's object; it is put in place as soon as the hand is open."""
        self.control.ask(
            "load", config=msgspec.to_builtins(part(config, GraspRigConfig)), seed=seed
        )

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
def cell_process(config: GraspRigConfig, seed: int) -> Iterator[CellProcess]:
    cell = CellProcess(part(config, GraspRigConfig), seed)
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


def at_endpoints(config: GraspRigConfig, endpoints: dict[str, Any]) -> GraspRigConfig:
    """The configuration with the addresses of a cell in place of the lab's."""
    replace = msgspec.structs.replace
    gripper = endpoints["gripper"]
    return replace(
        config,
        modbus=replace(config.modbus, host=gripper["host"], port=gripper["port"]),
        usb=replace(config.usb, url=endpoints["tactile"]["url"]),
        ur=replace(config.ur, host=endpoints["arm"]["host"]),
    )
