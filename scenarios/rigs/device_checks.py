"""How the devices of a rig are, and whether what they say can be: read, nothing moved."""

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any, Literal, NamedTuple

from drivers.errors import ConfigError, DeviceFault, GraspError, Refused
from drivers.interfaces import OPEN_COUNTS, PERIOD_NS
from drivers.robotiq.modbus import ModbusSettings, ModbusTransport
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
from drivers.takktile.driver import TakkTileDriver
from drivers.ur.link import preflight as arm_preflight
from drivers.ur.link.preflight import preflight
from grasp.clock import WallClock
from scenarios.rigs.calibration import in_words, weak_claim
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.permission import (
    HARDWARE,
    arm_address,
    board_address,
    devices_of,
    driving,
    gripper_address,
)
from scenarios.rigs.rig import CLOSED_AND_INACTIVE, calibration
from scenarios.rigs.wired import open_board

Finding = tuple[str, ...]  # status and what was found; the remedy where all is not well
APART_S = 0.1  # between two looks at the gripper
FRAMES = 100  # of the fingertips, after those that the rest is taken from
FRAMES_S = 5.0  # for which a board may take to send them
MOST_LOST = 0.2  # share of ticks without a frame; assumed: a run is stale after five in a row
ASSUMED = "counts a newton and rule are assumed, not measured on these fingertips"
STRANGE = "this is not what such a device says: is it another one, or its cable?"


class Check(NamedTuple):
    """One finding: status is ok, warn or fail; the remedy is empty when all is well. ``kind``: of
    the error that a run would end with, where that is no fault of a device."""

    name: str
    status: str
    detail: str
    remedy: str = ""
    kind: str = ""


def failed(name: str, error: Exception) -> Check:
    """A failure made of whatever error came instead of a finding."""
    if isinstance(error, GraspError):
        return Check(name, "fail", error.message, error.remedy, error.kind)
    return Check(name, "fail", f"{type(error).__name__}: {error}", "see the message")


def checked(name: str, look: Callable[[], Finding]) -> Check:
    """The finding, or the failure."""
    try:
        return Check(name, *look())
    except Exception as error:  # a doctor reports, whatever it meets
        return failed(name, error)


def ask_devices(
    config: AnyRigConfig, would_run: Callable[[Any], object] = lambda config: None
) -> list[Check]:
    """Everything that a run of the rig needs; ``would_run`` raises where one would be refused
    before anything is opened."""
    checks = [checked("cell", partial(_cell, config))]
    if isinstance(config, GraspRigConfig):
        known = checked("calibration", partial(_calibration, config))
        guard = [] if known.status == "fail" else [
            checked("force guard", partial(_guard, config, would_run))
        ]  # fmt: skip
        checks = [known, *guard, *checks, checked("gripper", partial(_gripper, config))]
    return [*checks, *arm_checks(config), checked("fingertips", partial(_board, config))]


def _calibration(config: GraspRigConfig) -> Finding:
    """Has somebody said which hand this is? A run is refused where nobody has."""
    chosen = calibration(config)
    if config.rig == HARDWARE and weak_claim(chosen):
        return "warn", in_words(chosen), "is it so? `grasp calibrate hand` measures it"
    return "ok", in_words(chosen)


def _guard(config: GraspRigConfig, would_run: Callable[[Any], object]) -> Finding:
    would_run(config)
    source = getattr(config, "source", None)  # of a trial's settings
    told = [] if source is None else source.in_words() or [ASSUMED]
    return "ok", "; ".join(["the limits can be kept with this hand and these settings", *told])


def _cell(config: AnyRigConfig) -> Finding:
    """Does a run drive it? Its locks are held for an instant, and let go."""
    try:
        devices = devices_of(config)
    except ConfigError:  # reported by the check of the device
        return "warn", "not looked at: an address is missing"
    with driving(*devices):  # raises the name of who does
        return "ok", "driven by no run of this machine"


def read_gripper(config: GraspRigConfig) -> tuple[StatusRegisters, StatusRegisters]:
    """Two looks at its registers, a moment apart; writes nothing. Raises what its link raises."""
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
                raise DeviceFault(f"it answers with {error}", STRANGE) from error

        before = read()
        time.sleep(APART_S)
        return before, read()


