"""`grasp run SCENARIO`: lifts, taps or an acquisition, displayed and recorded; their dry runs."""

import argparse
import json
import time
from typing import Any

from drivers.errors import DeviceFault, UsageError
from drivers.interfaces import FINGER_NAMES
from grasp import signals
from grasp.cli import exits
from grasp.cli.detector import check_weights, rule_of_weights, warn_of_untuned_rule
from grasp.cli.lab import TerminalOperator, motion_permit, say, warn_of_mode, warn_of_slow_arm
from grasp.cli.live import Display
from grasp.cli.output import show
from grasp.cli.trials import is_asked, is_paced, run_trials, trials_of
from scenarios.acquire import acquire
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.press import motion
from scenarios.acquire.session import counts_per_newton
from scenarios.campaign.config import load_config
from scenarios.campaign.experiments import EXPERIMENTS
from scenarios.lab.preflight import (
    SOFTEST_OBJECT,
    STOP_INSTRUCTIONS,
    close_in_free_air,
    gentle_settings,
)
from scenarios.rigs.calibration import describe_calibration
from scenarios.rigs.device_checks import ask_devices
from scenarios.rigs.permission import HARDWARE, check_devices
from scenarios.rigs.rig import calibration
from scenarios.trial.execution import make_guard
from scenarios.trial.layers import trial_layers

QUIT = "q"
POLL_S = 0.05


def run_lift(args: argparse.Namespace) -> int:
    assignments = [*args.set, *(["controller.keep=true"] if args.keep else [])]
    if args.scenario == "tap" and args.direction is not None:
        assignments.append(f"tap.direction={args.direction}")
    object_name = SOFTEST_OBJECT if args.first and args.object == "can" else str(args.object)
    chosen = (object_name, args.rig, args.detector, args.config, assignments, args.profile)
    config = load_config(*chosen)
    if args.dry_run:
        return _dry_run(config, args)
    permit = _permit(config, args)
    make_guard(config)  # raises before any output if the limit cannot be kept
    if permit is not None:
        for line in plan(_as_run(config, args), args):
            say(f"will {line}")
        warn_of_slow_arm(config)
        warn_of_mode(config)
    if args.first:
        config = _begin_first(config, permit, args)
        make_guard(config)
    check_weights(config)

    def begin() -> None:
        if not args.json and (rule := rule_of_weights(config)):
            print(rule)
        warn_of_untuned_rule(config, trial_layers(*chosen))

    scenario = EXPERIMENTS[args.scenario].select(config)
    return run_trials(args, scenario, permit, begin)


run_tap = run_lift


def _permit(config: Any, args: argparse.Namespace) -> Any:
    """Permission to move the rig's devices; prints the sources of measured values."""
    permit = motion_permit(config, args)
    check_devices(config)
    if permit is not None:  # the settings of an acquisition have neither
        if (hand := getattr(config, "calibration", None)) is not None:
            say(describe_calibration(hand))
        if (source := getattr(config, "source", None)) is not None:
            for line in source.in_words():
                say(line)
    return permit


def run_acquire(args: argparse.Namespace) -> int:
    config = load_acquire_config(args.surface, args.rig, args.config, args.set)
    course = motion(args.direction, args.speed, acquire.TURN_RADPS)
    if args.dry_run:
        return _dry_acquisition(config, course, args)
    permit = _permit(config, args)
    if permit is not None:
        for line in press_plan(config, course, args.seconds):
            say(f"will {line}")
        warn_of_slow_arm(config)
    with Display(config.rig, quiet=args.json) as display:
        display.setting_up(hand=False)
        done = acquire.run(
            config, course, args.seed, args.seconds, args.runs, is_paced(args), display.sample,
            permit,
        )  # fmt: skip
    if done.failure is None:
        return show(args, done, done.as_text)
    if not args.json:
        print(done.as_text())
    extra = {"result": json.loads(done.as_json())} if args.json else {}
    return exits.report_failure(done.failure, args.json, **extra)


# A lab's first lift


def _begin_first(config: Any, permit: Any, args: argparse.Namespace) -> Any:
    """Ask, close in free air, ask again; returns the settings of the gentle lift that follows.
    Raises UsageError on a rig without real devices, and if the person quits."""
    if permit is None or args.json or args.trials is not None or args.resume:
        raise UsageError("--first is one supervised lift on the rig hardware, without --json, "
                         "--trials and --resume", "leave these out, or --first")  # fmt: skip
    slow = gentle_settings(config)
    TerminalOperator().expect()
    for line in STOP_INSTRUCTIONS:
        print(f"  {line}")
    with signals.deferred():
        _ask("Step 1 of 2, free air: with an empty hand and the arm at rest, the fingers close to "
             f"the grasp positions of {config.object.name} without contact")  # fmt: skip
        moved = close_in_free_air(slow, permit, say)
        print(f"  {moved.summary()}, as expected")
        controller, guard = slow.controller, slow.guard
        _ask(f"Step 2 of 2, {config.object.name}: put it, or an object as soft, between the "
             f"fingers. The arm lifts it {controller.lift_height_m * 1e3:.0f} mm at "
             f"{controller.lift_speed_mps * 1e3:.0f} mm/s, with at most {guard.force_limit_n:g} N "
             "commanded per finger")  # fmt: skip
    return slow


