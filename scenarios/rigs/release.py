"""What `grasp release` asks before it opens a gripper that was left holding something.

It needs the gripper's link alone: an arm in protective stop or fingertips that were unplugged are
why a hand was left closed, and must not keep it so.
"""

import time
from contextlib import suppress

from drivers.errors import DeviceFault, GraspError, LinkLost, Refused
from drivers.interfaces import Gripper, GripperState
from grasp.clock import Clock, WallClock
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.device_checks import arm_checks
from scenarios.rigs.permission import (
    MotionPermit,
    board_address,
    driving,
    gripper_of,
    require,
)
from scenarios.rigs.rig import activate, to_open
from scenarios.rigs.wired import board_finder, open_gripper


def make_ready(config: GraspRigConfig, permit: MotionPermit | None, activating: bool) -> None:
    """Raises Refused for a hand that is not active, unless it is to be activated, and for one that
    another process drives; the driver's errors."""
    permit = require(permit)
    config = to_open(config)
    clock = WallClock(WallClock().now_ns)
    with driving(gripper_of(config)), open_gripper(config, lambda: clock.now_ns) as gripper:
        _make_ready(gripper, clock, permit, activating)


def other_devices(config: GraspRigConfig) -> dict[str, str]:
    """How the arm and the fingertips of real devices are, in words; moves and raises nothing."""
    told = [check for check in arm_checks(config) if check.status != "ok"]
    arm = "; ".join(check.detail for check in told) or "answers, ready"
    return {"arm": arm, "fingertips": _fingertips(config)}


def _fingertips(config: GraspRigConfig) -> str:
    if config.devices.fingertips:
        return "of another package: not asked"
    try:
        board_address(config)
        board = board_finder(config, time.monotonic_ns)(None)
        board.close()
    except (GraspError, ValueError) as error:
        return str(error)
    return f"board {board.serial} is there"


def _make_ready(gripper: Gripper, clock: Clock, permit: MotionPermit, activating: bool) -> None:
    with suppress(DeviceFault):  # a fault is told below, or cleared by the activation
        gripper.pump(clock.now_ns)
    state = gripper.state
    if state is None:
        raise LinkLost("the gripper does not answer", "check its power, cable and address")
    if state.active:
        return
    if not activating:
        raise not_active(state, f"`{permit.release} --activate`")
    activate(gripper, clock, dropping=True)  # it was said that what it holds is supported


def not_active(state: GripperState, again: str) -> Refused:
    """What is said of a hand that obeys nothing; ``again``: what to run."""
    why = f" ({state.fault_text})" if state.fault else ""
    return Refused(
        f"the hand is not active{why}: nothing was moved",
        "activation opens and closes it fully: empty the hand or support what it holds, then run "
        f"{again}",
    )
