"""Opens a rig for the acquisition: arm, fingertips, clock, and the truth where there is one."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial

import msgspec

from drivers.interfaces import Arm, TactileSensor
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.emulator.bus import backend
from drivers.takktile.link.thread import ReadingThread
from drivers.takktile.link.usb import UsbLink
from drivers.takktile.model.link import ModelLink
from drivers.takktile.settings import TakkTileSettings
from drivers.ur.driver import ArmDriver
from drivers.ur.link.client import UrLink
from grasp.clock import Clock, PacedClock, VirtualClock, WallClock
from scenarios.acquire import emulated_cell
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.world_of_seed import pressed_cell
from scenarios.rigs.cell_process import CellProcess
from scenarios.world.pressed_cell import PressedCell, PressedTruth

LOADED_STD = 200.0  # counts; anything that a pressed fingertip may do while it is zeroed


class AcquireRig(msgspec.Struct, frozen=True):
    """What an acquisition needs of a rig: arm and fingertips, connected; the hand stays as it is,
    one finger pointing down."""

    arm: Arm
    tactile: TactileSensor
    clock: Clock
    cell: PressedCell | None  # the world, where it is in this process
    truth: Callable[[], PressedTruth] | None  # None on hardware


@contextmanager
def open_acquire_rig(config: AcquireConfig, seed: int, paced: bool) -> Iterator[AcquireRig]:
    """The rig that the configuration names. Raises the drivers' errors; closes what it opened."""
    if config.rig == "simulated":
        yield _simulated(config, seed, paced)
        return
    wired = _emulated(config, seed) if config.rig == "emulated" else _hardware(config)
    with wired as rig:
        yield rig


def _simulated(config: AcquireConfig, seed: int, paced: bool) -> AcquireRig:
    """Real driver cores over the device models, in this process."""
    cell = pressed_cell(config, seed)
    settings = _tactile_settings(config)
    fingertips = ModelLink(cell.board, settings, cell.advance)
    tactile = TakkTileDriver(fingertips, settings).start()
    clock = (PacedClock if paced else VirtualClock)(fingertips.advance)
    return AcquireRig(ArmDriver(cell.arm, config.arm), tactile, clock, cell, cell.truth)


@contextmanager
def _emulated(config: AcquireConfig, seed: int) -> Iterator[AcquireRig]:
    """Real drivers over real protocols to a cell in another process, in wall time."""
    process = CellProcess(config, seed, emulated_cell)
    try:
        replace, ends = msgspec.structs.replace, process.endpoints
        there = replace(
            config,
            usb=replace(config.usb, url=ends["tactile"]["url"]),
            ur=replace(config.ur, host=ends["arm"]["host"]),
        )
        ask = lambda: msgspec.convert(process.control.ask("truth")["truth"], PressedTruth)  # noqa: E731
        with _wired(there, WallClock(ends["start_ns"]), ask) as rig:
            yield rig
    finally:
        process.close()


def _hardware(config: AcquireConfig) -> AbstractContextManager[AcquireRig]:
    """The same drivers at the lab's own addresses; nothing is known but what the devices say."""
    return _wired(config, WallClock(WallClock().now_ns), None)


def _tactile_settings(config: AcquireConfig) -> TakkTileSettings:
    """A rest under load is what the driver otherwise refuses: low, and unsteady as the force."""
    if config.control.residual_n <= 0.0:
        return config.tactile
    return msgspec.structs.replace(
        config.tactile, rest_min_counts=0, rest_max_std_counts=LOADED_STD
    )


@contextmanager
def _wired(
    config: AcquireConfig, clock: WallClock, truth: Callable[[], PressedTruth] | None
) -> Iterator[AcquireRig]:
    now: Callable[[], int] = lambda: clock.now_ns  # noqa: E731
    bus = backend(config.usb.url) if config.usb.url else None
    find = partial(UsbLink.find, backend=bus, clock=now)
    settings = _tactile_settings(config)
    fingertips = TakkTileDriver(ReadingThread(find, settings, now), settings)
    with fingertips as tactile, UrLink(config.ur) as link:
        arm = ArmDriver(link, config.arm)
        arm.set_payload(config.arm.payload_kg)
        yield AcquireRig(arm, tactile, clock, None, truth)
