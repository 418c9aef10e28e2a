"""Tests that wait for real time: for events, with generous deadlines, and never for durations.

A slow machine makes them slow, not red: nothing is run again, and no time that passed is judged.
"""

from collections.abc import Iterator

import pytest

from scenarios.testing.plugin import (  # noqa: F401  (whether or not this project is installed)
    emulated_arm,
    emulated_board,
    emulated_cell,
    emulated_cell_settings,
    emulated_gripper,
)
from tests.wire.lab import Lab, emulate

TIMEOUT_S = 420


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "tests/wire/" in item.path.as_posix() and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(TIMEOUT_S))


@pytest.fixture(scope="session")
def lab_of_the_worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate() as endpoints:
        lab = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        yield lab
        lab.cell.close()


@pytest.fixture
def lab(lab_of_the_worker: Lab) -> Lab:
    """Arm and hand as they began, the hand not active, no object in place."""
    lab_of_the_worker.reset()
    return lab_of_the_worker


@pytest.fixture
def ready(lab: Lab) -> Lab:
    """With an active hand, open."""
    lab.wake()
    return lab
