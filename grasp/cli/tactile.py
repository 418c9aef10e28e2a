"""`grasp tactile`: print what the fingertips measure, and identify how their board is wired."""

import argparse
import sys
from contextlib import suppress
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.lab import add_verb, lab_config, new_file
from grasp.cli.options import add_settings, decimal, whole
from grasp.cli.output import json_line
from grasp.cli.parser import group, verb
from grasp.cli.places import file_to_write
from grasp.files import write_whole

HELP = "fingertips: wiring, rest and noise"


def add_parser(verbs: Any) -> None:
    actions = group(verbs, "tactile", HELP)
    which = verb(actions, "identify", identify, "press a pad and see which finger and "
        "taxel responds")  # fmt: skip
    which.option("--url URL", "an emulated board, tcp://HOST:PORT (default: usb.url, else the "
        "board on the USB bus)")  # fmt: skip
    which.option("--serial", "the board with this number (default: usb.serial, else the first)")
    add_settings(which)
    which.option("--seconds N", "watch for N seconds", decimal(0.01, 86_400), default=10.0)
    which.option("--least-fall COUNTS", "a code this far below its rest code is a press (default: "
        "%(default)d, about half a newton; an untouched taxel varies by one or "
        "two)", whole(2, 1023),
        default=20)  # fmt: skip
    which.flag("--json", "one JSON object on standard output, nothing else")
    text = "counts, noise and lost frames of each second, then of every taxel; begin unloaded"
    listen = add_verb(actions, "watch", watch, text, moves=False)
    listen.option("--seconds N", "listen for N seconds (default: 3600, with --rest 5)",
        decimal(1, 86_400))  # fmt: skip
    listen.flag("--rest", "measure the rest codes of the unloaded hand and print them as "
        "tactile.rest_reference for your file")  # fmt: skip
    listen.option("--out FILE", "with --rest: write that file (a new one)", file_to_write)


def watch(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.lab.fingertips import listen

    if args.rest:
        return _take_rest(args)
    if args.out is not None:
        raise UsageError("--out writes the rest codes", "give --rest with it")
    report, seconds, most = None, 0, args.seconds or 3600.0
    with suppress(KeyboardInterrupt):  # the seconds until then are reported
        for report in listen(lab_config(args), most):
            seconds += 1
            if not args.json and seconds <= most:
                print(report.in_words(), flush=True)
    if report is None:
        return exits.report("interrupted", "interrupted", "", args.json)
    if args.json:
        print(json_line({**msgspec.to_builtins(report), "exit_code": exits.SUCCESS}))
    else:
        print(report.table())
    return exits.SUCCESS


def _take_rest(args: argparse.Namespace) -> int:
    from scenarios.lab.fingertips import rest_file

    if args.out is not None:
        new_file(args.out)
    report, text = rest_file(lab_config(args), args.seconds or 5.0)
    if args.out is not None:
        write_whole(args.out, text.encode())
    if args.json:
        rest = {"rest": report.codes, "samples": report.samples}
        noise = {"noise_counts": report.noise_counts, "file": text}
        print(json_line({**rest, **noise, "exit_code": exits.SUCCESS}))
    else:
        print(text, end="")
        print(report.in_words(), file=sys.stderr)
    return exits.SUCCESS


def identify(args: argparse.Namespace) -> int:
    from drivers.takktile.identify import watch
    from drivers.takktile.link import UsbLink
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
