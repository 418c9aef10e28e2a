"""The plugin's fixtures, whether or not this project is installed where pytest would find it."""

from scenarios.testing.plugin import (  # noqa: F401
    emulated_arm,
    emulated_board,
    emulated_cell,
    emulated_cell_settings,
    emulated_gripper,
)
