"""Opens a gripper that was left holding something: no arm motion, no reset."""

from drivers.errors import DeviceFault
from drivers.interfaces import Counts3
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.opening import open_rig

TIMEOUT_S = 15.0
POLL_NS = 50_000_000


def release_gripper(config: GraspRigConfig, speed_mps: float) -> Counts3:
    """Open all fingers and wait until they rest; returns where they stand.

    Raises the drivers' errors of opening the rig, and DeviceFault when the fingers do not open.
    """
    with open_rig(config, seed=0, paced=False) as rig:
        gripper, clock = rig.devices.gripper, rig.clock
        gripper.open(speed_mps)
        end_ns = clock.now_ns + round(TIMEOUT_S * 1e9)
        while clock.now_ns < end_ns:
            gripper.pump(clock.now_ns)
            clock.sleep_until_ns(clock.now_ns + POLL_NS)
            gripper.pump(clock.now_ns)
            state = gripper.state
            if state is not None and state.at_rest:
                return state.positions
    raise DeviceFault(
        "the fingers did not open", "free them by hand, then switch the gripper off and on"
    )