def _gripper(config: GraspRigConfig) -> Finding:
    gripper_address(config)  # raises where nobody has said which
    if config.devices.gripper:
        return _foreign("gripper", config)
    before, now = read_gripper(config)
    if strange := implausible_values(now, before):
        return "fail", "; ".join(strange), STRANGE
    fault = FAULTS[now.fault]
    state = "active" if now.ready else "not activated"
    if fault.code:
        return "fail", f"answers, {state}; {fault.text}", fault.remedy
    if now.ready:
        check_not_scissor(now.mode)
    places = tuple(finger.position for finger in now.fingers)
    if max(places) > OPEN_COUNTS:
        let_go = "support what it holds, then `grasp release`: a run begins with an open hand"
        remedy = let_go if now.ready else CLOSED_AND_INACTIVE
        return "fail", f"{state}, no fault, but not open: at {places} counts", remedy, Refused.kind
    if not now.ready:
        remedy = "`grasp gripper activate`, with an empty hand: a run does it to no real one"
        status = "fail" if config.real else "warn"
        return status, "answers, not activated, no fault", remedy, Refused.kind
    well = f"answers, active, no fault, open at {places} counts"
    if strange_mode := mode_warning(now.mode):
        return "warn", f"{well}, {strange_mode}", SET_BASIC_MODE
    return "ok", well


def arm_checks(config: Any) -> list[Check]:
    """How the arm's controller is; moves nothing, raises nothing."""
    if config.devices.arm:
        return [checked("arm", lambda: _foreign("arm", config))]
    timeout_s = config.ur.step_timeout_s
    try:
        host = arm_address(config)
        report = preflight(host, timeout_s)
    except GraspError as error:
        return [failed("arm", error)]
    checks = [Check(f"arm {c.name}", c.status, c.detail, c.remedy) for c in report.checks]
    if report.version is None:
        return checks
    return [*checks, checked("arm pose", lambda: _arm_pose(host, timeout_s))]


def _arm_pose(host: str, timeout_s: float) -> Finding:
    before, now = arm_preflight.read_status(host, timeout_s)
    if strange := arm_preflight.implausible_values(now, before):
        return "fail", "; ".join(strange), STRANGE
    if not now.running:
        return "warn", "not known while the robot has no power"
    if not now.stationary:
        return "fail", arm_preflight.ARM_MOVES, arm_preflight.END_PROGRAM
    x, y, z = (at * 1e3 for at in now.pose[:3])
    return "ok", f"stands, tool at x {x:.0f}, y {y:.0f}, z {z:.0f} mm"


def _board(config: AnyRigConfig) -> Finding:
    """Open the board that the rig names, read it, take its rest, and let it go again."""
    board_address(config)  # raises where nobody has said which
    if config.devices.fingertips:
        return _foreign("fingertips", config)
    clock = WallClock()
    with open_board(config, lambda: clock.now_ns) as tips:
        return _listened(tips, clock)


def _listened(tips: TakkTileDriver, clock: WallClock) -> Finding:
    tips.begin_rest()
    seen: dict[bytes, None] = {}
    fresh = ticks = 0
    tick_ns = clock.now_ns
    end_ns = tick_ns + round(FRAMES_S * 1e9)
    while fresh < FRAMES and clock.now_ns < end_ns:
        tick_ns += PERIOD_NS
        clock.sleep_until_ns(tick_ns)
        tips.poll(clock.now_ns)  # raises where the rest cannot be right
        if (frame := tips.frame) is not None:
            ticks += 1
            fresh += not frame.missed
            seen[frame.raw.tobytes()] = None
    if tips.frame is None or fresh < FRAMES:
        return "fail", "the board is there and sends too few frames", STRANGE
    lost = 1 - fresh / ticks
    rest = f"rest {tips.frame.rest.min()} to {tips.frame.rest.max()}"
    told = f"{tips.frame.raw.size} taxels, {rest}, {lost:.0%} of the frames lost"
    if len(seen) == 1:
        return "fail", f"{told}: no code changes at all", STRANGE
    if lost > MOST_LOST:
        return "fail", told, "use another USB port, end other programs"
    return "ok", told


def _foreign(device: str, config: Any) -> Finding:
    """A device of another package: is it installed? Opening it might move it."""
    config.devices.check_offered()
    return "warn", f"{config.devices.called(device)}: of another package, not asked"


def other_devices(config: GraspRigConfig) -> dict[str, str]:
    """How the arm and the fingertips are, in words, once a hand was opened without them; moves and
    raises nothing."""
    arm = "; ".join(check.detail for check in arm_checks(config) if check.status != "ok")
    board = checked("fingertips", partial(_board, config))
    return {"arm": arm or "answers, ready", "fingertips": board.detail}
