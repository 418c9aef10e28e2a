"""The simulated rig: driver cores over the device models in this process, and the world of a trial
from its settings and seed.

Trials differ by samples from assumed distributions: grip height, stop position of each finger,
friction, mass and its offset, the force at which motors stop, and the gripper's timing. The
fingertips sample rest counts, textures and noise (``scenarios.world.fingertip``), a tap its impulse
and time (``scenarios.tap.mallet``). Normal variates are clipped at 2.5 standard deviations.
"""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.robotiq.driver import RegisterTransport, RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.robotiq.model.hand import HandSettings
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.link import ModelLink
from drivers.takktile.receiver import UsbBoard
from drivers.ur.driver import ArmDriver, ArmLink
from drivers.ur.model import ArmModel
from grasp.run.clock import PacedClock, VirtualClock
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import (
    CUT_SIGMAS,
    AnyRigConfig,
    GraspRigConfig,
    PressRigConfig,
    VariationSettings,
    wider,
)
from scenarios.rigs.rig import Rig, connect
from scenarios.world.cell import CellSettings, SimulatedCell
from scenarios.world.objects import GraspObject
from scenarios.world.pressed_cell import PressedCell, PressedCellSettings
from scenarios.world.settings import Level, level_named


class LinkWrappers(msgspec.Struct, frozen=True):
    """Wrappers around the links between the drivers and the device models, for tests. Without
    ``fingertips``, tactile frames pass as codes, not as bytes."""

    gripper: Callable[[RegisterTransport], RegisterTransport] = lambda transport: transport
    arm: Callable[[ArmModel], ArmLink] = lambda model: model
    fingertips: Callable[[UsbBoard], UsbBoard] | None = None


UNWRAPPED = LinkWrappers()
UNREAD_S = 0.16  # monitors.standstill_s plus a cycle: a run that continues was not braked


def simulated(
    config: AnyRigConfig, seed: int, paced: bool, wrappers: LinkWrappers = UNWRAPPED
) -> Rig[Any, Any]:
    """The simulated rig in virtual time; ``paced``: at the pace of the wall clock."""
    cell = any_cell(config, seed)
    fingertips = ModelLink(cell.board, config.tactile, cell.advance, wrappers.fingertips)
    tactile = TakkTileDriver(fingertips, config.tactile).start()
    arm = ArmDriver(wrappers.arm(cell.arm), config.arm)
    gripper = _gripper(config, cell, wrappers)
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
    config: AnyRigConfig, cell: SimulatedCell | PressedCell, wrappers: LinkWrappers
) -> RobotiqDriver | None:
    if not isinstance(config, GraspRigConfig) or not isinstance(cell, SimulatedCell):
        return None
    link = wrappers.gripper(ModelTransport(cell.gripper, config.gripper.link))
    return RobotiqDriver(link, config.gripper, calibration(config))


# The world of a seed


class TrialSample(msgspec.Struct, frozen=True):
    """Object, hand and finger positions of one trial."""

    body: GraspObject
    hand: HandSettings
    finger_offset_m: NDArray[np.float64]  # (3,) true travel of each finger minus the commanded one


def sample_trial(
    settings: VariationSettings, body: GraspObject, hand: HandSettings, rng: np.random.Generator
) -> TrialSample:
    """Sample object and hand of one trial; the random numbers do not depend on the spreads.

    Normal: friction, mass, start height, mass offset and each finger's stop; uniform: latency,
    refresh phase and force stop.
    """

    def normal(count: int) -> NDArray[np.float64]:
        return np.clip(rng.standard_normal(count), -CUT_SIGMAS, CUT_SIGMAS)

    friction, mass = normal(2).tolist()
    scatter = normal(3)
    latency, phase = rng.uniform(size=2).tolist()
    height = normal(1).item()
    weakness = float(rng.uniform())
    aside = normal(1).item()
    friction_scale = 1 + settings.friction_cv * friction
    varied_body = msgspec.structs.replace(
        wider(body, settings),
        friction_static=body.friction_static * friction_scale,
        friction_kinetic=body.friction_kinetic * friction_scale,
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
        least_force_n=hand.least_force_n * (1 - settings.force_stop_fraction * weakness),
    )
    return TrialSample(varied_body, varied_hand, settings.finger_scatter_m * scatter)


def cell_settings(config: GraspRigConfig, seed: int) -> tuple[CellSettings, np.random.Generator]:
    """Settings of a seed's world and the generator of its noise; equal on every rig."""
    varied, world = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    trial = sample_trial(config.variation, config.object, config.hand, varied)
    level, impact_level = _levels(config)
    settings = CellSettings(
        body=trial.body, contact=config.contact, fingertip=config.fingertip, hand=trial.hand,
        board=config.board, arm=config.arm_model, finger_offset_m=trial.finger_offset_m,
        level=level, impact_level=impact_level, pull=config.pull, damage=config.damage,
    )  # fmt: skip
    return settings, world


def _levels(config: GraspRigConfig) -> tuple[Level, Level]:
    """Contact levels before and during a tap; without a scenario, SLIDER and BRUSH."""
    level, impact_level = config.world.level, config.world.impact_level
    if level == "auto":
        return Level.SLIDER, Level.BRUSH if impact_level == "auto" else level_named(impact_level)
    return level_named(level), level_named(level if impact_level == "auto" else impact_level)


def make_cell(config: GraspRigConfig, seed: int, start_ns: int = 0) -> SimulatedCell:
    """The simulated cell of a seed."""
    return SimulatedCell(*cell_settings(config, seed), start_ns)


def make_pressed_cell(config: PressRigConfig, seed: int, start_ns: int = 0) -> PressedCell:
    """The pressed fingertip of a seed; equal on every rig."""
    settings = PressedCellSettings(
        surface=config.surface, press=config.press, fingertip=config.fingertip,
        board=config.board, arm=config.arm_model, finger=config.finger,
    )  # fmt: skip
    return PressedCell(settings, np.random.default_rng([seed, 0]), start_ns)


def any_cell(config: AnyRigConfig, seed: int, start_ns: int = 0) -> SimulatedCell | PressedCell:
    """The cell for either kind of settings."""
    if isinstance(config, GraspRigConfig):
        return make_cell(config, seed, start_ns)
    return make_pressed_cell(config, seed, start_ns)
