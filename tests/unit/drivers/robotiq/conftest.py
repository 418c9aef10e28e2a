"""Fixtures: a driver on a modelled hand in virtual time, with springs to close on, and a gripper
thread that is closed after each test."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from drivers.errors import LinkLost
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.link import ThreadedGripper
from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings, ModelTransport
from drivers.robotiq.model.hand import Command, decode
from drivers.robotiq.protocol import to_bytes
from drivers.robotiq.settings import DriverSettings
from tests.calibrations import MANUAL, PAPER
from tests.unit.drivers.robotiq.link_cell import FOR_EVER_S, NEVER_S, Cell, Made, wait_for_polls

MS = 1_000_000


class Springs:
    """A linear object in front of each finger: (3,) stiffness N/m and travel of first touch m."""

    def __init__(self, stiffness: Sequence[float], touch: Sequence[float]) -> None:
        self.stiffness = np.array(stiffness, dtype=float)
        self.touch = np.array(touch, dtype=float)

    def force_n(self, travel: np.ndarray) -> np.ndarray:
        return self.stiffness * (travel - self.touch)

    def loads(self, travel: np.ndarray) -> FingerLoads:
        return FingerLoads(self.force_n(travel), self.stiffness)


class Transport(ModelTransport):
    """The model's registers over a link that a test can break or corrupt."""

    def __init__(self, model: GripperModel) -> None:
        super().__init__(model)
        self.down = False
        self.write_lost = False
        self.garbage: list[Sequence[int]] = []

    def replace(self, model: GripperModel) -> None:
        """Another hand on the same wire, as after a power cycle."""
        super().__init__(model)

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None:
        if self.down:
            raise LinkLost("no answer", "check the cable")
        super().write(first_register, registers, now_ns)
        if self.write_lost:
            self.down = True
            raise LinkLost("no answer", "check the cable")

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]:
        if self.down:
            raise LinkLost("no answer", "check the cable")
        registers = super().read(first_register, count, now_ns)
        return self.garbage.pop() if self.garbage else registers


class Rig:
    """Driver polled at 100 Hz, model stepped at 1 kHz."""

    def __init__(
        self,
        hand: HandSettings,
        calibration: GripperCalibration,
        *,
        active: bool = True,
        settings: DriverSettings | None = None,
        springs: Springs | None = None,
    ) -> None:
        self.model = GripperModel(hand, 0, active=active)
        self.transport = Transport(self.model)
        self.written: list[Command] = []
        self.frames: list[str] = []  # the same, as hex
        self.written_ns: list[int] = []
        self.driver = RobotiqDriver(
            self.transport, settings or DriverSettings(), calibration, log=self._log,
            clock=lambda: self.now_ns,
        )  # fmt: skip
        self.springs = springs or Springs([0, 0, 0], [0, 0, 0])
        self.now_ns = 0
        self.peak_n = np.zeros(3)
        self.step()

    def _log(self, now_ns: int, registers: Sequence[int]) -> None:
        self.written.append(decode(registers))
        self.frames.append(to_bytes(registers).hex())
        self.written_ns.append(now_ns)

    @property
    def state(self):
        return self.driver.state

    def advance(self, ms: int) -> None:
        for _ in range(ms):
            self.now_ns += MS
            self.model.advance(self.now_ns, self.springs.loads(self.model.travel_m))
            self.peak_n = np.maximum(self.peak_n, self.springs.force_n(self.model.travel_m))

    def step(self, steps: int = 1) -> None:
        for _ in range(steps):
            self.advance(10)
            self.driver.poll(self.now_ns)

    def reply_late(self, ms: int) -> None:
        """Do an exchange whose reply arrives so much later, with the state of that time."""
        requested_ns, read = self.now_ns, self.transport.read

        def late(first_register: int, count: int, now_ns: int) -> Sequence[int]:
            self.advance(ms)
            return read(first_register, count, self.now_ns)

        self.transport.read = late
        self.driver.poll(requested_ns)
        self.transport.read = read

    def settle(self, limit: int = 1000) -> None:
        """Poll until all fingers are at rest; fails after ``limit`` polls."""
        for _ in range(limit):
            self.step()
            if self.state.at_rest and not self.model.moving:
                return
        raise AssertionError("the hand did not come to rest")


@pytest.fixture
def rig():
    def make(
        hand: HandSettings | None = None,
        calibration: str = "paper",
        active: bool = True,
        settings: DriverSettings | None = None,
        springs: Springs | None = None,
    ) -> Rig:
        return Rig(
            hand or HandSettings(),
            {"paper": PAPER, "manual": MANUAL}[calibration],
            active=active,
            settings=settings,
            springs=springs,
        )

    return make


@pytest.fixture
def springs():
    return Springs


@pytest.fixture
def made() -> Iterator[Made]:
    opened: list[ThreadedGripper] = []

    def make(
        *actions: Callable[[Cell], None], period_s: float = NEVER_S, **more: Any
    ) -> tuple[Cell, ThreadedGripper]:
        cell: Any = Cell()
        cell.actions = [lambda act=act: act(cell) for act in actions]
        gripper = ThreadedGripper(cell, period_s, clock=cell.clock, **more)
        opened.append(gripper)
        gripper.start(within_s=FOR_EVER_S)
        cell.wait()
        wait_for_polls(gripper, 1)
        return cell, gripper

    yield make
    for gripper in opened:
        gripper.close()
