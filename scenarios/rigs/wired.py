"""Real drivers on real wires: at a lab's addresses, or at those of a cell in another process."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from drivers.errors import LinkLost
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.link.modbus import ModbusTransport
from drivers.robotiq.link.thread import ThreadedGripper
from drivers.robotiq.link.timing import TimedTransport
from drivers.robotiq.protocol import GripperCalibration
from drivers.takktile.emulator.bus import backend
from drivers.takktile.link.reader import TactileReader
from drivers.takktile.link.usb import UsbLink
from drivers.ur.driver import ArmDriver
from drivers.ur.link.client import UrLink
from grasp.clock import WallClock
from grasp.loop import Devices
from scenarios.rigs.cell_control import ControlClient
from scenarios.rigs.config import RunConfig
from scenarios.rigs.rig import Stalls
from scenarios.world.cell import Blow, Truth

READY_S = 60.0  # compiling the world on a first run included
POLL_NS = 100_000_000
END_S = 10.0


class CellProcess:
    """The child, its endpoints, and its control channel. Ends when this process does."""

    def __init__(
        self, config: msgspec.Struct, seed: int, module: str = "scenarios.rigs.emulated_cell"
    ) -> None:
        # -P: a folder called `drivers` where the user happens to stand must not shadow ours
        home = str(Path(__file__).parents[2])
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", module],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": home},
        )  # fmt: skip
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
            self.control = ControlClient(control["host"], control["port"])
        except BaseException:
            self.close()
            raise

    def truth(self) -> Truth:
        """The state of the world now."""
        return msgspec.convert(self.control.ask("truth")["truth"], Truth)

    def tap(self, blow: Blow) -> None:
        """Strike the object."""
        self.control.ask("tap", **msgspec.to_builtins(blow))

    def load(self, config: RunConfig, seed: int) -> None:
        """Another trial's object; it is put in place as soon as the hand is open."""
        self.control.ask("load", config=msgspec.to_builtins(config), seed=seed)

    def stalls(self) -> Stalls:
        """How often, and how long at worst, the cell stood still."""
        reply = self.control.ask("truth")
        return Stalls(reply["stalls"], reply["worst_stall_ms"])

    def close(self) -> None:
        if hasattr(self, "control"):
            self.control.close()
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                stream.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


@contextmanager
def cell_process(config: RunConfig, seed: int) -> Iterator[CellProcess]:
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


def at_endpoints(config: RunConfig, endpoints: dict[str, Any]) -> RunConfig:
    """The configuration with the addresses of a cell in place of the lab's."""
    replace = msgspec.structs.replace
    gripper = endpoints["gripper"]
    return replace(
        config,
        modbus=replace(config.modbus, host=gripper["host"], port=gripper["port"]),
        usb=replace(config.usb, url=endpoints["tactile"]["url"]),
        ur=replace(config.ur, host=endpoints["arm"]["host"]),
    )


@contextmanager
def wired_devices(
    config: RunConfig, calibration: GripperCalibration, clock: WallClock
) -> Iterator[Devices]:
    """Drivers on real wires, at the addresses of the configuration. Raises what opening raises."""
    now: Callable[[], int] = lambda: clock.now_ns  # noqa: E731
    modbus = ModbusTransport(config.modbus, config.gripper.link)
    timed = TimedTransport(modbus, now)
    core = RobotiqDriver(timed, config.gripper, calibration)
    bus = backend(config.usb.url) if config.usb.url else None
    find = partial(UsbLink.find, backend=bus, clock=now)
    with (
        ThreadedGripper(
            core, 1 / config.gripper.refresh_hz, timed=timed,
            write_interval_s=config.gripper.write_interval_s, close=modbus.close, clock=now,
        ) as gripper,
        TactileReader(find, config.tactile, now) as tactile,
        UrLink(config.ur) as link,
    ):  # fmt: skip
        yield Devices(gripper=gripper, arm=ArmDriver(link, config.arm), tactile=tactile)


def acknowledgements(devices: Devices) -> Callable[[], Sequence[int]]:
    """Latencies from verb to acknowledged write since now, ns."""
    gripper = devices.gripper
    assert isinstance(gripper, ThreadedGripper)  # noqa: S101
    before = len(gripper.acknowledgements_ns)
    return lambda: gripper.acknowledgements_ns[before:]
