"""`grasp find HOST...`: which devices answer there, and which boards are plugged in."""

import argparse
from typing import Any

from drivers.errors import one_line
from grasp.cli import exits
from grasp.cli.options import decimal
from grasp.cli.output import json_line

HELP = "ask addresses for a gripper, an arm, fingertips; list USB boards"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "find", help=HELP,
        description=HELP + ". Asks those that are named, on the ports known, and nobody else; "
        "moves nothing, and prints what to write into a file for --config.",
    )  # fmt: skip
    parser.add_argument(
        "hosts", nargs="*", metavar="HOST",
        help="HOST: gripper (Modbus, port 502) and arm (29999, 30002, 30004); HOST:PORT: a gripper "
        "there; tcp://HOST:PORT: an emulated fingertip board",
    )  # fmt: skip
    parser.add_argument(
        "--timeout", type=decimal(0.05, 10), default=1.0, metavar="S",
        help="each question is answered within S seconds (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )
    parser.set_defaults(handler=find)


def find(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.lab.find import ask, settings_of, usb_boards

    found = []
    for each in (*ask(args.hosts, args.timeout), *usb_boards()):
        found.append(each)
        if not args.json:
            heard = "yes " if each.answered else "no  "
            print(one_line(f"{heard}  {each.device} at {each.where}: {each.said}"))
    answered = any(each.answered for each in found)
    code = exits.SUCCESS if answered else exits.DEVICE
    if args.json:
        print(json_line({"asked": msgspec.to_builtins(found), "exit_code": code}))
        return code
    if answered:
        print(f"\nfor a file of your own, as lab.toml:\n\n{settings_of(found)}", end="")
    elif args.hosts:
        exits.report_line("nobody answers: check power, cables and addresses")
    else:
        exits.report_line(
            "no fingertip board on the USB bus, and no address was named: "
            "`grasp find HOST HOST` asks gripper and arm there, and nobody else"
        )
    return code
