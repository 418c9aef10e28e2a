"""`grasp run SCENARIO`: one lift, a series of taps or an acquisition, live and recorded."""

import argparse
import json
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import add_confirmation, add_runs, add_settings, decimal, motion_permit, seed
from grasp.cli.trials import add_series_options, paced, run_trials

HELP = "run a scenario"
SPEED_MPS, SECONDS = 0.05, 20.0  # of an acquisition


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("run", help=HELP, description=HELP)
    parser.add_argument(
        "scenario",
        choices=("lift", "tap", "acquire"),
        help="lift: lift an object held too weakly; tap: strike an object held at the force cap; "
        "acquire: press one fingertip on a fixed surface and stroke it, for labelled slip data",
    )
    add_trial_options(parser, rig="emulated")
    add_acquire_options(parser)
    add_runs(parser)
    parser.add_argument(
        "--keep",
        action="store_true",
        help="lift: keep holding the object instead of setting it down",
    )
    parser.add_argument(
        "-v", "--verbose", action="store_true",
        help="say also by how much physics the simulated world was computed, and why",
    )  # fmt: skip
    add_series_options(parser)
    parser.add_argument(
        "--direction",
        metavar="DIR",
        help="tap: top, side (across the closing axis), alternate (the two in turn), or closing "
        "(along that axis; default: alternate); acquire: degrees in the fingertip's plane in steps "
        "of 45, or cw or ccw (default: 0)",
    )
    parser.add_argument(
        "--pace",
        choices=("real", "max"),
        help="on the simulated rig: virtual time at the wall's pace, or as fast as it can "
        "(default: real in a terminal, max otherwise)",
    )
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )
    add_confirmation(parser)
    parser.set_defaults(handler=run)


def add_trial_options(parser: argparse.ArgumentParser, rig: str) -> None:
    """Options that choose what is run; `grasp config` knows them too."""
    parser.add_argument(
        "--object",
        default="can",
        metavar="NAME",
        help="one of config/objects (default: %(default)s)",
    )
    parser.add_argument(
        "--rig",
        default=rig,
        metavar="NAME",
        help="emulated (real protocols to a cell in another process), simulated (virtual time), "
        "or hardware (default: %(default)s)",
    )
    parser.add_argument(
        "--profile",
        default="default",
        metavar="NAME",
        help="one of config/profiles: how detector, decision and reaction are set together "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--detector",
        metavar="NAME",
        help="one of config/detectors (default: the profile's)",
    )
    parser.add_argument(
        "--seed",
        type=seed,
        default=0,
        metavar="N",
        help="of everything random, 0 or more (default: %(default)s)",
    )
    add_settings(parser)


def add_acquire_options(parser: argparse.ArgumentParser) -> None:
    """Options of `grasp run acquire` alone; it uses neither an object nor a detector."""
    parser.add_argument(
        "--surface",
        metavar="NAME",
        help="acquire: one of config/surfaces: planar, sphere, cylinder-x, cylinder-y "
        "(default: planar)",
    )
    parser.add_argument(
        "--speed",
        type=decimal(0.004, 0.2),
        metavar="MPS",
        help="acquire: commanded speed of a stroke, m/s; a rotation turns at 1 rad/s "
        f"(default: {SPEED_MPS})",
    )
    parser.add_argument(
        "--seconds",
        type=decimal(1, 3600),
        metavar="S",
        help=f"acquire: length of the recording (default: {SECONDS:g})",
    )


def run(args: argparse.Namespace) -> int:
    from scenarios.campaign.config import load_config
    from scenarios.trial.execution import make_guard

    if args.taps is not None:
        raise UsageError("--taps is called --trials now", f"--trials {args.taps}")
    if strange := _strange_option(args):
        raise UsageError(f"{strange} is no option of {args.scenario}", "leave it out")
    if args.scenario == "acquire":
        return _acquire(args)
    assignments = [*args.set, *(["controller.keep=true"] if args.keep else [])]
    if args.direction is not None:
        assignments.append(f"tap.direction={args.direction}")
    config = load_config(
        args.object, args.rig, args.detector, args.config, assignments, args.profile
    )
    permit = _permit(config, args)
    make_guard(config)  # a limit that cannot be kept is refused before anything is shown
    scenario = config.for_lift() if args.scenario == "lift" else config.for_tap()
    return run_trials(args, scenario, permit)


def _permit(config: Any, args: argparse.Namespace) -> Any:
    """Leave to move what the rig has, if it is known which devices are meant."""
    from scenarios.rigs.permission import check_devices

    leave = motion_permit(config, args)
    check_devices(config)
    return leave


def _strange_option(args: argparse.Namespace) -> str:
    """An option of another scenario, if one was given."""
    series = ("trials", "out", "resume")
    own = {"lift": ("keep", *series), "tap": ("direction", *series),
           "acquire": ("direction", "surface", "speed", "seconds")}  # fmt: skip
    for option in ("keep", *series, "direction", "surface", "speed", "seconds"):
        if getattr(args, option) not in (None, False) and option not in own[args.scenario]:
            return f"--{option}"
    return ""


def _acquire(args: argparse.Namespace) -> int:
    from grasp.cli.live import Display
    from scenarios.acquire import acquire
    from scenarios.acquire.config import load_acquire_config
    from scenarios.acquire.press import motion

    config = load_acquire_config(
        "planar" if args.surface is None else args.surface, args.rig, args.config, args.set
    )
    course = motion(
        "0" if args.direction is None else args.direction,
        args.speed or SPEED_MPS,
        acquire.TURN_RADPS,
    )
    permit = _permit(config, args)
    with Display(args.rig, quiet=args.json) as display:
        display.setting_up(hand=False)
        finished = acquire.run(
            config, course, args.seed, args.seconds or SECONDS, args.runs, paced(args),
            display.sample, permit,
        )  # fmt: skip
    failure = finished.failure
    if not args.json:
        print(finished.as_text())
    elif failure is None:
        print(finished.as_json())
    if failure is None:
        return exits.SUCCESS
    extra = {"result": json.loads(finished.as_json())} if args.json else {}
    return exits.report_failure(failure, args.json, **extra)
