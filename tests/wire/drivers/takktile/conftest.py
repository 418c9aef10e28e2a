"""An emulated board that a test can press, give faults, unplug and plug in again."""

import sys
import threading
from collections.abc import Iterator
from functools import cached_property

import numpy as np
import pytest
import usb.core

from drivers.takktile.emulator.server import BoardServer, backend
from drivers.takktile.link import UsbLink
from drivers.takktile.model.board import BoardModel
from drivers.takktile.settings import BoardModelSettings

MS = 1_000_000


class Bench:
    """A board model behind a server. The test sets the pressure codes; the temperature code is the
    time of conversion in ms, modulo 1024."""

    def __init__(self, settings: BoardModelSettings | None = None) -> None:
        settings = settings or BoardModelSettings()
        self.codes = np.arange(440, 440 + len(settings.cells), dtype=np.int16)  # board order
        self.conversions = 0
        self.pressed, self.pressed_after = 0, sys.maxsize  # which cell, after which conversion
        self.lock = threading.Lock()
        self.board = BoardModel(settings, self._sample)
        self.server = BoardServer(self.board, self.lock)

    def _sample(self, t_ns: int):
        self.conversions += 1
        if self.conversions > self.pressed_after:
            self.codes[self.pressed] = 300
        codes = self.codes.copy(), np.full(len(self.codes), t_ns // MS % 1024, np.int16)
        return lambda: codes

    @cached_property
    def bus(self):
        return backend(self.server.url)

    def find(self):
        return usb.core.find(backend=self.bus, idVendor=0x59E3, idProduct=0x74C7)

    def connect(self, serial: str | None = None) -> UsbLink:
        return UsbLink.find(serial, self.bus)

    def inject(self, fault: str, *args: object) -> None:
        with self.lock:
            getattr(self.board, fault)(*args)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    with made.server:
        yield made


@pytest.fixture
def device(bench: Bench):
    found = bench.find()
    yield found
    usb.util.dispose_resources(found)
