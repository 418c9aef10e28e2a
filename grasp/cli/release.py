"""`grasp release`: open the fingers of a rig that was left holding something."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits

HELP = "open the fingers of a gripper that was left closed"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "release",
        help=HELP,
        description=HELP + ". Support the object first: it falls when the fingers open.",
    )
    parser.add_argument(
        "--rig",
        default="simulated",
        metavar="NAME",
        help="one of config/rigs (default: %(default)s)",
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="TOML over the packaged settings (default: $GRASP_CONFIG)",
    )
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )
    parser.set_defaults(handler=release)


def release(args: argparse.Namespace) -> int:
    import json

    from scenarios.campaign.config import load_config
    from scenarios.rigs.release import release_gripper

    config = load_config("can", args.rig, "energy", args.config)
    positions = release_gripper(config, config.controller.approach_speed_mps)
    if args.json:
        print(json.dumps({"rig": args.rig, "positions_counts": positions}))
    else:
        print(f"released: fingers open at {positions} counts")
    return exits.SUCCESS
