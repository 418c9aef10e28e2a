"""The arm moved by itself on real devices: one short slow step, or stopped."""

import math
import time
from contextlib import suppress

from drivers.errors import DeviceFault, LinkLost, Refused, UsageError, on_failure
from drivers.interfaces import PERIOD_NS, Arm, Vector3
from drivers.ur.link import preflight as arm_preflight
from drivers.ur.link.preflight import CHECK_CONNECTION, DASHBOARD_PORT, Dashboard
from grasp import signals
from grasp.clock import Clock, WallClock
from scenarios.lab.hand import Say, retry
from scenarios.rigs.permission import MotionPermit, arm_address, arm_of, driving, require
from scenarios.rigs.wired import open_arm
from scenarios.trial.config import TrialConfig

MOST_STEP_M = 0.005
SPEED_MPS, ACCELERATION_MPS2 = 0.01, 0.1  # slow; assumed
STOP_MPS2 = 1.0  # as in a safe state
MOVE_S, STAND_S = 5.0, 3.0
PRESS = "press the emergency stop if it still moves"


def check_step(config: TrialConfig, step_m: Vector3) -> None:
    """Raises UsageError for no step or one too long, Refused for one out of the workspace, which is
    measured from where it begins."""
    length_m = math.hypot(*step_m)
    if not 0.0 < length_m <= MOST_STEP_M + 1e-9:
        most = f"above 0, to {MOST_STEP_M * 1e3:g} mm in all"
        raise UsageError(f"a step of {length_m * 1e3:g} mm", most)
    s = config.arm
    box = zip("xyz", s.workspace_low_m, step_m, s.workspace_high_m, strict=True)
    for axis, low_m, by_m, high_m in box:
        if not low_m <= by_m <= high_m:
            raise Refused(
                f"{by_m * 1e3:+g} mm in {axis} leaves the workspace",
                f"{low_m * 1e3:g} to {high_m * 1e3:g} mm, arm.workspace_low_m and _high_m",
            )


def step_arm(
    config: TrialConfig, permit: MotionPermit | None, step_m: Vector3, say: Say
) -> Vector3:
    """One straight step in the base frame, at 10 mm/s; where the tool stands then, m. Ctrl-C stops
    it, which ``say`` is told once it is seen.

    Raises UsageError without a permit, as ``check_step``, and the drivers' errors.
    """
    require(permit)
    check_step(config, step_m)
    clock = WallClock(WallClock().now_ns)
    with driving(arm_of(config)), open_arm(config, lambda: clock.now_ns) as arm:
        arm.poll(clock.now_ns)
        arm.set_payload(config.arm.payload_kg)
        arm.poll(clock.now_ns)
        x, y, z = _place(arm)
        dx, dy, dz = step_m
        with on_failure(lambda: say(_stopped(arm, clock))):
            arm.move_to((x + dx, y + dy, z + dz), SPEED_MPS, ACCELERATION_MPS2)
            _until_stands(arm, clock, MOVE_S, interruptible=True)
        return _place(arm)


def _place(arm: Arm) -> Vector3:
    if arm.state is None:
        raise LinkLost("the arm sends no state", CHECK_CONNECTION)
    return arm.state.position_m


def _until_stands(arm: Arm, clock: Clock, within_s: float, interruptible: bool) -> None:
    end_ns = clock.now_ns + round(within_s * 1e9)
    while clock.now_ns < end_ns:
        if interruptible:
            signals.check()
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        arm.poll(clock.now_ns)
        if arm.state is not None and not arm.state.moving:
            return
    raise DeviceFault("the arm did not come to stand in time", PRESS)


def _stopped(arm: Arm, clock: Clock) -> str:
    """How the arm is once it was told to stop; raises nothing."""

    def stand() -> None:
        arm.stop(STOP_MPS2)
        _until_stands(arm, clock, STAND_S, interruptible=False)

    with signals.deferred(sealed=True):
        stands = retry(stand, clock)
    if stands:
        return "the arm stands"
    with suppress(Exception):
        if arm.state is not None and arm.state.stopped_by_safety:
            return "the arm is stopped by its own safety system"
    return f"NOT SEEN TO STAND: {PRESS}"


def stop_arm(config: TrialConfig) -> Vector3:
    """End whatever program moves the arm, by its dashboard, and look until it stands; where, m.

    Raises LinkLost, and DeviceFault where it is not seen to stand.
    """
    if config.devices.arm:
        raise UsageError("an arm of another package has no dashboard", PRESS)
    host, timeout_s = arm_address(config), config.ur.step_timeout_s
    try:
        with Dashboard(host, timeout_s) as dashboard:
            dashboard.line()
            dashboard.request("stop")
    except (OSError, ValueError) as error:
        raise LinkLost(
            f"dashboard at {host}:{DASHBOARD_PORT}: {str(error) or 'no answer'}",
            f"{PRESS}; {CHECK_CONNECTION}",
        ) from None
    end_s = time.monotonic() + STAND_S
    while time.monotonic() < end_s:
        before, now = arm_preflight.read_status(host, timeout_s)
        if before.stationary and now.stationary:
            x, y, z = now.pose[:3]
            return x, y, z
    raise DeviceFault("the arm is not seen to stand", PRESS)
