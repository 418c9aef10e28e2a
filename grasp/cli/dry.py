"""What `grasp run` will move on real devices, how fast, how hard, and what will be asked; its
`--dry-run`, which reads and moves nothing."""

import argparse
from typing import Any

from drivers.errors import DeviceFault, UsageError
from grasp.cli import exits
from grasp.cli.output import json_line
from grasp.cli.parser import Parser
from grasp.cli.trials import is_asked, trials_of


def add_dry_run(parser: Parser) -> None:
    parser.flag("--dry-run", "on real devices: query them, print what would move, and move nothing")


def run(config: Any, args: argparse.Namespace) -> int:
    """Exits 0 only where that run would start. Raises UsageError on a rig without real devices."""
    from scenarios.rigs.device_checks import ask_devices
    from scenarios.rigs.permission import check_devices
    from scenarios.trial.execution import make_guard

    _of_devices(config)
    if args.resume or args.out is not None:
        remedy = "leave --out and --resume out: a dry run opens no file"
        raise UsageError("--dry-run looks at devices and settings alone", remedy)
    check_devices(config)
    config = _as_run(config, args)
    make_guard(config)  # raises where a limit cannot be kept
    config.make_detector(3)
    return _told(_plan(config, args), ask_devices(config, make_guard), args)


def acquire(config: Any, course: Any, args: argparse.Namespace) -> int:
    """As ``run``, of an acquisition; ``course``: its strokes."""
    from scenarios.acquire.force_calibration import counts_per_newton
    from scenarios.rigs.device_checks import ask_pressing_devices
    from scenarios.rigs.permission import check_devices

    _of_devices(config)
    check_devices(config)
    counts_per_newton(config, args.seed)  # raises where nobody has measured it
    return _told(press_plan(config, course, args.seconds), ask_pressing_devices(config), args)


def press_plan(config: Any, course: Any, seconds: float) -> list[str]:
    """What moves in an acquisition."""
    from drivers.interfaces import FINGER_NAMES

    control, finger = config.control, FINGER_NAMES[config.finger]
    stroke = (
        f"by {control.turn_rad:g} rad at {course.spin_radps:g} rad/s" if course.spin_radps
        else f"by {control.stroke_m * 1e3:.0f} mm at {course.speed_mps * 1e3:.0f} mm/s"
    )  # fmt: skip
    way = "" if course.spin_radps else f" along {course.direction} degrees of the fingertip"
    return [
        f"lower the arm at {control.approach_mps * 1e3:g} mm/s until finger {finger} feels "
        f"{control.touch_n:g} N, for {config.session.touch_timeout_s:g} s at most; the hand stays "
        "as it is",
        f"press with {control.force_n:g} N, by the arm, {control.depth_m * 1e3:g} mm deep at most",
        f"stroke there and back {stroke}{way}, for {seconds:g} s",
        f"stop, and go back to where it began at {config.session.retreat_mps * 1e3:g} mm/s",
    ]


def _told(would: list[str], checks: list[Any], args: argparse.Namespace) -> int:
    against = [check for check in checks if check.status == "fail"]
    code = _code(against)
    if args.json:
        told = {"would": would, "checks": [check._asdict() for check in checks]}
        print(json_line({**told, "exit_code": code}))
        return code
    print("\n".join(f"would {line}" for line in would))
    for check in checks:
        if check.status != "ok":
            exits.report_line(f"{check.name}: {check.detail} ({check.remedy})")
    print("would not start" if against else "would start")
    return code


def _code(against: list[Any]) -> int:
    """Of the run that would not start: who drives the cell is asked first, then all devices are
    opened, and only then the hand is looked at."""
    if not against:
        return exits.SUCCESS
    codes = [exits.code_of(check.kind or DeviceFault.kind) for check in against]
    driven = against[0].name == "cell"
    return codes[0] if driven or exits.DEVICE not in codes else exits.DEVICE


def plan(config: Any, args: argparse.Namespace) -> list[str]:
    """What moves and what is asked, in turn. Raises ConfigError for what would be refused."""
    from scenarios.trial.execution import make_guard

    config = _as_run(config, args)
    make_guard(config)
    return _plan(config, args)


def _as_run(config: Any, args: argparse.Namespace) -> Any:
    """The settings as that run uses them."""
    from scenarios.lab.ready import gently
    from scenarios.tap.tap import tap

    if args.scenario == "tap":
        return tap.configure(config.for_tap())
    return gently(config) if args.first else config


def _plan(config: Any, args: argparse.Namespace) -> list[str]:
    from scenarios.rigs.rig import calibration

    controller, guard, known = config.controller, config.guard, calibration(config)
    closing_mmps = max(controller.closing_speed_mps, known.least_speed_mps) * 1e3
    lift, asked = args.scenario == "lift", is_asked(args)
    stopped = ", and stop it where the object slips" if lift else ""
    up_mm = controller.retreat_m * 1e3
    again = f", and lift the arm by {up_mm:.0f} mm" if up_mm else ""
    plan = []
    if args.first:
        plan.append("close them in free air to where they would grasp, and open them again")
    if asked:
        plan.append(f"ask for {config.object.name} to be put between the fingers")
    plan += [
        f"close the fingers, to {config.object.grip_counts} counts and on, at up to "
        f"{closing_mmps:.0f} mm/s, no finger told more than {guard.force_limit_n:g} N (byte 0 of "
        f"this hand: {known.least_force_n:g} N)",
        f"lift the arm by {controller.lift_height_m * 1e3:.0f} mm at "
        f"{controller.lift_speed_mps * 1e3:.0f} mm/s{stopped}",
    ]
    if not lift:
        plan.append("ask for the object to be tapped, the arm standing up there")
    if asked:
        plan.append(f"ask how far the object's mark {'slipped' if lift else 'moved'}, mm")
    plan.append(
        "keep holding it" if controller.keep
        else f"lower the arm at {controller.lower_speed_mps * 1e3:.0f} mm/s, open the "
        f"fingers{again}"
    )  # fmt: skip
    if (trials := trials_of(args)) > 1:
        plan.append(f"do so {trials} times, each from where the first began")
    return plan


def _of_devices(config: Any) -> None:
    from scenarios.rigs.permission import HARDWARE

    if config.rig != HARDWARE:
        told = f"rig {config.rig} moves nothing real"
        raise UsageError(f"--dry-run is for a lab's own devices: {told}", "leave it out")
