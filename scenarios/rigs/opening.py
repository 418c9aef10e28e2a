"""Opens the rig that a configuration names."""

from collections.abc import Iterator
from contextlib import contextmanager

from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.emulated import emulated
from scenarios.rigs.hardware import hardware
from scenarios.rigs.rig import Rig
from scenarios.rigs.simulated import simulated


@contextmanager
def open_rig(config: GraspRigConfig, seed: int, paced: bool) -> Iterator[Rig]:
    """The rig that the configuration names. Raises the drivers' errors; closes what it opened."""
    if config.rig == "simulated":
        yield simulated(config, seed, paced)
        return
    with emulated(config, seed) if config.rig == "emulated" else hardware(config) as rig:
        yield rig
