"""`grasp emulate`: the emulated cell for other people's clients."""

import argparse
import secrets
import sys
from typing import Any

from drivers.addresses import cannot_listen, check_free, check_host
from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import OBJECT_HELP, add_settings, seed, whole
from grasp.cli.parser import verb

PERIODS_S = {"cb3": 0.008, "e-series": 0.002}  # of the controller's cycle
HELP = "run the emulated cell: gripper on Modbus TCP, fingertips over USB transfers, arm on RTDE"


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "emulate", emulate, HELP, ". Prints its endpoints as one JSON line when "
        "it is ready and ends on SIGINT or SIGTERM. An object appears between the fingers once the "
        "hand is activated. Standard input takes the actions of an operator, one per line: place "
        "(the object on the table), take (it away), scale (what each fingertip presses with), home "
        "(the arm, to where it began, its tool turned as it was), look, tap [top|side|closing], "
        "press FINGER TAXEL [NEWTONS] (on a pad, for a second, as `grasp tactile identify` asks), "
        "fault NAME [SETTING=VALUE ...], fault help.")  # fmt: skip
    parser.option("--host ADDRESS", "loopback address, e.g. 127.0.0.2 (default: a free one; never "
        "127.0.0.1, where ur_rtde skips a check)")  # fmt: skip
    parser.option("--gripper-port PORT", "Modbus TCP port (default: a free one; 502 needs "
        "privileges)", whole(0, 65_535), default=0)  # fmt: skip
    parser.flag("--beyond-loopback", "let --host be any address of this machine, e.g. in a "
        "container; what the control and fault channels are asked then needs the token that is "
        "printed with the endpoints")  # fmt: skip
    parser.option("--profile", "the arm's controller: CB3 at 125 Hz (default), or e-Series at 500 "
        "Hz", choices=("cb3", "e-series"), default="cb3")  # fmt: skip
    parser.flag("--rtu", "put the gripper on a serial line too, a pseudo-terminal that is printed "
        "with the endpoints")  # fmt: skip
    parser.option("--object NAME", OBJECT_HELP, default="can")
    parser.option("--seed N", "random seed", seed, default=0)
    add_settings(parser)


def emulate(args: argparse.Namespace) -> int:
    from grasp.cli.emulate_words import Words
    from scenarios.campaign.config import load_for_devices
    from scenarios.rigs.emulated_cell import CellOrder, Listening, end_on_signals, serve

    _check_host(args.host, args.beyond_loopback, args.gripper_port)
    there = Listening(
        host=args.host, gripper_port=args.gripper_port, profile=args.profile, rtu=args.rtu,
        token=secrets.token_hex(16) if args.beyond_loopback else "",
    )  # fmt: skip
    period = f"arm_model.period_s={PERIODS_S[args.profile]}"
    config = load_for_devices(args.object, "emulated", args.config, [period, *args.set])
    print("cell: starts; the first time, the world is compiled", file=sys.stderr, flush=True)
    words = Words(config.for_tap(), args.seed)
    order, ended = CellOrder.of(config, args.seed), end_on_signals()
    try:
        serve(order, there, ended, words.listen)
    except OSError as error:
        raise cannot_listen(args.host or "loopback", error) from None
    return exits.SUCCESS


def _check_host(host: str | None, beyond_loopback: bool, gripper_port: int = 0) -> None:
    """Before the world is compiled, which takes a while."""
    from drivers.ur.emulator.server import PORTS

    if host is not None:
        check_host(host, beyond_loopback)
        check_free(host, (*PORTS, gripper_port))
    elif beyond_loopback:
        raise UsageError("--beyond-loopback needs --host", "name the address to listen on")
