"""Tests in real time. They wait for events with generous deadlines, never for durations.

On a slow machine they are slow but pass: nothing is repeated, and no elapsed time is checked.
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
    """A lab in its initial state: hand not active, no object in place."""
    lab_of_the_worker.reset()
    return lab_of_the_worker


@pytest.fixture
def ready(lab: Lab) -> Lab:
    """A lab with an active, open hand."""
    lab.activate_hand()
    return lab
