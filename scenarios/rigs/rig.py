"""A rig: the three devices, their clock, and, where there is a simulation, its truth."""

from collections.abc import Callable, Sequence

import msgspec

from drivers.errors import ConfigError, DeviceFault
from drivers.robotiq.calibration import GripperCalibration
from grasp.clock import Clock
from grasp.loop import Devices
from scenarios.rigs.calibration import choices
from scenarios.rigs.config import GraspRigConfig
from scenarios.world.cell import Blow, SimulatedCell, Truth

POLL_NS = 100_000_000  # while waiting for activation
ACTIVATION_TIMEOUT_S = 25.0


class Stalls(msgspec.Struct, frozen=True):
    """Times that the emulated world stood still over 50 ms: the cell's fault, not the loop's."""

    count: int = 0
    worst_ms: float = 0.0


class Rig(msgspec.Struct, frozen=True):
    """Devices that are connected, activated and have been read once."""

    devices: Devices
    clock: Clock
    cell: SimulatedCell | None  # the world, where it is in this process
    world: Callable[[], Truth] | None  # its truth, wherever it is; None on hardware
    stalls: Callable[[], Stalls] | None = None  # of the process that emulates the world
    # times of verbs and of the replies to their writes, ns, where a thread does the exchange
    acknowledgements: Callable[[], Sequence[tuple[int, int]]] | None = None
    tap: Callable[[Blow], None] | None = None  # strikes the object; None where a person must
    load: Callable[[GraspRigConfig, int], None] | None = (
        None  # another trial's object, put in place
    )

    def truth(self) -> Truth | None:
        """The state of the world now; None on hardware."""
        return None if self.world is None else self.world()


def calibration(config: GraspRigConfig) -> GripperCalibration:
    """What a byte is worth on this rig's hand; raises ConfigError where nobody has chosen."""
    if config.calibration is None:
        raise ConfigError("gripper", "calibration", "must be chosen by hand on this rig", choices())
    return config.calibration


def connect(devices: Devices, clock: Clock) -> None:
    """First exchange with each device, then activation of the gripper if it is not active yet.

    Raises what the devices raise, and DeviceFault when activation takes far longer than usual.
    """
    now_ns = clock.now_ns
    devices.arm.pump(now_ns)
    devices.gripper.pump(now_ns)
    devices.gripper.activate()
    end_ns = now_ns + round(ACTIVATION_TIMEOUT_S * 1e9)
    while (state := devices.gripper.state) is None or not state.active:
        if clock.now_ns >= end_ns:
            raise DeviceFault(
                f"gripper not active {ACTIVATION_TIMEOUT_S:g} s after the request",
                "look at its LED, clear what blocks the fingers, switch it off and on",
            )
        clock.sleep_until_ns(clock.now_ns + POLL_NS)
        devices.gripper.pump(clock.now_ns)
    devices.arm.pump(clock.now_ns)
    devices.tactile.pump(clock.now_ns)
