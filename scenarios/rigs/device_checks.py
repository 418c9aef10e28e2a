"""Checks of a rig's devices: state and plausible data. They only read; nothing moves."""

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any, Literal

from drivers.checks import Check, Finding, checked, failed
from drivers.errors import ConfigError, DeviceFault, GraspError, Refused
from drivers.interfaces import OPEN_COUNTS, PERIOD_NS
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.protocol import (
    FAULTS,
    REGISTERS,
    RTU,
    SET_BASIC_MODE,
    TCP,
    StatusRegisters,
    check_not_scissor,
    implausible_values,
    mode_warning,
)
from drivers.robotiq.settings import ModbusSettings
from drivers.takktile.driver import TakkTileDriver
from drivers.ur.link import preflight as arm_preflight
from drivers.ur.link.preflight import preflight, require_ur_rtde
from grasp.run.clock import WallClock
from scenarios.rigs.calibration import calibration, describe_calibration, weak_claim
from scenarios.rigs.config import HARDWARE, AnyRigConfig, GraspRigConfig
from scenarios.rigs.permission import (
    arm_address,
    board_address,
    devices_of,
    driving,
    gripper_address,
)
from scenarios.rigs.rig import CLOSED_AND_INACTIVE
from scenarios.rigs.wired import open_board

APART_S = 0.1  # between two readings of the gripper
FRAMES = 100  # of the fingertips, after those for the rest
FRAMES_S = 5.0  # timeout for these frames
MOST_LOST = 0.2  # share of ticks without a frame; assumed: a run is stale after five in a row
ASSUMED = "counts per newton and decision rule are assumed, not measured on these fingertips"
WRONG_DEVICE = "the data are implausible: check that the address is this device's, and its cable"


def ask_devices(
    config: AnyRigConfig, would_run: Callable[[Any], object] = lambda config: None
) -> list[Check]:
    """Checks of everything that a run on the rig needs; ``would_run`` raises where a run would be
    refused before it opens a device."""
    cell, arm = checked("cell", partial(_cell, config)), arm_checks(config)
    board = checked("fingertips", partial(_board, config))
    if not isinstance(config, GraspRigConfig):
        return [cell, *arm, board]
    gripper = checked("gripper", partial(_gripper, config))
    known = checked("calibration", partial(_calibration, config))  # needs the devices
    guard = [] if known.status == "fail" else [
        checked("force guard", partial(_guard, config, would_run))
    ]  # fmt: skip
    return [cell, gripper, *arm, board, known, *guard]


def _calibration(config: GraspRigConfig) -> Finding:
    """Check that a calibration is chosen; a run is refused without one."""
    chosen = calibration(config)
    if config.rig == HARDWARE and weak_claim(chosen):
        return "warn", describe_calibration(chosen)  # measured, or it would have been refused
    return "ok", describe_calibration(chosen)


def _guard(config: GraspRigConfig, would_run: Callable[[Any], object]) -> Finding:
    would_run(config)
    source = getattr(config, "source", None)  # of a trial's settings
    notes = [] if source is None else source.in_words() or [ASSUMED]
    return "ok", "\n".join(["the limits can be kept with this hand and these settings", *notes])


def _cell(config: AnyRigConfig) -> Finding:
    """Check that no other process drives the devices, by acquiring their locks for an instant."""
    try:
        devices = devices_of(config)
    except ConfigError:  # reported by the check of the device
        return "warn", "not checked: an address is missing"
    with driving(*devices):  # raises an error that names the other process
        return "ok", "not in use by another run on this machine"


def read_gripper(config: GraspRigConfig) -> tuple[StatusRegisters, StatusRegisters]:
    """Two readings of its registers, APART_S apart; writes nothing. Raises the link's errors."""
    return read_registers(config.modbus, config.gripper.link)


def read_registers(
    modbus: ModbusSettings, link: Literal["tcp", "rtu"] = "tcp"
) -> tuple[StatusRegisters, StatusRegisters]:
    """As ``read_gripper``, of the gripper at an address."""
    first = (TCP if link == "tcp" else RTU).status_register
    with closing(ModbusTransport(modbus, link)) as transport:

        def read() -> StatusRegisters:
            words = transport.read(first, REGISTERS, time.monotonic_ns())
            try:
                return StatusRegisters.from_registers(words)
            except ValueError as error:
                raise DeviceFault(f"invalid status registers: {error}", WRONG_DEVICE) from error

        before = read()
        time.sleep(APART_S)
        return before, read()


