"""`grasp grip-search`: whole counts that hold an object and are sure to let it slip."""

import argparse
from typing import Any

from grasp.cli import exits
from grasp.cli.options import decimal, whole
from grasp.cli.output import json_line
from grasp.cli.places import file_to_write, own_or_new
from grasp.cli.run import add_trial_options
from grasp.files import write_whole

WRITTEN = "# grasp grip-search"
HELP = "find finger positions that hold an object too weakly to lift it"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("grip-search", help=HELP, description=HELP)
    add_trial_options(parser, rig="simulated")
    parser.add_argument(
        "--least", type=decimal(0, 10), metavar="N", help="at the thumb, relaxed (default: 0.5)"
    )
    parser.add_argument(
        "--most", type=decimal(0, 10), metavar="N", help="at the thumb, at first (default: 3)"
    )
    parser.add_argument(
        "--draws",
        type=whole(1, 10_000),
        metavar="N",
        help="trials that each is judged on (default: 200)",
    )
    parser.add_argument(
        "--shown",
        type=whole(0, 10_000),
        default=8,
        metavar="N",
        help="rows of the table (default: %(default)s)",
    )
    parser.add_argument(
        "--verify",
        type=whole(0, 10_000),
        default=5,
        metavar="N",
        help="simulated lifts without reaction of the best, each of which must slip "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--write", type=file_to_write, metavar="FILE", help="write the best as TOML, for --config"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(handler=search)


def search(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.campaign.config import load_config
    from scenarios.studies.grip_search import (
        criteria,
        lifts_that_slip,
        present_grip,
        search,
        with_counts,
    )

    if args.write is not None:
        own_or_new(args.write, WRITTEN)
    whole = load_config(args.object, args.rig, args.detector, args.config, args.set, args.profile)
    config = whole.for_lift()
    wanted = criteria(args.least, args.most, args.draws)
    grips = search(config, wanted, args.seed)
    best = grips[0]
    slipped = lifts_that_slip(with_counts(config, best.counts), range(args.verify))
    found = best.meets(wanted) and slipped == args.verify
    if args.json:
        out = {
            "object": config.object.name, "found": found, "best": msgspec.to_builtins(best),
            "present": msgspec.to_builtins(present_grip(config, wanted, args.seed)),
            "lifts": args.verify, "slipped": slipped,
            "grips": msgspec.to_builtins(grips[: args.shown]),
        }  # fmt: skip
        print(json_line(out))
    else:
        _print(args, present_grip(config, wanted, args.seed), grips[: args.shown], slipped)
    if args.write is not None:
        counts = ", ".join(map(str, best.counts))
        text = f"{WRITTEN}\n[object]\ngrip_counts = [{counts}]\n"
        write_whole(args.write, text.encode())
    return exits.SUCCESS if found else exits.TRIAL_FAILED


def _print(args: argparse.Namespace, present: Any, grips: list[Any], slipped: int) -> None:
    print("  counts A B C    thumb, N: least median most   B, C least   margin   sure   what fails")
    for name, grip in (("now", present), *((f"{k + 1}", g) for k, g in enumerate(grips))):
        print(f"{name:>3}  {_row(grip)}")
    print(
        "margin: of the weight, that friction cannot carry in any draw; sure: of draws that fail "
        "in nothing\n(loose, firm: thumb; finger: B or C hardly touches; holds: might not slip)"
    )
    print(f"best: {slipped} of {args.verify} simulated lifts without reaction slipped")


def _row(grip: Any) -> str:
    a, b, c = grip.counts
    least, median, most = grip.thumb_n
    fails = ", ".join(f"{name} {100 * f:.1f} %" for name, f in grip.fails.items() if f)
    margin, sure = 100 * grip.slip_margin, 100 * grip.sure
    return (
        f"{a:3d} {b:3d} {c:3d}          {least:5.2f}  {median:5.2f} {most:5.2f}        "
        f"{grip.finger_n:5.2f}   {margin:5.0f} %  {sure:5.1f} %   {fails or '-'}"
    )
