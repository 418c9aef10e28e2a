"""What the devices of a rig say of themselves, and whether that can be: read, nothing moved."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from drivers.errors import ConfigError, DeviceFault, GraspError, Refused
from drivers.interfaces import OPEN_COUNTS, PERIOD_NS
from drivers.robotiq.modbus import ModbusTransport
from drivers.robotiq.protocol import (
    FAULTS,
    REGISTERS,
    RTU,
    TCP,
    TO_BASIC,
    StatusRegisters,
    check_closing,
    doubts,
    other_than_basic,
)
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.link import ReadingThread
from drivers.ur.link import preflight as arm_look
from drivers.ur.link.preflight import preflight
from grasp.clock import WallClock
from scenarios.rigs.calibration import in_words, weak_claim
from scenarios.rigs.checks import Check, guarded
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, PressRigConfig
from scenarios.rigs.own_devices import check_offered
from scenarios.rigs.permission import (
    HARDWARE,
    arm_address,
    board_address,
    devices_of,
    driving,
    gripper_address,
)
from scenarios.rigs.rig import CLOSED_AND_INACTIVE, calibration
from scenarios.rigs.wired import board_finder

APART_S = 0.1  # between two looks at the gripper
LISTEN = 100  # frames of the fingertips, after those that the rest is taken from
LISTEN_S = 5.0  # for which a board may take to send them
MOST_LOST = 0.2  # share of ticks without a frame; assumed: a run is stale after five in a row
ASSUMED = "counts a newton and rule are assumed, not measured on these fingertips"
STRANGE = "this is not what such a device says: is it another one, or its cable?"


def ask_devices(config: GraspRigConfig, would_run: Callable[[Any], object]) -> list[Check]:
    """Everything that a run of the rig needs; ``would_run`` raises where one would be refused
    before anything is opened."""
    asked = {"calibration": _calibration, "cell": _cell, "gripper": _gripper}
    checks = [guarded(name, partial(ask, config)) for name, ask in asked.items()]
    if checks[0].status != "fail":
        checks.insert(1, guarded("force guard", lambda: _guard(config, would_run)))
    return [*checks, *arm_checks(config), guarded("fingertips", lambda: _board(config))]


def ask_pressing_devices(config: PressRigConfig) -> list[Check]:
    """As ``ask_devices``, of a rig without a hand."""
    cell, board = (guarded(name, partial(ask, config))
                   for name, ask in (("cell", _cell), ("fingertips", _board)))  # fmt: skip
    return [cell, *arm_checks(config), board]


def _calibration(config: GraspRigConfig) -> Check:
    """Has somebody said which hand this is? A run is refused where nobody has."""
    chosen = calibration(config)
    if config.rig == HARDWARE and weak_claim(chosen):
        is_it = "is it so? `grasp calibrate hand` measures it"
        return Check("calibration", "warn", in_words(chosen), is_it)
    return Check("calibration", "ok", in_words(chosen))


def _guard(config: GraspRigConfig, would_run: Callable[[Any], object]) -> Check:
    would_run(config)
    source = getattr(config, "source", None)  # of a trial's settings
    told = [] if source is None else source.in_words() or [ASSUMED]
    kept = "the limits can be kept with this hand and these settings"
    return Check("force guard", "ok", "; ".join([kept, *told]))


def _cell(config: AnyRigConfig) -> Check:
    """Does a run drive it? Its locks are held for an instant, and let go."""
    try:
        devices = devices_of(config)
    except ConfigError:  # told by whoever asks the device
        return Check("cell", "warn", "not looked at: an address is missing")
    with driving(*devices):  # raises the name of who does
        return Check("cell", "ok", "driven by no run of this machine")


def read_gripper(config: GraspRigConfig) -> tuple[StatusRegisters, StatusRegisters]:
    """Two looks at its registers, a moment apart; writes nothing. Raises what its link raises."""
    link = TCP if config.gripper.link == "tcp" else RTU
    transport = ModbusTransport(config.modbus, config.gripper.link)

    def read() -> StatusRegisters:
        words = transport.read(link.status_register, REGISTERS, time.monotonic_ns())
        try:
            return StatusRegisters.from_registers(words)
        except ValueError as error:
            raise DeviceFault(f"it answers with {error}", STRANGE) from error

    try:
        first = read()
        time.sleep(APART_S)
        return first, read()
    finally:
        transport.close()


def _gripper(config: GraspRigConfig) -> Check:
    gripper_address(config)  # raises where nobody has said which
    if config.devices.gripper:
        return _foreign("gripper", config)
    before, now = read_gripper(config)
    if strange := doubts(now, before):
        return Check("gripper", "fail", "; ".join(strange), STRANGE)
    fault = FAULTS[now.fault]
    state = "active" if now.ready else "not activated"
    if fault.code:
        return Check("gripper", "fail", f"answers, {state}; {fault.text}", fault.remedy)
    if now.ready:
        check_closing(now.mode)
    places = tuple(finger.position for finger in now.fingers)
    if max(places) > OPEN_COUNTS:
        return Check(
            "gripper", "fail", f"{state}, no fault, but not open: at {places} counts",
            "support what it holds, then `grasp release`: a run begins with an open hand"
            if now.ready else CLOSED_AND_INACTIVE, Refused.kind,
        )  # fmt: skip
    if not now.ready:
        return Check(
            "gripper", "fail" if config.real else "warn", "answers, not activated, no fault",
            "`grasp gripper activate`, with an empty hand: a run does it to no real one",
            Refused.kind,
        )  # fmt: skip
    well = f"answers, active, no fault, open at {places} counts"
    if strange_mode := other_than_basic(now.mode):
        return Check("gripper", "warn", f"{well}, {strange_mode}", TO_BASIC)
    return Check("gripper", "ok", well)


def arm_checks(config: Any) -> list[Check]:
    """Ask the arm's controller how it is; moves nothing, raises nothing."""
    if config.devices.arm:
        return [guarded("arm", lambda: _foreign("arm", config))]
    try:
        host = arm_address(config)
        report = preflight(host, config.ur.step_timeout_s)
    except GraspError as error:
        return [Check("arm", "fail", error.message, error.remedy, error.kind)]
    checks = [Check(f"arm {c.name}", c.status, c.detail, c.remedy) for c in report.checks]
    if report.version is None:
        return checks
    return [*checks, guarded("arm pose", lambda: _arm_pose(host, config.ur.step_timeout_s))]


