"""`grasp run SCENARIO`: one trial, live in the terminal, judged and recorded."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits

HELP = "run one trial of a scenario"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("run", help=HELP, description=HELP)
    parser.add_argument("scenario", choices=("lift",), help="lift: lift an object held too weakly")
    add_trial_options(parser, rig="emulated")
    parser.add_argument(
        "--runs",
        type=Path,
        default=Path("runs"),
        metavar="DIR",
        help="folder of recordings (default: %(default)s)",
    )
    parser.add_argument(
        "--keep", action="store_true", help="keep holding the object instead of setting it down"
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
    parser.add_argument(
        "--confirm-motion",
        action="store_true",
        help="needed on the hardware rig, on every run: the cell is clear and somebody watches",
    )
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
        "--detector",
        default="energy",
        metavar="NAME",
        help="one of config/detectors (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        type=_seed,
        default=0,
        metavar="N",
        help="of everything random, 0 or more (default: %(default)s)",
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="TOML over the packaged settings (default: $GRASP_CONFIG)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        help="one setting; may be repeated; `grasp config show` lists them",
    )


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"{text!r} is no seed: a whole number, 0 to 2^63 - 1")
    return int(text)


def run(args: argparse.Namespace) -> int:
    import sys

    from grasp.cli.live import Display
    from scenarios import lift
    from scenarios.config import load_config

    assignments = [*args.set, *(["controller.keep=true"] if args.keep else [])]
    config = load_config(args.object, args.rig, args.detector, args.config, assignments)
    if config.rig == "hardware" and not args.confirm_motion:
        remedy = "clear the cell, have the emergency stop at hand, then add --confirm-motion"
        return exits.report("usage", "the hardware rig moves real devices", remedy, args.json)
    lift.make_guard(config)  # a limit that cannot be kept is refused before anything is shown
    paced = args.pace == "real" or (args.pace is None and sys.stdout.isatty() and not args.json)
    with Display(quiet=args.json) as display:
        display.setting_up(args.rig)
        finished = lift.run(config, args.seed, args.runs, paced=paced, on_tick=display.tick)
        display.close()
    return _report(finished, args)


def _report(finished: Any, args: argparse.Namespace) -> int:
    from grasp.cli.live import print_verdict

    failure = finished.failure
    if failure is not None:
        extra = {"result": finished.as_dict()} if args.json and finished.result else {}
        if finished.result is not None and not args.json:
            print_verdict(finished.result)
        return exits.report(failure.kind, failure.message, failure.remedy, args.json, **extra)
    if args.json:
        print(finished.as_json())
    else:
        print_verdict(finished.result)
    return exits.SUCCESS if finished.result.success else exits.TRIAL_FAILED
