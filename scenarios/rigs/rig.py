"""A rig: the three devices, their clock, and, where there is a simulation, its truth."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Generic, TypeVar

import msgspec

from drivers.errors import ConfigError, DeviceFault, LinkLost, Refused
from drivers.interfaces import OPEN_COUNTS, Arm, Gripper, GripperState, TactileSensor
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.protocol import BASIC, check_not_scissor
from grasp import signals
from grasp.clock import Clock
from grasp.loop import Devices
from scenarios.rigs.calibration import MANUAL, check_claim, choices
from scenarios.rigs.config import GraspRigConfig
from scenarios.world.settings import Impact
from scenarios.world.truth import PressedTruth, Truth

if TYPE_CHECKING:  # a rig of real devices has no world, and needs nothing compiled
    from scenarios.world.cell import SimulatedCell
    from scenarios.world.pressed_cell import PressedCell

POLL_NS = 100_000_000  # while waiting for activation
TAKE_OVER_S = 5.0  # within which an active hand says how it is
ACTIVATION_TIMEOUT_S = 25.0
IDLE_NS = 50_000_000
CLOSED_AND_INACTIVE = (
    "support what it holds, then `grasp release --activate`; if it is empty, `grasp gripper "
    "activate`"
)

CellT = TypeVar("CellT", "SimulatedCell", "PressedCell")
TruthT = TypeVar("TruthT", Truth, PressedTruth)
ConfigT = TypeVar("ConfigT", bound=GraspRigConfig)


class Stalls(msgspec.Struct, frozen=True):
    """Times that the emulated world stood still over 50 ms: the cell's fault, not the loop's."""

    count: int = 0
    worst_ms: float = 0.0


class Rig(msgspec.Struct, Generic[CellT, TruthT], frozen=True):
    """Devices that are connected, activated and have been read once."""

    arm: Arm
    tactile: TactileSensor
    gripper: Gripper | None  # None: the hand stays as it is
    clock: Clock
    on_wall: bool  # its time is the wall's, whatever is computed meanwhile
    cell: CellT | None  # the world, where it is in this process
    world: Callable[[], TruthT] | None  # its truth, wherever it is; None on hardware
    stalls: Callable[[], Stalls] = Stalls  # of the process that emulates the world, if one does
    # times of verbs and of the replies to their writes, ns, where a thread does the exchange
    acknowledgements: Callable[[], Sequence[tuple[int, int]]] = tuple
    tap: Callable[[Impact], None] | None = None  # strikes the object; None where a person must
    way_out: str = ""  # what to do about a hand that is left closed; empty: its cell ends too
    # puts another trial's object in place
    load: Callable[[GraspRigConfig, int], None] | None = None

    @property
    def devices(self) -> Devices:
        """All three; raises TypeError on a rig without a hand."""
        if self.gripper is None:
            raise TypeError("this rig has no gripper")
        return Devices(gripper=self.gripper, arm=self.arm, tactile=self.tactile)

    def idle(self) -> None:
        """Let a moment pass in which nothing is asked of the devices but how they are."""
        self.clock.sleep_until_ns(self.clock.now_ns + IDLE_NS)
        for device in (self.arm, self.gripper, self.tactile):
            if device is not None:
                device.poll(self.clock.now_ns)

    def truth(self) -> TruthT | None:
        """The state of the world now; None on hardware."""
        return None if self.world is None else self.world()


GraspRig = Rig["SimulatedCell", Truth]
PressRig = Rig["PressedCell", PressedTruth]


def calibration(config: GraspRigConfig) -> GripperCalibration:
    """What a byte is worth on this rig's hand; raises ConfigError where nobody has chosen, and, of
    real devices, for one that nobody should believe."""
    if config.calibration is None:
        raise ConfigError("gripper", "calibration", "must be chosen by hand on this rig", choices())
    if config.real:
        check_claim(config.calibration)
    return config.calibration


def to_open(config: ConfigT) -> ConfigT:
    """For what only opens, at the least force: where a calibration is not to be believed, the
    manual's figures take its place. Raises ConfigError where none was chosen."""
    try:
        calibration(config)
    except ConfigError:
        if config.calibration is None:
            raise
        return msgspec.structs.replace(config, calibration=MANUAL)
    return config


