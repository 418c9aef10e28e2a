"""Motion of a real arm without a run: a short slow step, the way back to a run's start, a stop."""

import math
import time
from collections.abc import Callable
from contextlib import suppress

import msgspec

from drivers.errors import DeviceFault, LinkLost, Refused, UsageError, on_failure
from drivers.interfaces import PERIOD_NS, Arm, Vector3
from drivers.ur.link import preflight as arm_preflight
from drivers.ur.link.connections import CHECK_CONNECTION, DASHBOARD_PORT, Dashboard
from grasp.run import signals
from grasp.run.clock import Clock, WallClock
from scenarios.lab.hand import Say, retry
from scenarios.rigs.permission import MotionPermit, arm_address, arm_of, driving, require
from scenarios.rigs.wired import open_arm
from scenarios.trial.config import TrialConfig

replace = msgspec.structs.replace

MOST_STEP_M = 0.005
SAME_M = 0.001
MOST_BACK_M = 0.3  # a run of the packaged profiles ends at most 0.25 m above its start
SPEED_MPS, ACCELERATION_MPS2 = 0.01, 0.1  # slow; assumed
STOP_MPS2 = 1.0  # as in a safe state
MOVE_S, STOP_S = 5.0, 3.0
PRESS = "press the emergency stop if it still moves"


def check_step(config: TrialConfig, step_m: Vector3) -> None:
    """Raises UsageError for a zero or too long step, Refused for one beyond the workspace, which is
    relative to the start of the step."""
    length_m = math.hypot(*step_m)
    if not 0.0 < length_m <= MOST_STEP_M + 1e-9:
        most = f"above 0, to {MOST_STEP_M * 1e3:g} mm in all"
        raise UsageError(f"a step of {length_m * 1e3:g} mm is not possible", most)
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
    """Move one straight step in the base frame at 10 mm/s; returns the tool's position, m. Ctrl-C
    stops the arm; ``say`` then gets the observed result.

    Raises UsageError without a permit, the errors of ``check_step``, and the drivers' errors.
    """
    check_step(config, step_m)
    return _move(config, permit, lambda at_m: step_m, say)


def check_back(at_m: Vector3, start_m: Vector3) -> Vector3:
    """The straight way back from a position to a run's start in the base frame, m.

    Raises Refused where it is no short vertical way, as a run makes it, because something may stand
    in another one."""
    x, y, z = (start - at for at, start in zip(at_m, start_m, strict=True))
    if math.hypot(x, y) > MOST_STEP_M or abs(z) > MOST_BACK_M:
        raise Refused(
            f"the run began at x {x * 1e3:+.1f}, y {y * 1e3:+.1f}, z {z * 1e3:+.1f} mm from here: "
            "not straight above or below",
            "move the arm with the teach pendant",
        )
    return x, y, z


def way_back(config: TrialConfig, start_m: Vector3) -> Vector3:
    """The way of ``check_back`` from the arm's present position. Raises LinkLost."""
    _, now = arm_preflight.read_status(arm_address(config), config.ur.step_timeout_s)
    x, y, z = now.pose[:3]
    return check_back((x, y, z), start_m)


def move_back(
    config: TrialConfig, permit: MotionPermit | None, start_m: Vector3, say: Say
) -> Vector3:
    """Move back to a run's start at 10 mm/s, also below the workspace of this position, which is
    inside that of the run; otherwise as ``step_arm``."""
    require(permit)
    low_x, low_y, low_z = config.arm.workspace_low_m
    seen_m = way_back(config, start_m)
    widened = replace(config.arm, workspace_low_m=(low_x, low_y, min(low_z, seen_m[2] - 0.001)))

    def way(at_m: Vector3) -> Vector3:
        by_m = check_back(at_m, start_m)
        off_m = math.dist(by_m, seen_m)
        if off_m > SAME_M:  # the status is of the controller's own tool
            raise Refused(
                f"the controller's tool position differs by {off_m * 1e3:.0f} mm from ours",
                "set the controller's tool offset as in ur.tcp_offset, and keep the arm at rest",
            )
        return by_m

    return _move(replace(config, arm=widened), permit, way, say)


def _move(
    config: TrialConfig, permit: MotionPermit | None, way: Callable[[Vector3], Vector3], say: Say
) -> Vector3:
    require(permit)
    clock = WallClock(WallClock().now_ns)
    with driving(arm_of(config)), open_arm(config, lambda: clock.now_ns) as arm:
        arm.poll(clock.now_ns)
        arm.set_payload(config.arm.payload_kg)
        arm.poll(clock.now_ns)
        x, y, z = at_m = _position(arm)
        dx, dy, dz = by_m = way(at_m)
        with on_failure(lambda: say(_stop(arm, clock))):
            arm.move_to((x + dx, y + dy, z + dz), SPEED_MPS, ACCELERATION_MPS2)
            within_s = MOVE_S + math.hypot(*by_m) / SPEED_MPS
            _wait_until_stopped(arm, clock, within_s, interruptible=True)
        return _position(arm)


def _position(arm: Arm) -> Vector3:
    if arm.state is None:
        raise LinkLost("the arm sends no state", CHECK_CONNECTION)
    return arm.state.position_m


def _wait_until_stopped(arm: Arm, clock: Clock, within_s: float, interruptible: bool) -> None:
    end_ns = clock.now_ns + round(within_s * 1e9)
    while clock.now_ns < end_ns:
        if interruptible:
            signals.check()
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        arm.poll(clock.now_ns)
        if arm.state is not None and not arm.state.moving:
            return
    raise DeviceFault(f"the arm did not stop within {within_s:g} s", PRESS)


def _stop(arm: Arm, clock: Clock) -> str:
    """Stop the arm and return its observed state as text; raises nothing."""

    def stop() -> None:
        arm.stop(STOP_MPS2)
        _wait_until_stopped(arm, clock, STOP_S, interruptible=False)

    with signals.deferred(ignore_checks=True):
        stopped = retry(stop, clock)
    if stopped:
        return "the arm has stopped"
    with suppress(Exception):
        if arm.state is not None and arm.state.stopped_by_safety:
            return "the arm is stopped by its safety system"
    return f"STOP OF THE ARM NOT CONFIRMED: {PRESS}"


def stop_arm(config: TrialConfig) -> Vector3:
    """Stop any program on the arm through its dashboard and wait until the arm has stopped; returns
    its position, m.

    Raises LinkLost, and DeviceFault if the stop is not confirmed.
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
            f"dashboard at {host}:{DASHBOARD_PORT}: {str(error) or 'no reply'}",
            f"{PRESS}; {CHECK_CONNECTION}",
        ) from None
    end_s = time.monotonic() + STOP_S
    while time.monotonic() < end_s:
        before, now = arm_preflight.read_status(host, timeout_s)
        if before.stationary and now.stationary:
            x, y, z = now.pose[:3]
            return x, y, z
    raise DeviceFault("the stop of the arm is not confirmed", PRESS)
