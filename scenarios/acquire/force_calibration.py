"""What a newton is worth in counts of the pressed fingertip."""

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import PERIOD_S
from scenarios.acquire.config import AcquireConfig


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
    from scenarios.rigs.simulated import make_pressed_cell

    still = msgspec.structs.replace(
        config.fingertip, wander_mm=0.0, vibration_mm=0.0, sway_mm=0.0, noise_counts=0.0
    )
    cell = make_pressed_cell(msgspec.structs.replace(config, fingertip=still), seed)
    tips, load_n = cell.pad.tips, config.control.force_n
    nothing = np.zeros((1, 2))
    for i in range(100):
        load = np.array([load_n * min(1.0, i / 50)])
        tips.advance((i + 1) * PERIOD_S, load, nothing, np.zeros(1), nothing, False)
    fall = (tips.rest - tips.codes()[0]).sum()
    return max(1.0, float(fall) / load_n)
