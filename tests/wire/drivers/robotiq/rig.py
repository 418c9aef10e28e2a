"""Emulators, drivers connected to them, and objects to close on."""

import time
from collections.abc import Callable

import numpy as np

from drivers.errors import LinkLost
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.emulator import GripperEmulator
from drivers.robotiq.link import ThreadedGripper
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings
from drivers.robotiq.settings import DriverSettings, ModbusSettings
from tests.calibrations import PAPER
from tests.wire.waiting import until

QUICK = HandSettings(activation_s=0.1)
TIMEOUT_S = 1.0  # long enough for a reply on a loaded machine
TOUCH_M = 0.03
STIFFNESS_NPM = 5000.0


class FastClock:
    """Monotonic wall time, ``rate`` times as fast."""

    def __init__(self, rate: int) -> None:
        self._rate = rate
        self._start_ns = time.monotonic_ns()

    def __call__(self) -> int:
        return (time.monotonic_ns() - self._start_ns) * self._rate


def with_objects(model: GripperModel, touch_m: float = TOUCH_M) -> GripperModel:
    """The model with a spring fixed in space in front of each finger."""
    stiffness = np.full(3, STIFFNESS_NPM)
    model.advance(0, FingerLoads(stiffness * (model.travel_m - touch_m), stiffness))
    return model


class Client:
    """The real driver on the real wire, polled by the test."""

    def __init__(self, emulator: GripperEmulator, **settings: object) -> None:
        host, port = emulator.address
        where = {"host": host, "port": port, "timeout_s": TIMEOUT_S}
        self.transport = ModbusTransport(ModbusSettings(**{**where, **settings}), reconnect_s=0.02)
        self.driver = RobotiqDriver(
            self.transport, DriverSettings(), PAPER, clock=time.monotonic_ns
        )
        self.errors: list[Exception] = []

    @property
    def state(self):
        return self.driver.state

    def poll(self, times: int = 1) -> None:
        for _ in range(times):
            self.driver.poll(time.monotonic_ns())

    def poll_until(self, true: Callable[[], bool]) -> None:
        """Poll until a condition holds; link losses are collected in ``errors``."""

        def once() -> bool:
            try:
                self.poll()
            except LinkLost as error:
                self.errors.append(error)
                return False
            return true()

        until(once)

    def settle(self) -> None:
        self.poll_until(lambda: self.state.at_rest)

    def threaded(self, period_s: float = 0.01) -> ThreadedGripper:
        return ThreadedGripper(self.driver, period_s, close=self.transport.close)

    def close(self) -> None:
        self.transport.close()


class Served:
    """An emulator and the frames that it has received."""

    def __init__(self, model: GripperModel | HandSettings, clock: Callable[[], int]) -> None:
        self.frames: list[bytes] = []
        self.emulator = GripperEmulator(model, clock=clock, on_frame=self.frames.append)

    @property
    def writes(self) -> list[bytes]:
        """All registers after each received write (function 16), which may omit the first."""
        image, found = bytes(16), list[bytes]()
        for frame in self.frames:
            if frame[7] == 16:
                first = 2 * int.from_bytes(frame[8:10])
                assert (first, len(frame[13:])) in ((0, 16), (2, 14))
                image = image[:first] + frame[13:]
                found.append(image)
        return found
