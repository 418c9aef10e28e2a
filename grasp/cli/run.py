"""`grasp run SCENARIO`: lifts, taps or an acquisition, displayed and recorded; their dry runs."""

import argparse
import json
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.detector import check_weights, rule_of_weights, warn_of_untuned_rule
from grasp.cli.lab import motion_permit, say, warn_of_height, warn_of_mode, warn_of_slow_arm
from grasp.cli.output import show
from scenarios.campaign.config import load_config, load_lift
from scenarios.rigs.calibration import describe_calibration
from scenarios.rigs.config import HARDWARE
from scenarios.rigs.permission import check_devices
from scenarios.trial.layers import trial_layers

FIRST_OBJECT = "foam"  # with --first, the softest


def run_lift(args: argparse.Namespace) -> int:
    assignments = [*args.set, *(["controller.keep=true"] if args.keep else [])]
    if args.scenario == "tap" and args.direction is not None:
        assignments.append(f"tap.direction={args.direction}")
    object_name = FIRST_OBJECT if args.first and args.object is None else args.object
    if args.scenario == "lift" and args.force is not None:
        if args.first:
            problem = "--first closes to the counts of the object's file, and --force by touch"
            raise UsageError(problem, "use one of them")
        assignments.append(f"controller.first_force_n={args.force:g}")
        assignments.insert(0, "controller.first_grasp=touch")
    others = (args.rig, args.detector, args.config, assignments, args.profile)
    by_touch = args.scenario == "lift" and not args.first
    config = load_lift(object_name, *others) if by_touch else load_config(object_name, *others)
    if by_touch and args.force is not None and config.controller.first_grasp != "touch":
        raise UsageError("--force is for a first grasp by touch", "leave out first_grasp=counts")
    if args.dry_run:
        _check_real(config)
        from grasp.cli.plans import dry_run

        return dry_run(config, args)
    permit = _permit(config, args)
    from grasp.cli.trials import run_trials
    from scenarios.campaign.experiments import EXPERIMENTS
    from scenarios.trial.execution import make_guard

    make_guard(config)  # raises before any output if the limit cannot be kept
    if permit is not None:
        from grasp.cli.plans import as_run, plan

        for line in plan(as_run(config, args), args):
            say(f"will {line}")
        warn_of_height(config)
        warn_of_slow_arm(config)
        warn_of_mode(config)
    if args.first:
        from grasp.cli.first_lift import begin_first

        config = begin_first(config, permit, args)
        make_guard(config)
    check_weights(config)
    grip_n, limit_n = config.controller.grip_force_n, config.guard.force_limit_n
    if grip_n > limit_n:
        say(f"grip force {grip_n:g} N is reduced to guard.force_limit_n, {limit_n:g} N")

    def begin() -> None:
        if not args.json and (rule := rule_of_weights(config)):
            print(rule)
        warn_of_untuned_rule(config, trial_layers(object_name or "can", *others))

    scenario = EXPERIMENTS[args.scenario].select(config)
    return run_trials(args, scenario, permit, begin)


run_tap = run_lift


def _check_real(config: Any) -> None:
    if config.rig != HARDWARE:
        problem = f"--dry-run is for real devices, and rig {config.rig} has none"
        raise UsageError(problem, "leave it out, or use --rig hardware")


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
    from scenarios.acquire import acquire
    from scenarios.acquire.config import load_acquire_config
    from scenarios.acquire.press import motion

    config = load_acquire_config(args.surface, args.rig, args.config, args.set)
    course = motion(args.direction, args.speed, acquire.TURN_RADPS)
    if args.dry_run:
        _check_real(config)
        from grasp.cli.plans import dry_acquisition

        return dry_acquisition(config, course, args)
    permit = _permit(config, args)
    if permit is not None:
        from grasp.cli.plans import press_plan

        for line in press_plan(config, course, args.seconds):
            say(f"will {line}")
        warn_of_slow_arm(config)
    from grasp.cli.live import Display
    from grasp.cli.trials import is_paced

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
