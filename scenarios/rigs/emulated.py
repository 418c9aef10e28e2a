"""The emulated rig: real drivers over real protocols to a cell in another process, in wall time."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from drivers.errors import LinkLost
from drivers.ur.link.preflight import require_ur_rtde
from grasp.files import use_writable_cache
from grasp.run.clock import WallClock
from scenarios.rigs.cell_order import CellOrder
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, RigConfig
from scenarios.rigs.rig import Rig, Stalls, connect
from scenarios.rigs.wired import acknowledgements, wired_devices
from scenarios.world.settings import Impact
from scenarios.world.truth import PressedTruth, Truth

CELL_PROGRAM = Path(__file__).with_name("emulated_cell.py")  # imported only in its process
READY_S = 60.0  # includes compiling the world on a first run
ANSWER_S = 60.0  # timeout of a reply from a cell on a busy machine
POLL_NS = 100_000_000
END_S = 3.0
OPEN_MPS = 0.05
ConfigT = TypeVar("ConfigT", bound=RigConfig)
replace = msgspec.structs.replace


@contextmanager
def emulated(config: AnyRigConfig, seed: int) -> Iterator[Rig[Any, Any]]:
    """Open the emulated rig with the object in place; closes it at the end."""
    require_ur_rtde()  # before the cell starts, which takes a while
    with cell_process(config, seed) as cell:
        clock = WallClock(cell.endpoints["start_ns"])
        with wired_devices(at_endpoints(config, cell.endpoints), clock) as (arm, tactile, gripper):
            connect(arm, tactile, gripper, clock)
            arm.set_payload(config.arm.payload_kg)
            cell.wait_placed(clock)

            def load(trial: GraspRigConfig, seed: int) -> None:
                cell.load(trial, seed)
                if gripper is not None and (gripper.state is None or not gripper.state.is_open):
                    gripper.open(OPEN_MPS)  # it is closed after a lift that lost its object
                cell.wait_placed(clock)

            rig: Rig[Any, Any] = Rig(
                arm, tactile, gripper, clock, True, None, cell.truth, cell.stalls,
                acknowledgements(gripper),
            )  # fmt: skip
            yield rig if gripper is None else replace(rig, tap=cell.tap, load=load)


class ControlClient:
    """Client of the cell's control channel. Raises LinkLost when the cell has ended, ValueError
    when it refuses a request."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), ANSWER_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._stream = self._socket.makefile("rwb")

    def ask(self, verb: str, **more: Any) -> dict[str, Any]:
        try:
            self._stream.write(json.dumps({"verb": verb, **more}).encode() + b"\n")
            self._stream.flush()
            line = self._stream.readline()
        except OSError as error:
            raise _cell_lost(str(error)) from None
        if not line:
            raise _cell_lost("the cell closed the connection")
        reply: dict[str, Any] = json.loads(line)
        if "error" in reply:
            raise ValueError(reply["error"])
        return reply

    def close(self) -> None:
        self._stream.close()
        self._socket.close()


def _cell_lost(cause: str) -> LinkLost:
    return LinkLost(f"connection to the emulated cell lost: {cause}", "start the run again")


class CellProcess:
    """The cell's process with its endpoints and control channel; it ends with this process."""

    def __init__(self, config: AnyRigConfig, seed: int) -> None:
        self._truth = Truth if isinstance(config, GraspRigConfig) else PressedTruth
        # -P: a folder called `drivers` in the working directory must not shadow the package
        home = str(Path(__file__).parents[2])
        use_writable_cache()
        self._child = subprocess.Popen(
            [sys.executable, "-P", str(CELL_PROGRAM)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            start_new_session=True,  # only the run handles a terminal's Ctrl-C and hang-up
            env={**os.environ, "PYTHONPATH": home},
        )  # fmt: skip
        with ExitStack() as stack:
            stack.callback(self._end)
            assert self._child.stdin is not None and self._child.stdout is not None  # noqa: S101
            order = CellOrder.of(config, seed)
            self._child.stdin.write(msgspec.json.encode(order).decode() + "\n")
            self._child.stdin.flush()
            line = self._child.stdout.readline()
            if not line:
                raise LinkLost("the emulated cell did not start", "see its messages on stderr")
            self.endpoints: dict[str, Any] = json.loads(line)
            self.control = ControlClient(**self.endpoints["control"])
            stack.callback(self.control.close)
            self.close = stack.pop_all().close

    def truth(self) -> Any:
        """Current state of the world: Truth of a grasp, PressedTruth of a pressed fingertip."""
        return msgspec.convert(self.control.ask("truth")["truth"], self._truth)

    def tap(self, impact: Impact) -> None:
        """Strike the object."""
        self.control.ask("tap", **msgspec.to_builtins(impact))

    def load(self, config: GraspRigConfig, seed: int) -> None:
        """Load another trial's object; the cell places it once the hand is open."""
        self.control.ask("load", **msgspec.to_builtins(CellOrder.of(config, seed)))

    def wait_placed(self, clock: WallClock) -> None:
        """Wait until the cell has placed the object; raises LinkLost after READY_S."""
        end_ns = clock.now_ns + round(READY_S * 1e9)
        while not self.control.ask("truth")["placed"]:
            if clock.now_ns > end_ns:
                raise LinkLost(
                    f"the emulated cell did not place its object within {READY_S:g} s",
                    "open the hand and start again",
                )
            clock.sleep_until_ns(clock.now_ns + POLL_NS)

    def stalls(self) -> Stalls:
        """Number and longest duration of the cell's stalls."""
        reply = self.control.ask("truth")
        return Stalls(reply["stalls"], reply["worst_stall_ms"])

    def _end(self) -> None:
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                stream.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def cell_process(config: AnyRigConfig, seed: int) -> AbstractContextManager[CellProcess]:
    return closing(CellProcess(config, seed))


def at_endpoints(config: ConfigT, endpoints: dict[str, Any]) -> ConfigT:
    """The configuration with the addresses of a cell."""
    config = replace(
        config,
        usb=replace(config.usb, url=endpoints["tactile"]["url"]),
        ur=replace(config.ur, host=endpoints["arm"]["host"]),
    )
    if isinstance(config, GraspRigConfig):
        at = endpoints["gripper"]
        return replace(config, modbus=replace(config.modbus, host=at["host"], port=at["port"]))
    return config
