"""Would a verb that moves a lab's devices start? They are asked what it would ask them, whoever
drives them too; nothing is written to them, nothing moves."""

import msgspec

from drivers.errors import DeviceFault, Refused, UsageError
from drivers.interfaces import Counts3, Detection, GripperState
from drivers.robotiq.encoding import finger_states, pinches
from drivers.robotiq.modes import BASIC, check_closing
from drivers.robotiq.protocol import FAULTS, Severity
from grasp.clock import WallClock
from scenarios.lab.hand import check_thumb, guard_of
from scenarios.lab.scale import check_open
from scenarios.lab.touch import open_touch
from scenarios.rigs.cell_lock import arm_of, driving, gripper_of
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.device_checks import arm_checks, read_gripper
from scenarios.rigs.permission import gripper_address
from scenarios.rigs.rig import check_fault, not_active
from scenarios.trial.config import TrialConfig


class HandSeen(msgspec.Struct, frozen=True):
    """A hand that was looked at: its state, the mode that it is in, and whether it holds something
    between B and C, as one in scissor mode may."""

    state: GripperState
    mode: int
    pinches: bool

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
    return HandSeen(state, now.mode, pinches(now))


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
    if holding or seen.pinches or (state.active and not state.is_open):
        raise Refused("activation would drop what the fingers hold", "open first")
    return seen


def check_close(config: TrialConfig, seen: HandSeen, targets: Counts3) -> None:
    """Raises what closing to there would: of the guard, a fault, the mode, the fingertips, and a
    thumb in the way."""
    guard_of(config)
    state = seen.state
    check_fault(state)
    check_closing(seen.mode)
    clock = WallClock(WallClock().now_ns)
    with open_touch(config, clock, state.is_open) as touch:
        if config.guard.cap_mode != "each_motor":
            to = (state.positions[0], *targets[1:])  # the thumb comes last
            check_thumb(state, to, touch.rest is not None)


def check_pressing(config: TrialConfig, hearing: bool) -> None:
    """Raises what a finger that is to press on a scale would meet; ``hearing``: the fingertips
    too."""
    if hearing:
        check_hearing(config)
    seen = active_hand(config)
    check_fault(seen.state)
    check_closing(seen.mode)
    check_open(seen.state)


def check_hearing(config: TrialConfig) -> None:
    """Raises what listening to the unloaded fingertips raises."""
    with open_touch(config, WallClock(WallClock().now_ns), unloaded=True):
        pass


def check_arm(config: GraspRigConfig) -> None:
    """Raises Refused where another process drives the arm, DeviceFault where it would not move."""
    with driving(arm_of(config)):
        against = [check for check in arm_checks(config) if check.status == "fail"]
    if against:
        remedies = dict.fromkeys(check.remedy for check in against if check.remedy)
        raise DeviceFault("; ".join(check.detail for check in against), "; ".join(remedies))
