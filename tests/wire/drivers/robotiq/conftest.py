"""Fixtures: an emulated gripper and driver clients, closed after each test."""

from collections.abc import Callable, Iterator

import pytest

from drivers.robotiq.emulator import GripperEmulator
from drivers.robotiq.model.gripper import GripperModel, HandSettings
from tests.wire.drivers.robotiq.rig import QUICK, Client, FastClock, Served, with_objects


@pytest.fixture
def serve() -> Iterator[Callable[..., Served]]:
    """Serve a hand on a free port; ``touch_m`` puts an object before each finger."""
    running: list[GripperEmulator] = []

    def make(
        hand: HandSettings = QUICK,
        *,
        active: bool = True,
        touch_m: float | None = None,
        clock: Callable[[], int] | None = None,
    ) -> Served:
        clock = clock or FastClock(5)
        model = GripperModel(hand, clock(), active=active)
        if touch_m is not None:
            with_objects(model, touch_m)
        served = Served(model, clock)
        running.append(served.emulator.start())
        return served

    yield make
    for emulator in running:
        emulator.stop()


@pytest.fixture
def connect() -> Iterator[Callable[..., Client]]:
    clients: list[Client] = []

    def make(served: Served, **settings: object) -> Client:
        clients.append(Client(served.emulator, **settings))
        return clients[-1]

    yield make
    for client in clients:
        client.close()


@pytest.fixture
def joined(serve, connect) -> Callable[..., tuple[Served, Client]]:
    """An emulator and a driver after its first exchange."""

    def make(**options: object) -> tuple[Served, Client]:
        served = serve(**options)
        client = connect(served)
        client.poll_until(lambda: client.state is not None)
        return served, client

    return make
