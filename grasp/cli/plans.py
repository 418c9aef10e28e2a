"""What `grasp run` would do: motions in words, and dry runs on real devices."""

from collections.abc import Sequence

from drivers.checks import Check, failures
from drivers.errors import DeviceFault, UsageError
from drivers.interfaces import FINGER_NAMES, FINGERS
from grasp.cli import exits
from grasp.cli.commands import AcquireOptions, RunOptions, TrialsOptions
from grasp.cli.lab import say
from grasp.cli.output import show
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import TOUCH_N, StrokeMotion
from scenarios.acquire.session import RETREAT_MPS, TOUCH_TIMEOUT_S, counts_per_newton
from scenarios.campaign.config import UNNAMED, RunConfig
from scenarios.lab.preflight import gentle_settings
from scenarios.rigs.calibration import calibration
from scenarios.rigs.device_checks import ask_devices
from scenarios.rigs.permission import check_devices
from scenarios.tap.tap import tap
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard


def dry_run(config: RunConfig, args: TrialsOptions) -> int:
    """Print plan and checks; exit code 0 only if the run would start. Raises UsageError."""
    if args.resume or args.out is not None:
        raise UsageError("--dry-run checks only devices and settings, and opens no file",
                         "leave out --out and --resume")  # fmt: skip
    check_devices(config)
    used = as_run(config, args)
    used.make_detector(FINGERS)
    return _print_dry_run(plan(used, args), ask_devices(used, make_guard), args)


def dry_acquisition(config: AcquireConfig, course: StrokeMotion, args: AcquireOptions) -> int:
    check_devices(config)
    counts_per_newton(config, args.seed)  # raises if it was not measured
    return _print_dry_run(press_plan(config, course, args.seconds), ask_devices(config), args)


def _print_dry_run(would: list[str], checks: Sequence[Check], args: RunOptions) -> int:
    failed = failures(checks)
    code = dry_code(failed)
    if not args.json:
        print("\n".join(f"would {line}" for line in would))
        for check in checks:
            if check.status != "ok":
                remedy = f" ({check.remedy})" if check.remedy else ""
                say(f"{check.name}: {check.detail}{remedy}")
    value = {"would": would, "checks": [check._asdict() for check in checks], "exit_code": code}
    return show(args, value, "would not start" if failed else "would start", code)


def dry_code(failed: list[Check]) -> int:
    """Exit code of a run with these failed checks; it checks cell, devices and hand in order."""
    if not failed:
        return exits.SUCCESS
    codes = [exits.code_of(check.kind or DeviceFault.kind) for check in failed]
    of_cell = failed[0].name == "cell"
    return codes[0] if of_cell or exits.DEVICE not in codes else exits.DEVICE


def as_run(config: RunConfig, args: TrialsOptions) -> TrialConfig:
    """The settings as the run uses them; raises ConfigError for settings that it would refuse, such
    as a limit that cannot be kept."""
    used: TrialConfig = gentle_settings(config) if args.first else config
    if args.scenario == "tap":
        used = tap.configure(config.for_tap())
    make_guard(used)
    return used


def plan(config: TrialConfig, args: TrialsOptions) -> list[str]:
    """Motions and questions of a lift or a series of taps, in order."""
    controller, limit_n, known = config.controller, config.guard.force_limit_n, calibration(config)
    closing_mmps = max(controller.closing_speed_mps, known.least_speed_mps) * 1e3
    lift, asked, trials = args.scenario == "lift", args.asked, args.number
    up_mm = controller.retreat_m * 1e3
    retreat = f", and lift the arm by {up_mm:.0f} mm" if up_mm else ""
    lower_mmps = controller.lower_speed_mps * 1e3
    stops = lift and "slip_stop_mps2" not in controller.unread
    stop = f", and stop it at {controller.slip_stop_mps2:g} m/s2 when the object slips"
    lines = [
        args.first and "close the fingers in free air to the grasp positions, and open them again",
        asked and f"ask for {_object(config)} to be put between the fingers",
        f"close the fingers {_where(config)} and further, at up to "
        f"{closing_mmps:.0f} mm/s, with at most {limit_n:g} N commanded per finger (byte 0 of this "
        f"hand: {known.least_force_n:g} N)",
        f"lift the arm by {controller.lift_height_m * 1e3:.0f} mm at "
        f"{controller.lift_speed_mps * 1e3:.0f} mm/s{stop if stops else ''}",
        not lift and "ask for taps on the object, with the arm at rest",
        asked and f"ask how far the object's mark {'slipped' if lift else 'moved'}, mm",
        "keep holding the object" if controller.keep
        else f"lower the arm at {lower_mmps:.0f} mm/s, open the fingers{retreat}",
        trials > 1 and f"do this {trials} times, each from the first start position",
    ]  # fmt: skip
    return [line for line in lines if line]


def _object(config: TrialConfig) -> str:
    return "an object" if config.object.name == UNNAMED else config.object.name


def _where(config: TrialConfig) -> str:
    if config.controller.first_grasp != "touch":
        return f"to {config.object.grip_counts} counts"
    return f"until the fingertips feel {config.controller.first_force_n:g} N"


def press_plan(config: AcquireConfig, course: StrokeMotion, seconds: float) -> list[str]:
    """Motions of an acquisition, in order."""
    control, finger = config.control, FINGER_NAMES[config.finger]
    stroke = f"by {control.turn_rad:g} rad at {course.spin_radps:g} rad/s"
    if not course.spin_radps:
        stroke = (f"by {control.stroke_m * 1e3:.0f} mm at {course.speed_mps * 1e3:.0f} mm/s along "
                  f"{course.direction} degrees of the fingertip")  # fmt: skip
    return [
        f"lower the arm at {control.approach_mps * 1e3:g} mm/s until finger {finger} measures "
        f"{TOUCH_N:g} N, for {TOUCH_TIMEOUT_S:g} s at most; the hand does not move",
        f"press with {control.force_n:g} N by the arm, at most {control.depth_m * 1e3:g} mm deep",
        f"stroke back and forth {stroke}, for {seconds:g} s",
        f"stop, and return to the start position at {RETREAT_MPS * 1e3:g} mm/s",
    ]
