"""`grasp chart reaction`: what a millisecond of reaction latency is worth."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp.cli import exits
from grasp.cli.options import add_workers, whole, workers

if TYPE_CHECKING:
    from scenarios.studies.reaction.summary import ReactionSummary

OBJECTS = ("ball", "foam", "football", "box", "cardboard", "can")
LATENCIES_MS = (0.0, 25.0, 50.0, 75.0, 100.0, 134.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)
SPEEDS_MPS = (0.022, 0.044, 0.066, 0.11)
FIRST_SEED = 0


def add_parser(charts: Any) -> None:
    parser = charts.add_parser(
        "reaction",
        help="success and slip distance over reaction latency and closing speed",
        description="Lifts every object up to the onset of slip, then tries every reaction on a "
        "copy of that world. Some seeds are run in full beside it, as a check and to tell what a "
        "faster detector would be worth.",
    )
    _add_choices(parser)
    _add_size(parser)
    parser.set_defaults(handler=draw)


def _add_choices(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--objects", nargs="+", default=OBJECTS, metavar="NAME",
        help="of config/objects (default: the paper's six)",
    )  # fmt: skip
    parser.add_argument(
        "--profile", default="default", metavar="NAME",
        help="one of config/profiles (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--detector", metavar="NAME", help="for the check (default: the profile's)")
    parser.add_argument(
        "--latencies", nargs="+", type=float, default=LATENCIES_MS, metavar="MS",
        help="slip onset to the fingers' first motion (default: 0 to 400)",
    )  # fmt: skip
    parser.add_argument(
        "--speeds", nargs="+", type=float, default=SPEEDS_MPS, metavar="M/S",
        help="closing speeds (default: 0.022 to 0.11)",
    )  # fmt: skip


def _add_size(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seeds",
        type=whole(1, 100_000),
        default=20,
        metavar="N",
        help="of each object (default: %(default)s)",
    )
    parser.add_argument(
        "--check", type=whole(0, 100_000), default=10, metavar="N",
        help="of these, run in full as well (default: %(default)s)",
    )  # fmt: skip
    add_workers(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("reaction.svg"), metavar="FILE",
        help="picture to write, .svg, .png or .pdf; the figures go beside it as .json "
        "(default: %(default)s)",
    )  # fmt: skip


def draw(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.cli.chart_physics import matplotlib_is_missing
    from scenarios.campaign.settings import load_config
    from scenarios.studies.reaction.copies import Grid, studies
    from scenarios.studies.reaction.figure import draw_reaction
    from scenarios.studies.reaction.summary import summarize

    if matplotlib_is_missing():
        return exits.USAGE
    configs = [
        load_config(name, "simulated", args.detector, profile=args.profile).for_lift()
        for name in args.objects
    ]
    grid = Grid(args.latencies, args.speeds)
    total = args.seeds * len(configs)
    found = []
    seeds = range(FIRST_SEED, FIRST_SEED + args.seeds)
    for each in studies(configs, seeds, args.check, grid, workers(args)):
        found.append(each)
        if len(found) * 10 // total > (len(found) - 1) * 10 // total:
            print(f"{len(found)}/{total} lifts tried", file=sys.stderr)
    summary = summarize(args.profile, configs[0].detector_name, args.objects, found)
    draw_reaction(summary, args.out)
    text = msgspec.json.format(msgspec.json.encode(summary), indent=1)
    args.out.with_suffix(".json").write_bytes(text + b"\n")
    _print(summary)
    print(args.out)
    return exits.SUCCESS


def _print(summary: "ReactionSummary") -> None:
    latencies = [point.latency_ms for point in summary.curves[0].points]
    print("held, %, at slip onset to first motion of the fingers, ms:")
    print(f"{'':<22}" + "".join(f"{ms:6.0f}" for ms in latencies))
    for curve in summary.curves:
        rates = "".join(f"{100 * point.success:6.0f}" for point in curve.points)
        print(f"{curve.object:<12}{curve.speed_mps * 1e3:4.0f} mm/s{rates}")
    for curve in summary.curves:
        if curve.cliff is not None:
            early, before, late, after = curve.cliff
            print(f"cliff: {curve.object} at {curve.speed_mps * 1e3:.0f} mm/s: {before:.0%} held "
                  f"at {early:.0f} ms, {after:.0%} at {late:.0f} ms")  # fmt: skip
    if not any(curve.cliff for curve in summary.curves):
        print("no cliff: no success rate falls by 30 points between neighbouring latencies")
    for each in summary.faster:
        slip = each.slip_mm.p50
        slipped = "lost" if math.isinf(slip) else f"{slip:.1f} mm"
        print(f"{each.object:<12}{summary.detector} x{each.factor:g}: {each.success:4.0%} held, "
              f"median slip {slipped}, n {each.trials}")  # fmt: skip
    if summary.agreement is not None:
        a = summary.agreement
        print(f"check: {a.same_verdict} of {a.trials} verdicts as in the full run, slip distance "
              f"differs by {a.median_difference_mm:.3f} mm (median), "
              f"{a.largest_difference_mm:.3f} mm (most)")  # fmt: skip
