"""A pytest plugin with the emulated devices as fixtures, for any project with such devices.

    def test_my_driver(emulated_gripper):
        client = ModbusTcpClient(emulated_gripper.host, port=emulated_gripper.port)

pytest finds it when the project is installed. Loading it imports no driver; each fixture imports
what it needs, and stops what it started. See docs/testing.md.
"""

import json
import os
import random
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from drivers.robotiq.emulator import GripperEmulator
    from drivers.takktile.emulator.bus import EmulatedBus
    from drivers.takktile.emulator.server import BoardServer
    from drivers.takktile.model.board import BoardModel
    from scenarios.rigs.emulated import CellProcess
    from scenarios.world.truth import Truth

ANSWER_S = 70.0  # a frozen arm answers after its freeze, which lasts a minute at most
END_S = 10.0
ADDRESS_TRIES = 10
REST_CODE = 450  # of an unloaded taxel

BOARD_FAULTS = (
    "unplug", "replug", "time_out", "stall", "shorten_frame", "split_frame", "kill_column",
)  # fmt: skip


class EmulatedGripper:
    """A Robotiq 3-Finger Gripper on Modbus TCP. Not yet activated, as after power-up."""

    unit = 2

    def __init__(self, emulator: "GripperEmulator") -> None:
        self.emulator = emulator
        self.host, self.port = emulator.address

    def fault(self, name: str, **arguments: Any) -> None:
        """Inject a fault into later requests: a name of ``FaultKind``, arguments of ``WireFault``.

        Raises ValueError for an unknown name, TypeError for an unknown argument.
        """
        from drivers.robotiq.emulator import FaultKind, WireFault  # noqa: PLC0415

        self.emulator.faults.add(WireFault(kind=FaultKind(name), **arguments))


class EmulatedBoard:
    """A TakkTile USB board of 3 x 6 taxels; ``backend()`` is for ``usb.core.find``."""

    def __init__(
        self, server: "BoardServer", model: "BoardModel", lock: Any, codes: "NDArray[np.int16]"
    ) -> None:
        self.server = server
        self.model = model
        self._lock = lock
        self._codes = codes

    @property
    def url(self) -> str:
        return self.server.url

    def backend(self) -> "EmulatedBus":
        """A pyusb back end whose bus has only this board."""
        from drivers.takktile.emulator.bus import backend  # noqa: PLC0415

        return backend(self.url)

    def press(self, row: int, column: int, counts: int) -> None:
        """Press one taxel: its code falls by ``counts`` from rest; 0 releases it."""
        with self._lock:
            self._codes[row, column] = REST_CODE - counts

    def fault(self, name: str, *arguments: int) -> None:
        """Inject one of ``BOARD_FAULTS``, such as ``("time_out", 3)`` for three reads. Raises
        ValueError for an unknown name."""
        if name not in BOARD_FAULTS:
            raise ValueError(f"unknown fault {name!r}: one of {', '.join(BOARD_FAULTS)}")
        with self._lock:
            getattr(self.model, name)(*arguments)


class EmulatedArm:
    """A UR10 (CB3) in a separate process: RTDE, dashboard and script ports at ``host``."""

    def __init__(self) -> None:
        """Raises OSError if it starts on none of several addresses."""
        for _ in range(ADDRESS_TRIES):
            self.host = _some_address()
            self._process = _start_arm(self.host)
            assert self._process.stdout is not None  # noqa: S101
            line = self._process.stdout.readline()
            if line:
                self.fault_port: int = json.loads(line)["fault_port"]
                return
            self.close()
        raise OSError(
            f"the emulated arm failed on {ADDRESS_TRIES} addresses: see its messages above"
        )

    def fault(self, name: str, **arguments: Any) -> None:
        """Inject a fault of ``drivers.ur.emulator.dashboard``; raises ValueError if it is
        refused."""
        self._ask(do=name, **arguments)

    def state(self) -> dict[str, Any]:
        """Position, modes and messages of the emulator."""
        return self._ask(do="state")

    def _ask(self, **request: Any) -> dict[str, Any]:
        address = (self.host, self.fault_port)
        with socket.create_connection(address, ANSWER_S) as sock, sock.makefile("rw") as lines:
            lines.write(json.dumps(request) + "\n")
            lines.flush()
            answer: dict[str, Any] = json.loads(lines.readline())
        if not answer.pop("ok"):
            raise ValueError(answer["error"])
        return answer

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


