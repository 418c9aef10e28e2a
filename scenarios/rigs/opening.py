"""Opens the rig that a configuration names: with a hand around an object, or one finger alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, PressRigConfig
from scenarios.rigs.emulated import emulated
from scenarios.rigs.hardware import hardware
from scenarios.rigs.rig import GraspRig, PressRig, Rig
from scenarios.rigs.simulated import simulated


@contextmanager
def open_rig(config: GraspRigConfig, seed: int, paced: bool) -> Iterator[GraspRig]:
    """The hand is active and open, an object in place. Raises the drivers' errors; closes what it
    opened."""
    with _open(config, seed, paced) as rig:
        yield rig


@contextmanager
def open_press_rig(config: PressRigConfig, seed: int, paced: bool) -> Iterator[PressRig]:
    """Without a gripper: the hand stays as it is, one finger pointing down. As ``open_rig``."""
    with _open(config, seed, paced) as rig:
        yield rig


@contextmanager
def _open(config: AnyRigConfig, seed: int, paced: bool) -> Iterator[Rig[Any, Any]]:
    if config.rig == "simulated":
        yield simulated(config, seed, paced)
        return
    with emulated(config, seed) if config.rig == "emulated" else hardware(config) as rig:
        yield rig
