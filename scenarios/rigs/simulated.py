"""The simulated rig: real driver cores over the device models, in this process; and the world of a
trial, out of its settings and seed.

What differs from trial to trial is drawn from stated distributions, all assumed: where the object
is gripped, where each finger stops, friction, mass and where it lies, the force at which motors
stop, and the gripper's timing. The fingertips draw their own rest counts, patch positions, textures
and noise (``scenarios.world.fingertip``), a tap its strength and moment (``scenarios.tap.mallet``).
"Normal" is cut at 2.5 deviations.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import msgspec
import numpy as np
from numba.core import event
from numpy.typing import NDArray

from drivers.robotiq.driver import RegisterTransport, RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.robotiq.model.hand import HandSettings
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.link import ModelLink
from drivers.takktile.receiver import UsbBoard
from drivers.ur.driver import ArmDriver, ArmLink
from drivers.ur.model import ArmModel
from grasp.clock import PacedClock, VirtualClock
from scenarios.rigs.config import (
    CUT,
    AnyRigConfig,
    GraspRigConfig,
    PressRigConfig,
    VariationSettings,
    wider,
)
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.world.cell import CellSettings, SimulatedCell
from scenarios.world.objects import GraspObject
from scenarios.world.pressed_cell import PressedCell, PressedCellSettings
from scenarios.world.settings import Level, level_named


class Wires(msgspec.Struct, frozen=True):
    """Who sees all that passes between a driver and its device's model, both ways."""

    gripper: Callable[[RegisterTransport], RegisterTransport] = lambda transport: transport
    arm: Callable[[ArmModel], ArmLink] = lambda model: model
    fingertips: Callable[[UsbBoard], UsbBoard] = lambda usb: usb


DIRECT = Wires()
UNREAD_S = 0.16  # monitors.standstill_s and a cycle: a run that goes on has not been braked


def simulated(config: AnyRigConfig, seed: int, paced: bool, wires: Wires = DIRECT) -> Rig[Any, Any]:
    """In virtual time; ``paced`` at the wall's pace."""
    cell = any_cell(config, seed)
    fingertips = ModelLink(cell.board, config.tactile, cell.advance, wires.fingertips)
    tactile = TakkTileDriver(fingertips, config.tactile).start()
    arm = ArmDriver(wires.arm(cell.arm), config.arm)
    gripper = _gripper(config, cell, wires)
    fast = VirtualClock(fingertips.advance)
    connect(arm, tactile, gripper, fast)
    arm.set_payload(config.arm.payload_kg)
    cell.arm.brake_when_unread(UNREAD_S)
    tap = None
    if isinstance(cell, SimulatedCell):
        cell.place_object()
        tap = cell.tap
    clock = PacedClock(fingertips.advance, fast.now_ns) if paced else fast
    return Rig(arm, tactile, gripper, clock, False, cell, cell.truth, tap=tap)


def _gripper(
    config: AnyRigConfig, cell: SimulatedCell | PressedCell, wires: Wires
) -> RobotiqDriver | None:
    if not isinstance(config, GraspRigConfig) or not isinstance(cell, SimulatedCell):
        return None
    wire = wires.gripper(ModelTransport(cell.gripper, config.gripper.link))
    return RobotiqDriver(wire, config.gripper, calibration(config))


# The world of a seed


class Draw(msgspec.Struct, frozen=True):
    """One draw."""

    body: GraspObject
    hand: HandSettings
    finger_offset_m: NDArray[np.float64]  # (3,) added travel of each finger


