"""Slow tests, tests that kill processes, and a rehearsal of a first day (`make test-all` only).

Every test here is marked `slow` (tests/conftest.py); the campaigns are marked `nightly` as well.
"""

from pathlib import Path

import pytest

from scenarios.testing.plugin import (  # noqa: F401
    emulated_arm,
    emulated_board,
    emulated_cell,
    emulated_cell_settings,
    emulated_gripper,
)
from tests.wire.drivers.ur.emulator.conftest import emulate, emulator  # noqa: F401

HERE = Path(__file__).parent
CAMPAIGNS = ("faults", "chaos", "soak", "fuzz")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if any(HERE / name in item.path.parents for name in CAMPAIGNS):
            item.add_marker(pytest.mark.nightly)
