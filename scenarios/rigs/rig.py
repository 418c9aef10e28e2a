"""A rig: the three devices, their clock and, in a simulation, the ground truth."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Generic, TypeVar

import msgspec

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.interfaces import OPEN_COUNTS, Arm, Gripper, GripperState, TactileSensor
from drivers.robotiq.protocol import BASIC, check_not_scissor
from grasp.run import signals
from grasp.run.clock import Clock
from grasp.run.loop import Devices
from scenarios.rigs.config import GraspRigConfig
from scenarios.world.settings import Impact
from scenarios.world.truth import PressedTruth, Truth

if TYPE_CHECKING:  # a rig of real devices imports no compiled world
    from scenarios.world.cell import SimulatedCell
    from scenarios.world.pressed_cell import PressedCell

POLL_NS = 100_000_000  # while waiting for activation
TAKE_OVER_S = 5.0  # timeout for the first state of an active hand
ACTIVATION_TIMEOUT_S = 25.0
WAIT_NS = 50_000_000
CLOSED_AND_INACTIVE = (
    "support what it holds, then `grasp release --activate`; if it is empty, `grasp gripper "
    "activate`"
)

CellT = TypeVar("CellT", "SimulatedCell", "PressedCell")
TruthT = TypeVar("TruthT", Truth, PressedTruth)


class Stalls(msgspec.Struct, frozen=True):
    """Stalls of the emulated world longer than 50 ms, which are not delays of the control loop."""

    count: int = 0
    worst_ms: float = 0.0


class Rig(msgspec.Struct, Generic[CellT, TruthT], frozen=True):
    """Connected and activated devices, each read at least once."""

    arm: Arm
    tactile: TactileSensor
    gripper: Gripper | None  # None: the hand stays as it is
    clock: Clock
    wall_time: bool  # time passes during computation; else time is virtual
    cell: CellT | None  # the world if it is in this process
    read_truth: Callable[[], TruthT] | None  # reads the world's true state; None on hardware
    stalls: Callable[[], Stalls] = Stalls  # of the process that emulates the world, if any
    # pairs of times, ns: command, reply to its write; if a thread does the exchange
    acknowledgements: Callable[[], Sequence[tuple[int, int]]] = tuple
    tap: Callable[[Impact], None] | None = None  # strikes the object; None: an operator does
    release_hint: str = ""  # instruction for a hand left closed; empty if the cell ends too
    # loads and places another trial's object
    load: Callable[[GraspRigConfig, int], None] | None = None

    @property
    def devices(self) -> Devices:
        """All three devices; raises TypeError on a rig without a hand."""
        if self.gripper is None:
            raise TypeError("this rig has no gripper")
        return Devices(gripper=self.gripper, arm=self.arm, tactile=self.tactile)

    def wait_and_poll(self) -> None:
        """Wait 50 ms, then poll all devices."""
        self.clock.sleep_until_ns(self.clock.now_ns + WAIT_NS)
        for device in (self.arm, self.gripper, self.tactile):
            if device is not None:
                device.poll(self.clock.now_ns)

    def truth(self) -> TruthT | None:
        """True state of the world now; None on hardware."""
        return None if self.read_truth is None else self.read_truth()


GraspRig = Rig["SimulatedCell", Truth]
PressRig = Rig["PressedCell", PressedTruth]


def connect(
    arm: Arm, tactile: TactileSensor, gripper: Gripper | None, clock: Clock, real: bool = False
) -> None:
    """Poll each device once and activate the gripper if needed, unless it is ``real``, because a
    real hand may hold something.

    Raises the devices' errors, Refused for a real hand that is not active, and DeviceFault if
    activation does not end within ACTIVATION_TIMEOUT_S.
    """
    arm.poll(clock.now_ns)
    if gripper is not None:
        take_over(gripper, clock) if real else activate(gripper, clock)
    arm.poll(clock.now_ns)
    tactile.poll(clock.now_ns)


def check_fault(state: GripperState) -> None:
    """Raises DeviceFault for an active hand that reports a fault, because it may hold something."""
    if state.fault:
        raise DeviceFault(
            f"the gripper reports a fault, {state.fault_text}; it is active and was left as it is, "
            f"at {state.positions} counts",
            "remove its cause and check with `grasp status gripper`; if the fault remains, support "
            "what the hand holds, `grasp release`, then `grasp gripper activate`",
        )  # fmt: skip


def mode_of(gripper: Gripper) -> int:
    """Mode of the hand when it was taken over; basic for a driver without modes."""
    return int(getattr(gripper, "mode", BASIC))


def known_state(gripper: Gripper) -> GripperState:
    """Latest state; raises LinkLost if the gripper has sent none."""
    if gripper.state is None:
        raise LinkLost("the gripper does not answer", "check its power, cable and address")
    return gripper.state


def not_active_error(state: GripperState, release_command: str = "") -> Refused:
    """Error for an inactive hand. A closed one may hold an object mechanically, as after a power
    cut. ``release_command``: the command that activates and opens it."""
    fault = f" ({state.fault_text})" if state.fault else ""
    problem = f"the hand is not active{fault}: nothing was moved"
    if release_command:
        warning = "activation opens and closes it fully: empty the hand or support what it holds"
        return Refused(problem, f"{warning}, then run {release_command}")
    if max(state.positions) > OPEN_COUNTS:
        closed = f"the hand is not active{fault} and is closed, at {state.positions} counts"
        return Refused(f"{closed}: activation would drop the object", CLOSED_AND_INACTIVE)
    return Refused(problem, "empty it, then `grasp gripper activate`")


def take_over(gripper: Gripper, clock: Clock) -> None:
    """Check that a real hand is active; a run never activates one, because activation opens and
    closes it fully with a force that cannot be set. Raises Refused for an inactive hand and in
    scissor mode, DeviceFault for one that reports a fault, and its driver's errors."""
    end_ns = clock.now_ns + round(TAKE_OVER_S * 1e9)
    while clock.now_ns < end_ns:
        gripper.poll(clock.now_ns)
        if (state := gripper.state) is not None:
            if not state.active:
                raise not_active_error(state)
            check_fault(state)
            if state.fresh:
                check_not_scissor(mode_of(gripper))
                return
        clock.sleep_until_ns(clock.now_ns + POLL_NS)
    raise LinkLost("the gripper does not answer", "check its power, cable and address")


def activate(gripper: Gripper, clock: Clock, dropping: bool = False) -> None:
    """Activate the hand unless it is active. Raises DeviceFault after ACTIVATION_TIMEOUT_S and for
    an active hand that reports a fault, Refused if it would drop something and ``dropping`` is
    false."""
    gripper.poll(clock.now_ns)
    if (found := gripper.state) is not None:
        if found.active:
            check_fault(found)
        elif not dropping and max(found.positions) > OPEN_COUNTS:
            raise not_active_error(found)
    gripper.activate(dropping)
    wait_until_active(gripper, clock)


def wait_until_active(gripper: Gripper, clock: Clock) -> GripperState:
    """State of the gripper once it is active; raises DeviceFault after ACTIVATION_TIMEOUT_S."""
    end_ns = clock.now_ns + round(ACTIVATION_TIMEOUT_S * 1e9)
    while (state := gripper.state) is None or not (state.active and state.fresh):
        if clock.now_ns >= end_ns:
            raise DeviceFault(
                f"gripper not active {ACTIVATION_TIMEOUT_S:g} s after the request",
                "check its LED, remove what blocks the fingers, switch it off and on",
            )
        signals.check()
        clock.sleep_until_ns(clock.now_ns + POLL_NS)
        gripper.poll(clock.now_ns)
    return state
