"""What is slow, kills processes or plays a laboratory's day: `make test-all`, never `make test`.

Every test here is marked `slow` (tests/conftest.py).
"""

from scenarios.testing.plugin import (  # noqa: F401
    emulated_arm,
    emulated_board,
    emulated_cell,
    emulated_cell_settings,
    emulated_gripper,
)
from tests.wire.drivers.ur.emulator.conftest import emulate, emulator  # noqa: F401
