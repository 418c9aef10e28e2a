"""`grasp run SCENARIO`: one lift, a series of taps or an acquisition, live and recorded."""

import argparse
import json
from typing import Any

from grasp.cli import dry, exits, first
from grasp.cli.lab import tell_mode, tell_slow, will
from grasp.cli.options import (
    OBJECT_HELP,
    add_confirmation,
    add_runs,
    add_settings,
    decimal,
    motion_permit,
    seed,
)  # fmt: skip
from grasp.cli.parser import Parser, group, verb
from grasp.cli.places import folder_to_fill
from grasp.cli.rules import check_weights, rule_of_weights, tell_untuned
from grasp.cli.trials import add_series_options, log_end, logged, paced, run_trials

HELP = "run a scenario"
SPEED_MPS, SECONDS = 0.05, 20.0  # of an acquisition


def add_parser(verbs: Any) -> None:
    scenarios = group(verbs, "run", HELP, "SCENARIO", dest="scenario")
    _add_lift(scenarios)
    _add_tap(scenarios)
    _add_acquire(scenarios)


def _add_lift(scenarios: Any) -> None:
    parser = verb(scenarios, "lift", run, "lift an object held too weakly")
    add_trial_options(parser, rig="emulated")
    parser.flag("--keep", "keep holding the object instead of setting it down")
    parser.flag("--first", "a lab's first lift: close in free air, then lift a soft object, at "
        "half speed and the least force, with a question before each")  # fmt: skip
    add_series_options(parser, "lift")
    dry.add_dry_run(parser)
    _add_common(parser)


def _add_tap(scenarios: Any) -> None:
    parser = verb(scenarios, "tap", run, "strike an object held at the force cap")
    add_trial_options(parser, rig="emulated")
    parser.option("--direction DIR", "direction of the taps: top, side (across the closing axis), "
        "alternate (the two in turn), or closing (along that axis; default: "
        "alternate)")  # fmt: skip
    add_series_options(parser, "tap")
    parser.refuse("--taps", because="it is called --trials")
    dry.add_dry_run(parser)
    _add_common(parser)
    parser.set_defaults(keep=False, first=False)


def _add_acquire(scenarios: Any) -> None:
    """It uses neither an object nor a detector."""
    parser = verb(scenarios, "acquire", run,
        "press one fingertip on a fixed surface and stroke it, for labelled slip data",
    )  # fmt: skip
    parser.option("--surface NAME", "one of config/surfaces: planar, sphere, cylinder-x, "
        "cylinder-y, or the path of a .toml file", default="planar")  # fmt: skip
    parser.option("--direction DIR", "degrees in the fingertip's plane in steps of 45, or cw or "
        "ccw", default="0")  # fmt: skip
    parser.option("--speed MPS", "commanded speed of a stroke, m/s; a rotation turns at 1 rad/s",
        decimal(0.004, 0.2), default=SPEED_MPS)  # fmt: skip
    parser.option("--seconds S", "length of the recording", decimal(1, 3600), default=SECONDS)
    _add_rig(parser, rig="emulated")
    dry.add_dry_run(parser)
    _add_common(parser)


def _add_common(parser: Parser) -> None:
    add_runs(parser, folder_to_fill)
    parser.option("-v --verbose", "write a log with wall-clock times to --runs; for simulated "
        "lifts and taps print the contact level too", action="store_true")  # fmt: skip
    parser.flag("--view", "show the run on a page in a browser, on this machine only; opens it if "
        "there is a display, and prints its address on standard error")  # fmt: skip
    parser.option("--pace", "on the simulated rig: virtual time in real time, or as fast as "
        "possible (default: real in a terminal and with --view, max otherwise)",
        choices=("real", "max"))  # fmt: skip
    parser.flag("--json", "one JSON object on standard output, nothing else")
    add_confirmation(parser)


def add_trial_options(parser: Parser, rig: str) -> None:
    """Options that choose what is run; `grasp config` knows them too."""
    parser.option("--object NAME", f"{OBJECT_HELP} (default: %(default)s)", default="can")
    parser.option("--profile NAME", "one of config/profiles: how detector, decision and reaction "
        "are set together", default="default")  # fmt: skip
    parser.option("--detector NAME", "one of config/detectors, one that an installed package "
        "offers, or one of your own: FILE.py:NAME or FILE.onnx (default: the "
        "profile's)")  # fmt: skip
    _add_rig(parser, rig)