def _arm_pose(host: str, timeout_s: float) -> Check:
    before, now = arm_look.look(host, timeout_s)
    if strange := arm_look.doubts(now, before):
        return Check("arm pose", "fail", "; ".join(strange), STRANGE)
    if not now.running:
        return Check("arm pose", "warn", "not known while the robot has no power")
    if not now.stands:
        return Check("arm pose", "fail", arm_look.MOVES, arm_look.END_IT)
    x, y, z = (at * 1e3 for at in now.pose[:3])
    return Check("arm pose", "ok", f"stands, tool at x {x:.0f}, y {y:.0f}, z {z:.0f} mm")


def _board(config: AnyRigConfig) -> Check:
    """Open the board that the rig names, listen to it, take its rest, and let it go again."""
    board_address(config)  # raises where nobody has said which
    if config.devices.fingertips:
        return _foreign("fingertips", config)
    clock = WallClock()
    reading = ReadingThread(
        board_finder(config, lambda: clock.now_ns), config.tactile, lambda: clock.now_ns
    )
    with TakkTileDriver(reading, config.tactile) as tips:
        return _listened(tips, clock)


def _listened(tips: TakkTileDriver, clock: WallClock) -> Check:
    tips.begin_rest()
    seen: dict[bytes, None] = {}
    heard = ticks = 0
    tick_ns = clock.now_ns
    end_ns = tick_ns + round(LISTEN_S * 1e9)
    while heard < LISTEN and clock.now_ns < end_ns:
        tick_ns += PERIOD_NS
        clock.sleep_until_ns(tick_ns)
        tips.pump(clock.now_ns)  # raises where the rest cannot be right
        if (frame := tips.frame) is not None:
            ticks += 1
            heard += not frame.missed
            seen[frame.raw.tobytes()] = None
    if tips.frame is None or heard < LISTEN:
        return Check("fingertips", "fail", "the board is there and sends too few frames", STRANGE)
    lost = 1 - heard / ticks
    rest = f"rest {tips.frame.rest.min()} to {tips.frame.rest.max()}"
    told = f"{tips.frame.raw.size} taxels, {rest}, {lost:.0%} of the frames lost"
    if len(seen) == 1:
        return Check("fingertips", "fail", f"{told}: no code changes at all", STRANGE)
    if lost > MOST_LOST:
        return Check("fingertips", "fail", told, "use another USB port, end other programs")
    return Check("fingertips", "ok", told)


def _foreign(device: str, config: Any) -> Check:
    """A device of another package: is it installed? Opening it might move it."""
    check_offered(config.devices)
    return Check(device, "warn", f"{config.devices.called(device)}: of another package, not asked")