def _gripper(config: GraspRigConfig) -> Finding:
    gripper_address(config)  # raises without an address
    if config.devices.gripper:
        return _plugin_device("gripper", config)
    before, now = read_gripper(config)
    if implausible := implausible_values(now, before):
        return "fail", "; ".join(implausible), WRONG_DEVICE
    fault = FAULTS[now.fault]
    state = "active" if now.ready else "not activated"
    if fault.code:
        return "fail", f"answers, {state}; {fault.text}", fault.remedy
    if now.ready:
        check_not_scissor(now.mode)
    counts = tuple(finger.position for finger in now.fingers)
    if max(counts) > OPEN_COUNTS:
        release = "support the held object, then `grasp release`: a run starts with an open hand"
        remedy = release if now.ready else CLOSED_AND_INACTIVE
        return "fail", f"{state}, no fault, but not open: at {counts} counts", remedy, Refused.kind
    if not now.ready:
        remedy = "`grasp gripper activate`, with an empty hand: a run activates no real hand"
        status = "fail" if config.real else "warn"
        return status, f"answers, not activated, no fault{now.zeros_note}", remedy, Refused.kind
    summary = f"answers, active, no fault, open at {counts} counts"
    if mode := mode_warning(now.mode):
        return "warn", f"{summary}, {mode}", SET_BASIC_MODE
    return "ok", summary


def arm_checks(config: Any) -> list[Check]:
    """Checks of the arm's controller; moves nothing, raises nothing."""
    if config.devices.arm:
        return [checked("arm", lambda: _plugin_device("arm", config))]
    timeout_s = config.ur.step_timeout_s
    try:
        host = arm_address(config)
        found = preflight(host, timeout_s, config.ur.upper_registers)
    except GraspError as error:
        return [failed("arm", error)]
    checks = [check._replace(name=f"arm {check.name}", kind="") for check in found]
    try:
        require_ur_rtde()
    except GraspError as error:
        checks.append(failed("arm client", error))
    if any(check.name.startswith("rtde") and check.status != "ok" for check in found):
        return checks  # the pose is read by RTDE too
    return [*checks, checked("arm pose", lambda: _arm_pose(host, timeout_s))]


def _arm_pose(host: str, timeout_s: float) -> Finding:
    before, now = arm_preflight.read_status(host, timeout_s)
    if implausible := arm_preflight.implausible_values(now, before):
        return "fail", "; ".join(implausible), WRONG_DEVICE
    if not now.running:
        return "warn", "unknown while the robot has no power"
    if not now.stationary:
        return "fail", arm_preflight.ARM_MOVES, arm_preflight.END_PROGRAM
    x, y, z = (at * 1e3 for at in now.pose[:3])
    return "ok", f"at rest, tool at x {x:.0f}, y {y:.0f}, z {z:.0f} mm"


def _board(config: AnyRigConfig) -> Finding:
    """Open the rig's board, read its rest codes and frames, and close it again."""
    board_address(config)  # raises without an address
    if config.devices.fingertips:
        return _plugin_device("fingertips", config)
    clock = WallClock()
    with open_board(config, lambda: clock.now_ns) as tips:
        return _check_frames(tips, clock)


def _check_frames(tips: TakkTileDriver, clock: WallClock) -> Finding:
    tips.begin_rest()
    different: set[bytes] = set()
    fresh = ticks = 0
    tick_ns = clock.now_ns
    end_ns = tick_ns + round(FRAMES_S * 1e9)
    while fresh < FRAMES and clock.now_ns < end_ns:
        tick_ns += PERIOD_NS
        clock.sleep_until_ns(tick_ns)
        tips.poll(clock.now_ns)  # raises for implausible rest codes
        if (frame := tips.frame) is not None:
            ticks += 1
            fresh += not frame.missed
            different.add(frame.raw.tobytes())
    if tips.frame is None or fresh < FRAMES:
        return "fail", "the board is connected but sends too few frames", WRONG_DEVICE
    lost = 1 - fresh / ticks
    rest = f"rest {tips.frame.rest.min()} to {tips.frame.rest.max()}"
    summary = f"{tips.frame.raw.size} taxels, {rest}, {lost:.0%} of the frames lost"
    if len(different) == 1:
        return "fail", f"{summary}: no code changes at all", WRONG_DEVICE
    if lost > MOST_LOST:
        return "fail", summary, "use another USB port, end other programs"
    return "ok", summary


def _plugin_device(device: str, config: Any) -> Finding:
    """Check that a device of another package is installed. Opening it might move it."""
    config.devices.check_installed()
    return "warn", f"{config.devices.label(device)}: of another package, not queried"


def other_devices(config: GraspRigConfig) -> dict[str, str]:
    """State of the arm and the fingertips as text, for commands that open only the hand; moves and
    raises nothing."""
    arm = "; ".join(check.detail for check in arm_checks(config) if check.status != "ok")
    board = checked("fingertips", partial(_board, config))
    return {"arm": arm or "answers, ready", "fingertips": board.detail}
