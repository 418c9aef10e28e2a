"""`grasp release`: open the fingers of a rig that was left holding something."""

import argparse
from typing import Any

from grasp.cli import dry, exits
from grasp.cli.lab import tell_mode
from grasp.cli.options import add_confirmation, add_settings, motion_permit
from grasp.cli.output import json_line

HELP = "open the fingers of a gripper that was left closed"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "release",
        help=HELP,
        description=HELP + ". Support the object first: it falls when the fingers open. Needs the "
        "gripper alone: how arm and fingertips are is told, and does not matter.",
    )
    parser.add_argument(
        "--rig", required=True, metavar="NAME",
        help="hardware; or emulated or simulated, which open a hand of their own",
    )  # fmt: skip
    parser.add_argument(
        "--activate", action="store_true",
        help="activate a hand that is not active, which opens and closes it fully: it must be "
        "empty, or what it holds supported",
    )  # fmt: skip
    dry.add_dry_run(parser)
    add_confirmation(parser)
    add_settings(parser)
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )
    parser.set_defaults(handler=release)


def release(args: argparse.Namespace) -> int:
    from scenarios.campaign.config import load_for_devices
    from scenarios.rigs.permission import HARDWARE, gripper_address
    from scenarios.rigs.release import other_devices, release_gripper

    config = load_for_devices("can", args.rig, args.config, args.set)
    if args.dry_run:
        return dry.release(config, args)
    permit = motion_permit(config, args)
    positions = release_gripper(config, config.controller.approach_speed_mps, permit, args.activate)
    real = config.rig == HARDWARE
    which = f"gripper at {gripper_address(config)}" if real else "gripper of a cell of its own"
    if not args.json:
        print(f"released on rig {args.rig}: {which}, fingers open at {positions} counts")
    others = other_devices(config) if real else {}
    if args.json:
        told = {"rig": args.rig, "gripper": which, "positions_counts": positions, **others}
        print(json_line(told))
    else:
        for device, state in others.items():
            print(f"  {device}: {state}")
    if real:
        tell_mode(config, opened=True)
    return exits.SUCCESS