def _add_rig(parser: Parser, rig: str) -> None:
    parser.option("--rig NAME", "emulated (real protocols to a cell in another process), simulated "
        "(virtual time), hardware, or a .toml file based on one of these",
        default=rig)  # fmt: skip
    parser.option("--seed N", "random seed, 0 or more (default: 0)", seed, default=0)
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    from scenarios.campaign.config import EXPERIMENTS, load_config
    from scenarios.trial.execution import make_guard
    from scenarios.trial.layers import trial_layers

    if args.scenario == "acquire":
        return _acquire(args)
    assignments = [*args.set, *(["controller.keep=true"] if args.keep else [])]
    if args.scenario == "tap" and args.direction is not None:
        assignments.append(f"tap.direction={args.direction}")
    thing = first.object_of(args)
    chosen = (thing, args.rig, args.detector, args.config, assignments, args.profile)
    config = load_config(*chosen)
    if args.dry_run:
        return dry.run(config, args)
    permit = _permit(config, args)
    make_guard(config)  # a limit that cannot be kept is refused before anything is shown
    if permit is not None:
        for line in dry.plan(config, args):
            will(line)
        tell_slow(config)
        tell_mode(config)
    if args.first:
        config = first.begin(config, permit, args)
        make_guard(config)
    check_weights(config)

    def begin() -> None:
        if not args.json and (rule := rule_of_weights(config)):
            print(rule)
        tell_untuned(config, trial_layers(*chosen))

    return run_trials(args, EXPERIMENTS[args.scenario].own(config), permit, begin)


def _permit(config: Any, args: argparse.Namespace) -> Any:
    """Leave to move what the rig has, if it is known which devices are meant."""
    from scenarios.rigs.permission import check_devices

    leave = motion_permit(config, args)
    check_devices(config)
    if leave is not None:
        for line in _sources(config):
            exits.report_line(line)
    return leave


def _sources(config: Any) -> list[str]:
    """How figures that are not of the manual's making were come by: a line each."""
    from scenarios.rigs.calibration import in_words

    hand = getattr(config, "calibration", None)
    source = getattr(config, "source", None)  # an acquisition has neither
    return [*([] if hand is None else [in_words(hand)]), *(source.in_words() if source else ())]


def _acquire(args: argparse.Namespace) -> int:
    from grasp.cli.live import Display, viewed
    from scenarios.acquire import acquire
    from scenarios.acquire.config import load_acquire_config
    from scenarios.acquire.press import motion
    from scenarios.report.live.feed import LiveAcquisition

    config = load_acquire_config(args.surface, args.rig, args.config, args.set)
    course = motion(args.direction, args.speed, acquire.TURN_RADPS)
    if args.dry_run:
        return dry.acquire(config, course, args)
    permit = _permit(config, args)
    if permit is not None:
        for line in dry.press_plan(config, course, args.seconds):
            will(line)
        tell_slow(config)
    title = f"acquisition on {config.surface.name} · seed {args.seed}"
    with (
        logged(args, config.surface.name, config.rig) as log,
        Display(config.rig, quiet=args.json) as display,
        viewed(args, lambda: LiveAcquisition(config, title, args.seconds)) as live,
    ):
        display.setting_up(hand=False)

        def show(sample: Any) -> None:
            display.sample(sample)
            if log is not None:
                log.sample(sample)
            if live is not None:
                live.watch(sample)

        finished = acquire.run(
            config, course, args.seed, args.seconds, args.runs, paced(args), show, permit
        )
        if live is not None:
            live.feed.say(finished.in_short())
        if log is not None:
            log_end(log, f"seed {finished.seed}: {finished.in_short()}", finished.failure)
    failure = finished.failure
    if not args.json:
        print(finished.as_text())
    elif failure is None:
        print(finished.as_json())
    if failure is None:
        return exits.SUCCESS
    extra = {"result": json.loads(finished.as_json())} if args.json else {}
    return exits.report_failure(failure, args.json, **extra)
