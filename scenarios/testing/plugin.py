"""A pytest plugin: the emulated devices as fixtures, for any project that talks to such devices.

    def test_my_driver(emulated_gripper):
        client = ModbusTcpClient(emulated_gripper.host, port=emulated_gripper.port)

Installed with the project it is found by pytest itself. Loading it imports none of the drivers;
each fixture imports what it needs. Everything started ends with the test. See docs/testing.md.
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

ANSWER_S = 70.0  # a frozen arm answers when it has thawed, after a minute at most
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
        """Plan trouble for coming requests: a name of ``FaultKind``, arguments of ``WireFault``.

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
        """A pyusb back end on whose bus there is this board alone."""
        from drivers.takktile.emulator.bus import backend  # noqa: PLC0415

        return backend(self.url)

    def press(self, row: int, column: int, counts: int) -> None:
        """Load one taxel: its code falls by so many counts from rest; 0 lets go."""
        with self._lock:
            self._codes[row, column] = REST_CODE - counts

    def fault(self, name: str, *arguments: int) -> None:
        """One of ``BOARD_FAULTS`` with its arguments, such as ``("time_out", 3)``: three reads."""
        if name not in BOARD_FAULTS:
            raise ValueError(f"unknown fault {name!r}: one of {', '.join(BOARD_FAULTS)}")
        with self._lock:
            getattr(self.model, name)(*arguments)


class EmulatedArm:
    """A UR10 (CB3) in a process of its own: RTDE, dashboard and script ports at ``host``."""

    def __init__(self) -> None:
        """Raises OSError when it does not start on any of several addresses."""
        for _ in range(ADDRESS_TRIES):
            self.host = _some_address()
            self._process = _start_arm(self.host)
            assert self._process.stdout is not None  # noqa: S101
            line = self._process.stdout.readline()
            if line:
                self.fault_port: int = json.loads(line)["fault_port"]
                return
            self.close()
        raise OSError(f"no emulated arm in {ADDRESS_TRIES} tries: see its messages above")

    def fault(self, name: str, **arguments: Any) -> None:
        """A verb of ``drivers.ur.emulator.dashboard``; raises ValueError when it is refused."""
        self._ask(do=name, **arguments)

    def state(self) -> dict[str, Any]:
        """Position, modes and messages, as the emulator knows them."""
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

    # -P: a folder called `drivers` where the user happens to stand must not shadow ours
    assert emulator.__spec__ is not None  # noqa: S101  (it was imported)
    command = [sys.executable, "-P", "-m", emulator.__spec__.name, "--host", host]
    home = str(Path(__file__).parents[2])
    return subprocess.Popen(
        [*command, "--unlock-delay", "0"], stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": home},
    )  # fmt: skip


def _some_address() -> str:
    """A loopback address; hardly ever one that is in use."""
    return "127." + ".".join(str(random.randint(2, 254)) for _ in range(3))


class CellFixture:
    """Gripper, board and arm around one simulated object, in a process of their own."""

    def __init__(self, process: "CellProcess") -> None:
        self._process = process
        self.endpoints = process.endpoints

    def truth(self) -> "Truth":
        """What only a simulation knows: forces, slip, height of the object."""
        truth: Truth = self._process.truth()
        return truth

    def place(self) -> None:
        """Put the object between the fingers again."""
        self._process.control.ask("place")

    def press(self, finger: str, taxel: int, newtons: float = 1.0, seconds: float = 1.0) -> None:
        """A person's finger on one pad of the hand, which must be open."""
        self._process.control.ask(
            "press", finger=finger, taxel=taxel, newtons=newtons, seconds=seconds
        )

    def fault(self, name: str, **arguments: Any) -> None:
        """A fault of ``rigs.cell_faults.CellFaults``; raises ValueError when it is refused."""
        self._process.control.ask("fault", name=name, **arguments)


@pytest.fixture
def emulated_gripper() -> Iterator[EmulatedGripper]:
    """A gripper on Modbus TCP, activated within half a second."""
    from drivers.robotiq.emulator import GripperEmulator  # noqa: PLC0415
    from drivers.robotiq.model.gripper import HandSettings  # noqa: PLC0415

    with GripperEmulator(HandSettings(activation_s=0.5), _some_address()) as emulator:
        yield EmulatedGripper(emulator)


@pytest.fixture
def emulated_board() -> Iterator[EmulatedBoard]:
    """A fingertip board behind pyusb."""
    import numpy as np  # noqa: PLC0415

    from drivers.takktile.emulator.server import BoardServer  # noqa: PLC0415
    from drivers.takktile.model.board import BoardModel, BoardModelSettings  # noqa: PLC0415

    codes = np.full((3, 6), REST_CODE, np.int16)
    warm = np.full(codes.size, 500, np.int16)
    lock = threading.Lock()
    model = BoardModel(BoardModelSettings(), lambda t_ns: lambda: (codes.ravel().copy(), warm))
    with BoardServer(model, lock, _some_address()) as server:
        yield EmulatedBoard(server, model, lock, codes)


@pytest.fixture
def emulated_arm() -> Iterator[EmulatedArm]:
    """A UR10 controller on a loopback address of its own."""
    with closing(EmulatedArm()) as arm:
        yield arm


@pytest.fixture
def emulated_cell_settings() -> tuple[str, ...]:
    """Assignments ``section.key=value`` for ``emulated_cell``; override it to change them."""
    return ("hand.activation_s=0.5",)


@pytest.fixture
def emulated_cell(emulated_cell_settings: tuple[str, ...]) -> Iterator[CellFixture]:
    """All three devices around one can, in one process, each on a real wire."""
    from scenarios.campaign.config import load_config  # noqa: PLC0415
    from scenarios.rigs.emulated import cell_process  # noqa: PLC0415

    config = load_config("can", "emulated", "energy", None, emulated_cell_settings)
    with cell_process(config, seed=0) as process:
        yield CellFixture(process)