def _ask(question: str) -> None:
    """Wait for Enter; raises UsageError for other input."""
    operator = TerminalOperator()
    operator.say(f"{question}. Enter: continue; {QUIT}: quit")
    while (line := operator.poll()) is None:
        signals.check()
        time.sleep(POLL_S)
    if line.strip():
        raise UsageError("quit by the operator: nothing more was moved", "start it again")


# Motion plans and dry runs


def _dry_run(config: Any, args: argparse.Namespace) -> int:
    """Print plan and checks; exit code 0 only if the run would start. Raises UsageError."""
    _check_real(config)
    if args.resume or args.out is not None:
        raise UsageError("--dry-run checks only devices and settings, and opens no file",
                         "leave out --out and --resume")  # fmt: skip
    check_devices(config)
    config = _as_run(config, args)
    make_guard(config)  # raises if the limit cannot be kept
    config.make_detector(3)
    return _print_dry_run(plan(config, args), ask_devices(config, make_guard), args)


def _dry_acquisition(config: Any, course: Any, args: argparse.Namespace) -> int:
    _check_real(config)
    check_devices(config)
    counts_per_newton(config, args.seed)  # raises if it was not measured
    return _print_dry_run(press_plan(config, course, args.seconds), ask_devices(config), args)


def _check_real(config: Any) -> None:
    if config.rig != HARDWARE:
        problem = f"--dry-run is for real devices, and rig {config.rig} has none"
        raise UsageError(problem, "leave it out, or use --rig hardware")


def _print_dry_run(would: list[str], checks: list[Any], args: argparse.Namespace) -> int:
    failed = [check for check in checks if check.status == "fail"]
    code = dry_code(failed)
    if not args.json:
        print("\n".join(f"would {line}" for line in would))
        for check in checks:
            if check.status != "ok":
                remedy = f" ({check.remedy})" if check.remedy else ""
                say(f"{check.name}: {check.detail}{remedy}")
    value = {"would": would, "checks": [check._asdict() for check in checks], "exit_code": code}
    return show(args, value, "would not start" if failed else "would start", code)


def dry_code(failed: list[Any]) -> int:
    """Exit code of a run with these failed checks; it checks cell, devices and hand in order."""
    if not failed:
        return exits.SUCCESS
    codes = [exits.code_of(check.kind or DeviceFault.kind) for check in failed]
    of_cell = failed[0].name == "cell"
    return codes[0] if of_cell or exits.DEVICE not in codes else exits.DEVICE


def _as_run(config: Any, args: argparse.Namespace) -> Any:
    """The settings as the run uses them; raises ConfigError for settings that it would refuse."""
    if args.scenario == "tap":
        config = EXPERIMENTS["tap"].configure(config.for_tap())
    elif args.first:
        config = gentle_settings(config)
    make_guard(config)
    return config


def plan(config: Any, args: argparse.Namespace) -> list[str]:
    """Motions and questions of a lift or a series of taps, in order."""
    controller, limit_n, known = config.controller, config.guard.force_limit_n, calibration(config)
    closing_mmps = max(controller.closing_speed_mps, known.least_speed_mps) * 1e3
    lift, asked, trials = args.scenario == "lift", is_asked(args), trials_of(args)
    up_mm = controller.retreat_m * 1e3
    retreat = f", and lift the arm by {up_mm:.0f} mm" if up_mm else ""
    lower_mmps = controller.lower_speed_mps * 1e3
    stops = lift and "slip_stop_mps2" not in controller.unread
    stop = f", and stop it at {controller.slip_stop_mps2:g} m/s2 when the object slips"
    lines = [
        args.first and "close the fingers in free air to the grasp positions, and open them again",
        asked and f"ask for {config.object.name} to be put between the fingers",
        f"close the fingers to {config.object.grip_counts} counts and further, at up to "
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


def press_plan(config: Any, course: Any, seconds: float) -> list[str]:
    """Motions of an acquisition, in order."""
    control, session, finger = config.control, config.session, FINGER_NAMES[config.finger]
    stroke = f"by {control.turn_rad:g} rad at {course.spin_radps:g} rad/s"
    if not course.spin_radps:
        stroke = (f"by {control.stroke_m * 1e3:.0f} mm at {course.speed_mps * 1e3:.0f} mm/s along "
                  f"{course.direction} degrees of the fingertip")  # fmt: skip
    return [
        f"lower the arm at {control.approach_mps * 1e3:g} mm/s until finger {finger} measures "
        f"{control.touch_n:g} N, for {session.touch_timeout_s:g} s at most; the hand does not move",
        f"press with {control.force_n:g} N by the arm, at most {control.depth_m * 1e3:g} mm deep",
        f"stroke back and forth {stroke}, for {seconds:g} s",
        f"stop, and return to the start position at {session.retreat_mps * 1e3:g} mm/s",
    ]
