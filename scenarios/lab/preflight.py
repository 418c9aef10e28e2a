"""Whether a verb that moves a lab's devices would start: the devices are read as it would read
them. Nothing is written to them, nothing moves. Then the gentle settings of a first lift."""

from typing import TypeVar

import msgspec

from drivers.errors import DeviceFault, Refused, UsageError
from drivers.interfaces import Counts3, Detection, GripperState
from drivers.robotiq.hand_state import finger_states, scissor_in_contact
from drivers.robotiq.protocol import BASIC, FAULTS, Severity, check_not_scissor
from grasp.clock import WallClock
from scenarios.lab.calibrate import check_open
from scenarios.lab.fingertips import open_touch
from scenarios.lab.hand import TOUCH_N, Moved, Say, check_thumb, guard_of, open_hand
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.device_checks import arm_checks, read_gripper
from scenarios.rigs.permission import MotionPermit, arm_of, driving, gripper_address, gripper_of
from scenarios.rigs.rig import calibration, check_fault, not_active
from scenarios.trial.config import TrialConfig

ConfigT = TypeVar("ConfigT", bound=TrialConfig)

SOFT = "foam"  # of config/objects: the softest
GENTLE_STOP_MPS2 = 1.0  # docs/first-day.md, "Set the arm's hardest stop"
# speeds of the controller that are halved, with their least values
HALVED = {
    "lift_speed_mps": 0.005, "lower_speed_mps": 0.005, "approach_speed_mps": 0.022,
    "closing_speed_mps": 0.022,
}  # fmt: skip
WHAT_TO_DO = (
    "protective stop: the arm stands and the hand keeps its grip. Look for the cause at the teach "
    "pendant, wait 5 s, clear it there; then let go as the message says",
    "emergency stop: press it whenever in doubt. The arm brakes, the hand keeps its grip. Release "
    "the button, power the robot on and release its brakes at the teach pendant, then let go",
    "loss of remote control (somebody turned the pendant to Local): the program ends and the arm "
    "stands. Turn it to Remote, then start again",
    "Ctrl-C: the arm stands, the grip is kept, and the command that opens the hand is printed",
)


class HandSeen(msgspec.Struct, frozen=True):
    """A hand that was read: its state, its mode, and whether it holds something between B and C,
    as one in scissor mode may."""

    state: GripperState
    mode: int
    scissor_in_contact: bool

    @property
    def well(self) -> bool:
        """Active and without a fault."""
        return self.state.active and not self.state.fault


def hand_seen(config: GraspRigConfig) -> HandSeen:
    """How the hand is. Raises Refused where another process drives it, and what its link raises."""
    where = gripper_address(config)
    if config.devices.gripper:
        raise UsageError(f"{where} is of another package", "look at it by that")
    with driving(gripper_of(config)):
        _, now = read_gripper(config)
    fault = FAULTS[now.fault]
    active = now.ready and fault.severity is not Severity.MAJOR
    state = GripperState(0, 0, active, now.fault, fault.text, True, finger_states(now))
    return HandSeen(state, now.mode, scissor_in_contact(now))


def active_hand(config: GraspRigConfig) -> HandSeen:
    """As ``hand_seen``; raises Refused for a hand that is not active."""
    seen = hand_seen(config)
    if not seen.state.active:
        raise not_active(seen.state)
    return seen


def check_activation(config: GraspRigConfig) -> HandSeen | None:
    """The hand, where there is anything to activate or a mode to be set. Raises Refused where that
    would drop something."""
    seen = hand_seen(config)
    state = seen.state
    if seen.well and seen.mode == BASIC:
        return None
    holding = Detection.CONTACT_CLOSING in (finger.detection for finger in state.fingers)
    if holding or seen.scissor_in_contact or (state.active and not state.is_open):
        raise Refused("activation would drop the object", "open first")
    return seen


def check_close(config: TrialConfig, seen: HandSeen, targets: Counts3) -> None:
    """Raises what closing to there would: of the guard, a fault, the mode, the fingertips, and a
    thumb in the way."""
    guard_of(config)
    state = seen.state
    check_fault(state)
    check_not_scissor(seen.mode)
    with open_touch(config, WallClock(WallClock().now_ns), state.is_open) as touch:
        if config.guard.cap_mode != "each_motor":
            to = (state.positions[0], *targets[1:])  # the thumb comes last
            check_thumb(state, to, touch.rest is not None)


def check_pressing(config: TrialConfig) -> None:
    """Raises what a finger that is to press on a scale would meet."""
    seen = active_hand(config)
    check_fault(seen.state)
    check_not_scissor(seen.mode)
    check_open(seen.state.positions)


def check_rest(config: TrialConfig) -> None:
    """Raises what taking the rest of the unloaded fingertips raises."""
    with open_touch(config, WallClock(WallClock().now_ns), unloaded=True):
        pass


def check_arm(config: GraspRigConfig) -> None:
    """Raises Refused where another process drives the arm, DeviceFault where it would not move."""
    with driving(arm_of(config)):
        against = [check for check in arm_checks(config) if check.status == "fail"]
    if against:
        remedies = dict.fromkeys(check.remedy for check in against if check.remedy)
        raise DeviceFault("; ".join(check.detail for check in against), "; ".join(remedies))


def gently(config: ConfigT) -> ConfigT:
    """Half as fast, no stronger than the hand's least, the arm stopped softly."""
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


def close_in_free_air(config: TrialConfig, permit: MotionPermit | None, say: Say) -> Moved:
    """To where the object would be grasped, and open again; the arm stands. Raises Refused where
    something was touched."""
    with open_hand(config, permit, closing=True) as hand:
        moved = hand.close(config.object.grip_counts, say)
        hand.move((0, 0, 0), say)
    felt = moved.force_n is not None and max(moved.force_n) >= TOUCH_N
    if moved.met or moved.stopped_by or felt:
        raise Refused(f"in free air, {moved.in_words()}", "empty the hand, look at its fingers")
    return moved
