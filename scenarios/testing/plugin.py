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
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
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


class Later:
    """Actions put off; those still outstanding are forgotten at the end."""

    def __init__(self) -> None:
        self._timers: list[threading.Timer] = []

    def do(self, after_s: float, action: Callable[[], object]) -> None:
        """At once without a delay, in a thread of its own otherwise."""
        if after_s <= 0.0:
            action()
            return
        timer = threading.Timer(after_s, action)
        self._timers.append(timer)
        timer.start()

    def close(self) -> None:
        for timer in self._timers:
            timer.cancel()
        for timer in self._timers:
            timer.join(END_S)


class EmulatedGripper:
    """A Robotiq 3-Finger Gripper on Modbus TCP. Not yet activated, as after power-up."""

    unit = 2

    def __init__(self, emulator: "GripperEmulator") -> None:
        self.emulator = emulator
        self.host, self.port = emulator.address

    def fault(self, name: str, *, after_s: float = 0.0, **arguments: Any) -> None:
        """Plan trouble for coming requests: a name of ``Trouble``, arguments of ``WireFault``.

        Raises ValueError for an unknown name, TypeError for an unknown argument.
        """
        from drivers.robotiq.emulator import Trouble, WireFault  # noqa: PLC0415

        from_ns = time.monotonic_ns() + round(after_s * 1e9)
        self.emulator.faults.add(WireFault(trouble=Trouble(name), from_ns=from_ns, **arguments))


class EmulatedBoard:
    """A TakkTile USB board of 3 x 6 taxels; ``backend()`` is for ``usb.core.find``."""

    def __init__(
        self, server: "BoardServer", model: "BoardModel", lock: Any, codes: "NDArray[np.int16]"
    ) -> None:
        self.server = server
        self.model = model
        self._lock = lock
        self._codes = codes
        self._later = Later()

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

    def fault(self, name: str, *arguments: int, after_s: float = 0.0) -> None:
        """One of ``BOARD_FAULTS`` with its arguments, such as ``("time_out", 3)``: three reads."""
        if name not in BOARD_FAULTS:
            raise ValueError(f"unknown fault {name!r}: one of {', '.join(BOARD_FAULTS)}")
        self._later.do(after_s, lambda: self._strike(name, arguments))

    def _strike(self, name: str, arguments: tuple[int, ...]) -> None:
        with self._lock:
            getattr(self.model, name)(*arguments)

    def close(self) -> None:
        self._later.close()


class EmulatedArm:
    """A UR10 (CB3) in a process of its own: RTDE, dashboard and script ports at ``host``."""

    def __init__(self) -> None:
        """Raises OSError when it does not start on any of several addresses."""
        self._later = Later()
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

    def fault(self, name: str, *, after_s: float = 0.0, **arguments: Any) -> None:
        """A verb of ``drivers.ur.emulator.dashboard``; raises ValueError when it is refused."""
        self._later.do(after_s, lambda: self._ask(do=name, **arguments))

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
        self._later.close()
        self._process.terminate()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


def _start_arm(host: str) -> subprocess.Popen[str]:
    from drivers.ur import emulator  # noqa: PLC0415  # noqa: PLC0415

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
    with ExitStack() as stack:
        server = stack.enter_context(BoardServer(model, lock, _some_address()))
        board = EmulatedBoard(server, model, lock, codes)
        stack.callback(board.close)
        yield board


@pytest.fixture
def emulated_arm() -> Iterator[EmulatedArm]:
    """A UR10 controller on a loopback address of its own."""
    arm = EmulatedArm()
    try:
        yield arm
    finally:
        arm.close()


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
