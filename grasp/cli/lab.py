"""Shared by commands for real devices: settings, dry runs, permission to move, and warnings."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

from drivers.errors import GraspError, UsageError
from drivers.robotiq.protocol import SCISSOR, SET_BASIC_MODE, mode_warning
from grasp.cli import exits
from grasp.cli.commands import RosOptions, RunOptions
from grasp.cli.device_commands import LabOptions, MotionOptions
from grasp.cli.options import Json
from grasp.cli.output import print_json
from grasp.run import signals
from scenarios.acquire.config import AcquireConfig
from scenarios.campaign.config import RunConfig, load_for_devices
from scenarios.rigs.calibration import describe_calibration
from scenarios.rigs.config import HARDWARE, AnyRigConfig
from scenarios.rigs.permission import MotionPermit, arm_address, check_devices, permit
from scenarios.trial.config import TrialConfig

SAME_HEIGHT_M = 0.001
say = exits.report_line  # on standard error


def hardware_config(args: LabOptions) -> RunConfig:
    """Load settings for real devices; raises UsageError for a rig that has none."""
    config = load_for_devices("can", args.rig, args.config, args.set)
    if config.rig != HARDWARE:
        raise UsageError(
            f"rig {args.rig} has no real devices",
            "use --rig hardware, connected to `grasp emulate` for practice (docs/first-day.md)",
        )
    return config


class Done(NamedTuple):
    """Result of a command: text, value for --json (default: the text), and exit code."""

    text: str
    value: Mapping[str, object] | None = None
    code: int = exits.SUCCESS


Act = Callable[[MotionPermit | None], Done]


def print_done(args: Json, done: Done, key: str = "done") -> int:
    """Print a result, or the result of a dry run; returns the exit code."""
    if args.json:
        value = {key: done.text} if done.value is None else done.value
        print_json({**value, "exit_code": done.code})
    elif done.text:
        print(f"would {done.text}" if key == "would" else done.text)
    return done.code


def perform(
    args: MotionOptions, config: RunConfig, plan: Callable[[], str], look: Callable[[], str],
    act: Act,
    before: Callable[[], object] = lambda: None, moves: bool = True,
) -> int:  # fmt: skip
    """Run a command that moves real devices, or its dry run.

    ``plan`` describes the motion by the settings, for a refusal. ``look`` queries the devices for a
    dry run; it describes the motion and raises the errors that the motion would. ``before`` warns
    and asks. ``act`` moves, with the permit.
    """
    if args.dry_run:
        return print_done(args, Done(look()), "would")
    permit = motion_permit(config, args, plan) if moves else None
    before()
    with signals.deferred():
        done = act(permit)
    return print_done(args, done)


def motion_permit(
    config: AnyRigConfig,
    args: RunOptions | RosOptions | MotionOptions,
    plan: Callable[[], str] | None = None,
) -> MotionPermit | None:
    """Permission to move real devices; None if the rig has none. Without `--confirm-motion` it
    prints the motion and raises UsageError."""
    if args.confirm_motion and config.rig != HARDWARE:
        say(f"--confirm-motion has no effect: rig {args.rig} has no real devices")
    try:
        return permit(config, args.confirm_motion, args.config, args.set, args.rig)
    except UsageError:
        if plan is not None:
            with suppress(GraspError):
                say(f"would {plan()}")
        raise


def permit_run(config: TrialConfig | AcquireConfig, args: RunOptions) -> MotionPermit | None:
    """Permission for a run; prints the sources of measured values."""
    permit = motion_permit(config, args)
    check_devices(config)
    if permit is not None and isinstance(config, TrialConfig):
        if config.calibration is not None:
            say(describe_calibration(config.calibration))
        for line in config.source.in_words():
            say(line)
    return permit


# Warnings on standard error


def warn_of_slow_arm(config: AnyRigConfig) -> None:
    """Warn of a low speed slider. One that prevents a run is reported when the arm is opened."""
    if config.devices.arm:
        return
    from drivers.ur.link.preflight import check_speed_slider, read_status

    with suppress(GraspError):
        _, now = read_status(arm_address(config), config.ur.step_timeout_s)
        slider = check_speed_slider(now.speed_fraction)
        if slider.status == "warn":
            say(f"{slider.detail} ({slider.remedy})")


def warn_of_height(config: TrialConfig) -> None:
    """Say how far the arm stands above or below where the last run began."""
    if config.devices.arm:
        return
    from scenarios.lab.arm import way_back
    from scenarios.trial.run_folder import last_start

    with suppress(GraspError):  # no such run, or the arm was moved elsewhere since
        run, start_m = last_start(arm_address(config), None)
        up_m = -way_back(config, start_m)[2]
        if abs(up_m) > SAME_HEIGHT_M:
            where = "above" if up_m > 0.0 else "below"
            say(f"the arm stands {abs(up_m) * 1e3:.0f} mm {where} where {run} began "
                "(`grasp arm back` moves it there)")  # fmt: skip


def warn_of_mode(config: TrialConfig, opened: bool = False) -> None:
    """Warn of a hand that is not in basic mode. Scissor mode is reported when the hand is opened
    for closing, so it is included here only with ``opened``."""
    if config.devices.gripper:
        return
    from scenarios.rigs.device_checks import read_gripper

    with suppress(GraspError):
        _, now = read_gripper(config)
        mode = now.mode if now.ready and (opened or now.mode != SCISSOR) else 0
        if strange := mode_warning(mode):
            say(f"the hand is {strange} ({SET_BASIC_MODE})")
