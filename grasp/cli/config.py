"""`grasp config show`: every setting with its value, allowed range and source."""

import argparse
import json
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.run import add_trial_options

HELP = "show the resolved settings"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("config", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    show = actions.add_parser("show", help="every setting, its value and what is allowed")
    show.add_argument("section", nargs="?", help="show this section alone")
    add_trial_options(show, rig="emulated")
    show.add_argument(
        "--json", action="store_true", help="the resolved settings as one JSON object"
    )
    show.set_defaults(handler=run)


def run(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.settings import allowed
    from scenarios.campaign.config import load_config

    config = load_config(args.object, args.rig, args.detector, args.config, args.set, args.profile)
    table = msgspec.to_builtins(config)
    sections = [name for name, value in table.items() if isinstance(value, dict)]
    if args.section is not None and args.section not in sections:
        raise UsageError(f"no section {args.section!r}", f"one of: {', '.join(sections)}")
    shown = sections if args.section is None else [args.section]
    if args.json:
        print(json.dumps({name: table[name] for name in shown}))
        return exits.SUCCESS
    for name in shown:
        print(f"[{name}]")
        for key, value in table[name].items():
            print(f"{key} = {json.dumps(value)}  # {allowed(type(config), f'{name}.{key}')}")
        print()
    return exits.SUCCESS