def draw(
    settings: VariationSettings, body: GraspObject, hand: HandSettings, rng: np.random.Generator
) -> Draw:
    """Object and hand of one trial. Draws the same numbers whatever the spreads are.

    Normal: friction, mass, start height, weight aside and each finger's stop; uniform: latency,
    refresh phase and force stop.
    """

    def normal(count: int) -> NDArray[np.float64]:
        return np.clip(rng.standard_normal(count), -CUT, CUT)

    friction, mass = normal(2).tolist()
    scatter = normal(3)
    latency, phase = rng.uniform(size=2).tolist()
    height = normal(1).item()
    weak = float(rng.uniform())
    aside = normal(1).item()
    rub = 1 + settings.friction_cv * friction
    varied_body = msgspec.structs.replace(
        wider(body, settings),
        friction_static=body.friction_static * rub,
        friction_kinetic=body.friction_kinetic * rub,
        mass_kg=body.mass_kg * (1 + settings.mass_cv * mass),
        added_mass_kg=body.added_mass_kg * (1 + settings.mass_cv * mass),
        centre_aside_m=body.centre_aside_m + settings.aside_m * aside,
        grip_height_m=body.grip_height_m + settings.start_height_m * height,
        body_above_grip_m=body.body_above_grip_m - settings.start_height_m * height,
    )
    varied_hand = msgspec.structs.replace(
        hand,
        command_latency_s=hand.command_latency_s + settings.command_latency_s * latency,
        tick_phase_s=phase / hand.refresh_hz,
        least_force_n=hand.least_force_n * (1 - settings.force_stop_fraction * weak),
    )
    return Draw(varied_body, varied_hand, settings.finger_scatter_m * scatter)


def cell_settings(config: GraspRigConfig, seed: int) -> tuple[CellSettings, np.random.Generator]:
    """The world that a seed stands for, and the generator of its noise; equal on every rig."""
    varied, world = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    trial = draw(config.variation, config.object, config.hand, varied)
    level, impact_level = _levels(config)
    settings = CellSettings(
        body=trial.body, contact=config.contact, fingertip=config.fingertip, hand=trial.hand,
        board=config.board, arm=config.arm_model, finger_offset_m=trial.finger_offset_m,
        level=level, impact_level=impact_level, pull=config.pull, damage=config.damage,
    )  # fmt: skip
    return settings, world


def _levels(config: GraspRigConfig) -> tuple[Level, Level]:
    """Contact levels before a tap and while it moves the object. Without a scenario: the level of
    a lift, and the fullest."""
    level, impact_level = config.world.level, config.world.impact_level
    if level == "auto":
        return Level.SLIDER, Level.BRUSH if impact_level == "auto" else level_named(impact_level)
    return level_named(level), level_named(level if impact_level == "auto" else impact_level)


def make_cell(config: GraspRigConfig, seed: int, start_ns: int = 0) -> SimulatedCell:
    """A cell with that world."""
    return SimulatedCell(*cell_settings(config, seed), start_ns)


def make_pressed_cell(config: PressRigConfig, seed: int, start_ns: int = 0) -> PressedCell:
    """The pressed fingertip that a seed stands for; equal on every rig."""
    settings = PressedCellSettings(
        surface=config.surface, press=config.press, fingertip=config.fingertip,
        board=config.board, arm=config.arm_model, finger=config.finger,
    )  # fmt: skip
    return PressedCell(settings, np.random.default_rng([seed, 0]), start_ns)


def any_cell(config: AnyRigConfig, seed: int, start_ns: int = 0) -> SimulatedCell | PressedCell:
    """The cell that the settings are of."""
    if isinstance(config, GraspRigConfig):
        return make_cell(config, seed, start_ns)
    return make_pressed_cell(config, seed, start_ns)


class _First(event.Listener):
    """Tells of the first function that is compiled; what lies in numba's cache is not."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, _: Any) -> None:
        if self._tell is not None:
            tell, self._tell = self._tell, None
            tell()

    def on_end(self, _: Any) -> None:
        pass


def told_when_compiling(tell: Callable[[], None]) -> AbstractContextManager[None]:
    """Within, ``tell`` is called once, as soon as anything must be compiled; else never."""
    return event.install_listener("numba:compile", _First(tell))