def connect(
    arm: Arm, tactile: TactileSensor, gripper: Gripper | None, clock: Clock, real: bool = False
) -> None:
    """First exchange with each device; a gripper that is not active yet is activated, but no
    ``real`` one: nobody may have emptied it.

    Raises what the devices raise, Refused for a real hand that is not active, and DeviceFault when
    activation takes far longer than usual.
    """
    arm.poll(clock.now_ns)
    if gripper is not None:
        take_over(gripper, clock) if real else activate(gripper, clock)
    arm.poll(clock.now_ns)
    tactile.poll(clock.now_ns)


def check_fault(state: GripperState) -> None:
    """Raises DeviceFault for an active hand that reports a fault: it may hold something."""
    if state.fault:
        raise DeviceFault(
            f"the gripper reports a fault, {state.fault_text}; it is active and was left as it is, "
            f"at {state.positions} counts",
            "remove its cause and look again with `grasp status gripper`; if it stays, support "
            "what the hand holds, `grasp release`, then `grasp gripper activate`",
        )  # fmt: skip


def mode_of(gripper: Gripper) -> int:
    """That the hand was taken over in: of another package's, which may know of none, basic."""
    return int(getattr(gripper, "mode", BASIC))


def known_state(gripper: Gripper) -> GripperState:
    """The latest state; raises LinkLost where the gripper has sent none."""
    if gripper.state is None:
        raise LinkLost("the gripper does not answer", "check its power, cable and address")
    return gripper.state


def not_active(state: GripperState, again: str = "") -> Refused:
    """The error of a hand that obeys nothing; ``again``: what to run to let it go. A hand that
    stands closed may hold something by itself, as after a power cut."""
    why = f" ({state.fault_text})" if state.fault else ""
    still = f"the hand is not active{why}: nothing was moved"
    if again:
        supported = "activation opens and closes it fully: empty the hand or support what it holds"
        return Refused(still, f"{supported}, then run {again}")
    if max(state.positions) > OPEN_COUNTS:
        closed = f"the hand is not active{why} and stands closed, at {state.positions} counts"
        return Refused(f"{closed}: activation would drop what it holds", CLOSED_AND_INACTIVE)
    return Refused(still, "empty it, then `grasp gripper activate`")


def take_over(gripper: Gripper, clock: Clock) -> None:
    """Check a real hand, which must be active: activation opens and closes it fully, at a force
    that nobody sets, and a run does that to none by itself. Raises Refused for one that is not
    active or in scissor mode, DeviceFault for one that reports a fault, and what its driver
    raises."""
    end_ns = clock.now_ns + round(TAKE_OVER_S * 1e9)
    while clock.now_ns < end_ns:
        gripper.poll(clock.now_ns)
        if (state := gripper.state) is not None:
            if not state.active:
                raise not_active(state)
            check_fault(state)
            if state.fresh:
                check_not_scissor(mode_of(gripper))
                return
        clock.sleep_until_ns(clock.now_ns + POLL_NS)
    raise LinkLost("the gripper does not answer", "check its power, cable and address")


def activate(gripper: Gripper, clock: Clock, dropping: bool = False) -> None:
    """Make the hand ready, unless it is. Raises DeviceFault when that does not end and for an
    active hand that reports a fault, Refused where it would drop something and may not."""
    gripper.poll(clock.now_ns)
    if (found := gripper.state) is not None:
        if found.active:
            check_fault(found)
        elif not dropping and max(found.positions) > OPEN_COUNTS:
            raise not_active(found)
    gripper.activate(dropping)
    until_active(gripper, clock)


def until_active(gripper: Gripper, clock: Clock) -> GripperState:
    """Its state once it is active; raises DeviceFault when that takes far longer than usual."""
    end_ns = clock.now_ns + round(ACTIVATION_TIMEOUT_S * 1e9)
    while (state := gripper.state) is None or not (state.active and state.fresh):
        if clock.now_ns >= end_ns:
            raise DeviceFault(
                f"gripper not active {ACTIVATION_TIMEOUT_S:g} s after the request",
                "look at its LED, clear what blocks the fingers, switch it off and on",
            )
        signals.check()
        clock.sleep_until_ns(clock.now_ns + POLL_NS)
        gripper.poll(clock.now_ns)
    return state
