"""The simulated world and the gripper driver at the start of a lift."""

import copy
from typing import cast

import msgspec

from drivers.interfaces import Gripper
from grasp.states import State
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.execution import make_controller, make_guard, make_loop
from scenarios.world.cell import SimulatedCell

LiftStart = tuple[SimulatedCell, Gripper]


def at_lift(config: LiftConfig, seed: int) -> LiftStart:
    """Copies of world and driver when the arm starts to rise. No slip response follows, and
    ``copy.deepcopy`` of the pair gives an independent lift.

    Raises RuntimeError if the lift does not start.
    """
    controller_settings = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    unanswered = msgspec.structs.replace(config, controller=controller_settings)
    with open_rig(unanswered.built_for(seed), seed, paced=False) as rig:
        controller = make_controller(unanswered)
        loop = make_loop(unanswered, rig, controller, make_guard(unanswered), lambda tick: None)
        while not controller.finished:
            tick = loop.tick()
            if controller.state is State.LIFT and tick.arm.moving:
                start = copy.deepcopy((cast(SimulatedCell, rig.cell), rig.devices.gripper))
                start[0].arm.brake_when_unread(
                    None
                )  # no loop reads the copy, and its arm must not brake for that
                return start
    raise RuntimeError(f"seed {seed}: the lift did not start: {controller.fault_cause}")