def _start_arm(host: str) -> subprocess.Popen[str]:
    from drivers.ur import emulator  # noqa: PLC0415

    # -P: a folder named `drivers` in the working directory must not shadow this package
    assert emulator.__spec__ is not None  # noqa: S101  (an imported module has one)
    command = [sys.executable, "-P", "-m", emulator.__spec__.name, "--host", host]
    home = str(Path(__file__).parents[2])
    return subprocess.Popen(
        [*command, "--unlock-delay", "0"], stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": home},
    )  # fmt: skip


def _some_address() -> str:
    """A random loopback address, very likely unused."""
    return "127." + ".".join(str(random.randint(2, 254)) for _ in range(3))


class CellFixture:
    """Gripper, board and arm around one simulated object, in a separate process."""

    def __init__(self, process: "CellProcess") -> None:
        self._process = process
        self.endpoints = process.endpoints

    def truth(self) -> "Truth":
        """The simulated truth: forces, slip and height of the object."""
        truth: Truth = self._process.truth()
        return truth

    def place(self) -> None:
        """Put the object between the fingers again."""
        self._process.control.ask("place")

    def press(self, finger: str, taxel: int, newtons: float = 1.0, seconds: float = 1.0) -> None:
        """Press one taxel with an external force; the hand must be open."""
        self._process.control.ask(
            "press", finger=finger, taxel=taxel, newtons=newtons, seconds=seconds
        )

    def fault(self, name: str, **arguments: Any) -> None:
        """Inject a fault of ``rigs.cell_faults.CellFaults``; raises ValueError if it is refused."""
        self._process.control.ask("fault", name=name, **arguments)


@pytest.fixture
def emulated_gripper() -> Iterator[EmulatedGripper]:
    """A gripper on Modbus TCP, whose activation takes half a second."""
    from drivers.robotiq.emulator import GripperEmulator  # noqa: PLC0415
    from drivers.robotiq.model.gripper import HandSettings  # noqa: PLC0415

    with GripperEmulator(HandSettings(activation_s=0.5), _some_address()) as emulator:
        yield EmulatedGripper(emulator)


@pytest.fixture
def emulated_board() -> Iterator[EmulatedBoard]:
    """A fingertip board behind pyusb."""
    import numpy as np  # noqa: PLC0415

    from drivers.takktile.emulator.server import BoardServer  # noqa: PLC0415
    from drivers.takktile.model.board import CONVERTER_MAX, BoardModel  # noqa: PLC0415
    from drivers.takktile.settings import BoardModelSettings  # noqa: PLC0415

    codes = np.full((3, 6), REST_CODE, np.int16)
    warm = np.full(codes.size, 500, np.int16)
    lock = threading.Lock()
    model = BoardModel(
        BoardModelSettings(), lambda t_ns: lambda: (codes.clip(0, CONVERTER_MAX).ravel(), warm)
    )
    with BoardServer(model, lock, _some_address()) as server:
        yield EmulatedBoard(server, model, lock, codes)


@pytest.fixture
def emulated_arm() -> Iterator[EmulatedArm]:
    """A UR10 controller on its own loopback address."""
    with closing(EmulatedArm()) as arm:
        yield arm


@pytest.fixture
def emulated_cell_settings() -> tuple[str, ...]:
    """Assignments ``section.key=value`` for ``emulated_cell``; override it to change them."""
    return ("hand.activation_s=0.5",)


@pytest.fixture
def emulated_cell(emulated_cell_settings: tuple[str, ...]) -> Iterator[CellFixture]:
    """All three devices around one can, in one process, each with its real protocol."""
    from scenarios.campaign.config import load_config  # noqa: PLC0415
    from scenarios.rigs.emulated import cell_process  # noqa: PLC0415

    config = load_config("can", "emulated", "energy", None, emulated_cell_settings)
    with cell_process(config, seed=0) as process:
        yield CellFixture(process)
