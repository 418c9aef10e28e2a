"""`grasp tactile`: let a user open the fingertips' USB board, find out how it is wired, and listen
to it."""

import argparse
import sys
from contextlib import suppress
from typing import Any

from grasp.cli import exits
from grasp.cli.lab import add_lab, lab_config, new_file
from grasp.cli.options import add_settings, decimal, whole
from grasp.cli.output import json_line
from grasp.cli.places import file_to_write
from grasp.files import write_whole

HELP = "fingertips: USB permission, wiring, rest and noise"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("tactile", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    rule = actions.add_parser("udev", help="print the udev rule that lets a user open the board")
    rule.set_defaults(handler=udev)
    which = actions.add_parser("identify", help="press a pad: which finger and taxel answers")
    which.add_argument(
        "--url",
        metavar="URL",
        help="an emulated board, tcp://HOST:PORT (default: usb.url, else the board on the USB bus)",
    )
    which.add_argument(
        "--serial", help="the board with this number (default: usb.serial, else the first)"
    )
    add_settings(which)
    which.add_argument(
        "--seconds",
        type=decimal(0.01, 86_400),
        default=10.0,
        metavar="N",
        help="watch for N seconds (default: %(default)g)",
    )
    which.add_argument(
        "--least-fall",
        type=whole(2, 1023),
        default=20,
        metavar="COUNTS",
        help="a code so far below its rest is a press (default: %(default)d, about half a newton; "
        "an untouched taxel moves by one or two)",
    )
    which.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )
    which.set_defaults(handler=identify)
    _add_listening(
        actions, "watch", watch, 3600.0,
        "counts, noise and lost frames of each second, then of every taxel; begin unloaded",
    )  # fmt: skip
    rest = _add_listening(
        actions, "rest", take_rest, 5.0,
        "the rest codes of the unloaded hand, as tactile.rest_reference for a file of your own",
    )  # fmt: skip
    rest.add_argument(
        "--out", type=file_to_write, metavar="FILE", help="write that file (a new one)"
    )


def _add_listening(
    actions: Any, name: str, handler: Any, seconds: float, text: str
) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(name, help=text, description=text)
    parser.add_argument(
        "--seconds", type=decimal(1, 86_400), default=seconds, metavar="N",
        help="listen for N seconds (default: %(default)g)",
    )  # fmt: skip
    add_lab(parser, moves=False)
    parser.set_defaults(handler=handler)
    return parser


def watch(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.lab.fingertips import listen

    heard, seconds = None, 0
    with suppress(KeyboardInterrupt):  # what was heard until then is told
        for heard in listen(lab_config(args), args.seconds):
            seconds += 1
            if not args.json and seconds <= args.seconds:
                print(heard.in_words(), flush=True)
    if heard is None:
        return exits.report("interrupted", "interrupted", "", args.json)
    if args.json:
        print(json_line({**msgspec.to_builtins(heard), "exit_code": exits.SUCCESS}))
    else:
        print(heard.table())
    return exits.SUCCESS


def take_rest(args: argparse.Namespace) -> int:
    from scenarios.lab.fingertips import rest_file

    if args.out is not None:
        new_file(args.out)
    heard, text = rest_file(lab_config(args), args.seconds)
    if args.out is not None:
        write_whole(args.out, text.encode())
    if args.json:
        told = {"rest": heard.codes, "samples": heard.samples, "noise_counts": heard.noise_counts}
        print(json_line({**told, "file": text, "exit_code": exits.SUCCESS}))
    else:
        print(text, end="")
        print(heard.in_words(), file=sys.stderr)
    return exits.SUCCESS


def udev(args: argparse.Namespace) -> int:
    from drivers.takktile.link.sysfs import INSTALL, RULE

    print(f"# install: {INSTALL}")
    print(RULE)
    return exits.SUCCESS


def identify(args: argparse.Namespace) -> int:
    from drivers.takktile.identify import watch
    from drivers.takktile.link.usb import UsbLink
    from scenarios.campaign.config import load_for_devices
    from scenarios.rigs.permission import HARDWARE
    from scenarios.rigs.wired import ANY_BOARD

    config = load_for_devices("can", HARDWARE, args.config, args.set)
    named = "" if config.usb.serial == ANY_BOARD else config.usb.serial
    strongest: dict[tuple[int, int], Any] = {}
    last = None
    link = UsbLink.find(args.serial or named or None, _bus(args.url or config.usb.url))
    whole = False
    watched = watch(link, config.tactile, args.seconds, lambda: _prompt(args), args.least_fall)
    try:
        with suppress(KeyboardInterrupt):  # what was pressed until then is told
            for press in watched:
                cell = press.row, press.column
                if cell not in strongest or press.fall_counts > strongest[cell].fall_counts:
                    strongest[cell] = press
                if not args.json and cell != last:
                    print(_text(press), flush=True)
                last = cell
            whole = True
    finally:
        watched.close()  # stops the board
        link.close()
    if not (whole or strongest):
        return exits.report("interrupted", "interrupted", "", args.json)
    return _conclude(list(strongest.values()), args.json)


def _bus(url: str) -> Any:
    """pyusb back end: of an emulated board, or None for the machine's own USB."""
    if not url:
        return None
    from drivers.errors import ConfigError
    from drivers.takktile.emulator.bus import backend

    try:
        return backend(url)
    except ValueError as error:
        raise ConfigError("--url", url, str(error), "tcp://HOST:PORT") from error


def _prompt(args: argparse.Namespace) -> None:
    print(f"press one pad after the other, for {args.seconds:g} s", file=sys.stderr, flush=True)


def _text(press: Any) -> str:
    cell = f"row {press.row}, column {press.column}"
    if press.finger is None:
        return f"no finger has this cell in `cells`: {cell}"
    return f"finger {press.finger} taxel {press.taxel} ({cell})"


def _conclude(presses: list[Any], as_json: bool) -> int:
    """Sum up, strongest first; watching and seeing nothing is a failure."""
    import msgspec

    presses.sort(key=lambda press: -press.fall_counts)
    code = exits.SUCCESS if presses else exits.TRIAL_FAILED
    if as_json:
        print(json_line({"presses": msgspec.to_builtins(presses), "exit_code": code}))
    elif presses:
        print(f"strongest: {_text(presses[0])}, {presses[0].fall_counts} counts below its rest")
    else:
        print("no pad was pressed")
    return code
