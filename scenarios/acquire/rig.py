"""The rig of an acquisition: one that lets a pressed fingertip take its rest counts."""

from collections.abc import Iterator
from contextlib import contextmanager

import msgspec

from scenarios.acquire.config import AcquireConfig
from scenarios.rigs.opening import open_press_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import PressRig


@contextmanager
def open_acquire_rig(
    config: AcquireConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> Iterator[PressRig]:
    """As ``open_press_rig``. A rest under load is what the driver otherwise refuses: low, and
    unsteady as the force."""
    replace = msgspec.structs.replace
    if config.control.residual_n > 0.0:
        most = config.session.loaded_rest_max_std_counts
        tolerant = replace(config.tactile, rest_min_counts=0, rest_max_std_counts=most)
        config = replace(config, tactile=tolerant)
    with open_press_rig(config, seed, paced, permit) as rig:
        yield rig
