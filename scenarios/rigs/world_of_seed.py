"""Makes the world of one trial: settings and seed in, a cell out."""

import numpy as np

from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, PressRigConfig
from scenarios.rigs.variation import draw
from scenarios.world.cell import CellSettings, SimulatedCell
from scenarios.world.pressed_cell import PressedCell, PressedCellSettings
from scenarios.world.settings import Level, level_named


def cell_settings(config: GraspRigConfig, seed: int) -> tuple[CellSettings, np.random.Generator]:
    """The world that a seed stands for, and the generator of its noise; equal on every rig."""
    varied, world = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    trial = draw(config.variation, config.object, config.hand, varied)
    level, blow_level = _levels(config)
    settings = CellSettings(
        body=trial.body,
        contact=config.contact,
        fingertip=config.fingertip,
        hand=trial.hand,
        board=config.board,
        arm=config.arm_model,
        finger_offset_m=trial.finger_offset_m,
        level=level,
        blow_level=blow_level,
        pull=config.pull,
        damage=config.damage,
    )
    return settings, world


def _levels(config: GraspRigConfig) -> tuple[Level, Level]:
    """Contact levels before a tap and while it moves the object. Without a scenario: the level of
    a lift, and the fullest."""
    level, blow_level = config.world.level, config.world.blow_level
    if level == "auto":
        return Level.SLIDER, Level.BRUSH if blow_level == "auto" else level_named(blow_level)
    return level_named(level), level_named(level if blow_level == "auto" else blow_level)


def make_cell(config: GraspRigConfig, seed: int, start_ns: int = 0) -> SimulatedCell:
    """A cell with that world."""
    return SimulatedCell(*cell_settings(config, seed), start_ns)


def any_cell(config: AnyRigConfig, seed: int, start_ns: int = 0) -> SimulatedCell | PressedCell:
    """The cell that the settings are of."""
    if isinstance(config, GraspRigConfig):
        return make_cell(config, seed, start_ns)
    return make_pressed_cell(config, seed, start_ns)


def make_pressed_cell(config: PressRigConfig, seed: int, start_ns: int = 0) -> PressedCell:
    """The pressed fingertip that a seed stands for; equal on every rig."""
    settings = PressedCellSettings(
        surface=config.surface, press=config.press, fingertip=config.fingertip,
        board=config.board, arm=config.arm_model, finger=config.finger,
    )  # fmt: skip
    return PressedCell(settings, np.random.default_rng([seed, 0]), start_ns)
