"""Makes the world of one acquisition from settings and a seed; calibrates its fingertip."""

import msgspec
import numpy as np

from drivers.errors import ConfigError
from scenarios.acquire.config import AcquireConfig
from scenarios.world.pressed_cell import PressedCell, PressedCellSettings


def pressed_cell(config: AcquireConfig, seed: int, start_ns: int = 0) -> PressedCell:
    """The world that a seed stands for; equal on every rig."""
    settings = PressedCellSettings(
        surface=config.surface, press=config.press, fingertip=config.fingertip,
        board=config.board, arm=config.arm_model, finger=config.finger,
    )  # fmt: skip
    return PressedCell(settings, np.random.default_rng([seed, 0]), start_ns)


def counts_per_newton(config: AcquireConfig, seed: int) -> float:
    """Calibration of the force estimate. Raises ConfigError on hardware that names none."""
    known = config.control.counts_per_newton
    if known:
        return known
    if config.rig == "hardware":
        raise ConfigError(
            "control", "counts_per_newton", "must be measured on this rig",
            "sum of a fingertip's counts under a known weight, over that weight in newtons",
        )  # fmt: skip
    return pressed_gain(config, seed)


def pressed_gain(config: AcquireConfig, seed: int) -> float:
    """Sum of counts a newton of the simulated fingertip, pressed as hard as it will be: what a
    weight on this very one, tilted as it is, would tell."""
    still = msgspec.structs.replace(
        config.fingertip, wander_mm=0.0, vibration_mm=0.0, sway_mm=0.0, noise_counts=0.0
    )
    cell = pressed_cell(msgspec.structs.replace(config, fingertip=still), seed)
    tips, load_n = cell.pad.tips, config.control.force_n
    nothing = np.zeros((1, 2))
    for i in range(100):
        load = np.array([load_n * min(1.0, i / 50)])
        tips.advance((i + 1) * 0.01, load, nothing, np.zeros(1), nothing, False)
    fall = (tips.rest - tips.codes()[0]).sum()
    return max(1.0, float(fall) / load_n)
