"""Checks of a lab command's devices before it starts, and the gentle settings of a first lift. The
checks read the devices; they write nothing and nothing moves."""

from typing import TypeVar

import msgspec

from drivers.checks import raise_failures
from drivers.errors import Refused, UsageError
from drivers.interfaces import Counts3, Detection, GripperState
from drivers.robotiq.hand_state import finger_states, scissor_in_contact
from drivers.robotiq.protocol import BASIC, FAULTS, Severity, check_not_scissor
from grasp.run.clock import WallClock
from scenarios.lab.calibrate import check_open
from scenarios.lab.fingertips import open_fingertips
from scenarios.lab.hand import CONTACT_N, MotionResult, Say, check_thumb, hand_guard, open_hand
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.device_checks import arm_checks, read_gripper
from scenarios.rigs.permission import MotionPermit, arm_of, driving, gripper_address, gripper_of
from scenarios.rigs.rig import check_fault, not_active_error
from scenarios.trial.config import TrialConfig

ConfigT = TypeVar("ConfigT", bound=TrialConfig)

GENTLE_STOP_MPS2 = 1.0  # docs/first-day.md, "Set the arm's hardest stop"
# speeds of the controller that are halved, with their least values
HALVED = {
    "lift_speed_mps": 0.005, "lower_speed_mps": 0.005, "approach_speed_mps": 0.022,
    "closing_speed_mps": 0.022,
}  # fmt: skip
STOP_INSTRUCTIONS = (
    "protective stop: the arm stops and the hand keeps its grip. Find the cause on the teach "
    "pendant, wait 5 s, clear it there; then run `grasp release`",
    "emergency stop: press it if in doubt. The arm brakes, the hand keeps its grip. Release the "
    "button, power the robot on and release its brakes on the teach pendant, then run "
    "`grasp release`",
    "loss of remote control (somebody set the pendant to Local): the program ends and the arm "
    "stops. Set it to Remote, then start again",
    "Ctrl-C: the arm stops, the hand keeps its grip, and the command that opens it is printed",
)


class HandReading(msgspec.Struct, frozen=True):
    """A reading of the hand: state, mode, and whether it holds something between B and C, as it may
    in scissor mode."""

    state: GripperState
    mode: int
    scissor_in_contact: bool

    @property
    def healthy(self) -> bool:
        """Active and without a fault."""
        return self.state.active and not self.state.fault


def read_hand(config: GraspRigConfig) -> HandReading:
    """Read the hand. Raises Refused if another process drives it, and the errors of its link."""
    where = gripper_address(config)
    if config.devices.gripper:
        raise UsageError(f"{where} is of another package", "read its state with that package")
    with driving(gripper_of(config)):
        _, now = read_gripper(config)
    fault = FAULTS[now.fault]
    active = now.ready and fault.severity is not Severity.MAJOR
    state = GripperState(0, 0, active, now.fault, fault.text, True, finger_states(now))
    return HandReading(state, now.mode, scissor_in_contact(now))


def read_active_hand(config: GraspRigConfig) -> HandReading:
    """Read the hand; raises Refused if it is not active."""
    reading = read_hand(config)
    if not reading.state.active:
        raise not_active_error(reading.state)
    return reading


def check_activation(config: GraspRigConfig) -> HandReading | None:
    """The hand's reading; None if it is active in basic mode. Raises Refused if activation would
    drop something."""
    reading = read_hand(config)
    state = reading.state
    if reading.healthy and reading.mode == BASIC:
        return None
    holding = Detection.CONTACT_CLOSING in (finger.detection for finger in state.fingers)
    if holding or reading.scissor_in_contact or (state.active and not state.is_open):
        raise Refused("activation would drop the object", "first `grasp release`")
    return reading


def check_close(config: TrialConfig, reading: HandReading, targets: Counts3) -> None:
    """Raises the errors of closing to ``targets``: of the guard, a fault, the mode, the fingertips,
    and a closed thumb."""
    hand_guard(config)
    state = reading.state
    check_fault(state)
    check_not_scissor(reading.mode)
    with open_fingertips(config, WallClock(WallClock().now_ns), state.is_open) as fingertips:
        if config.guard.limit_mode != "each_motor":
            first = (state.positions[0], *targets[1:])  # the thumb closes last
            check_thumb(state, first, fingertips.rest is not None)


def check_pressing(config: TrialConfig) -> None:
    """Raises the errors of pressing on a scale with one finger."""
    reading = read_active_hand(config)
    check_fault(reading.state)
    check_not_scissor(reading.mode)
    check_open(reading.state.positions)


def check_rest(config: TrialConfig) -> None:
    """Raises the errors of measuring the rest codes of unloaded fingertips."""
    with open_fingertips(config, WallClock(WallClock().now_ns), unloaded=True):
        pass


def check_arm(config: GraspRigConfig) -> None:
    """Raises Refused if another process drives the arm, DeviceFault if it would not move."""
    with driving(arm_of(config)):
        raise_failures(arm_checks(config))


def gentle_settings(config: ConfigT) -> ConfigT:
    """The settings at half speed, with at most the hand's least force, and a soft stop of the
    arm."""
    replace, controller = msgspec.structs.replace, config.controller
    slow = {name: max(least, getattr(controller, name) / 2) for name, least in HALVED.items()}
    limit_n = min(config.guard.force_limit_n, calibration(config).least_force_n)
    if "slip_stop_mps2" not in controller.unread:
        slow["slip_stop_mps2"] = min(controller.slip_stop_mps2, GENTLE_STOP_MPS2)
    grip_n = min(controller.grip_force_n, limit_n)
    return replace(
        config,
        controller=replace(controller, grip_force_n=grip_n, **slow),
        guard=replace(config.guard, force_limit_n=limit_n),
    )


def close_in_free_air(config: TrialConfig, permit: MotionPermit | None, say: Say) -> MotionResult:
    """Close to the grasp positions without an object and open again; the arm does not move. Raises
    Refused after contact."""
    with open_hand(config, permit, closing=True) as hand:
        moved = hand.close(config.object.grip_counts, say)
        hand.move((0, 0, 0), say)
    loaded = moved.force_n is not None and max(moved.force_n) >= CONTACT_N
    if moved.contacts or moved.stopped_by or loaded:
        raise Refused(f"in free air, {moved.summary()}", "empty the hand, check its fingers")
    return moved
