"""`grasp chart`: pictures. Needs the extra `charts`."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp.cli import answers, exits
from grasp.cli.options import (
    OBJECT_HELP,
    add_workers,
    decimal,
    need,
    one_by_one,
    progress,
    whole,
    workers,
)
from grasp.cli.pictures import add_picture, picture, write_numbers
from grasp.cli.rules import check_named

if TYPE_CHECKING:
    from scenarios.studies.reaction.summary import ReactionSummary

HELP = "draw pictures of runs, of detectors and of the physics"

# of `reaction`, and of `hunting`
OBJECTS = ("ball", "foam", "football", "box", "cardboard", "can")
LATENCIES_MS = (0.0, 25.0, 50.0, 75.0, 100.0, 134.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)
SPEEDS_MPS = (0.022, 0.044, 0.066, 0.11)
FIRST_SEED = 0

# Where the mark of the default loop stands in the map of hunting; it draws, and decides nothing.
CLOSING_S = 0.05  # first grasp to the cap on a rigid object, measured on the simulated rig
TRANSIENT_S = 0.1
STEPS_N = (0.5, 2.0, 8.0)
HOLDS_S = (0.03, 0.1)
MOST_LATENCY_MS, MOST_REFRACTORY_MS, STEP_MS = 200, 400, 10


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("chart", help=HELP, description=HELP)
    charts = parser.add_subparsers(metavar="CHART", required=True)
    run = charts.add_parser("run", help="force, slip probability and slip distance over time")
    run.add_argument("run", type=Path, metavar="RUN", help="folder or recording.mcap of a run")
    run.add_argument(
        "--out", type=picture, metavar="FILE",
        help="picture to write, .svg, .png or .pdf (default: run.svg beside the recording)",
    )  # fmt: skip
    run.set_defaults(handler=draw)
    _add_detectors(charts)
    _add_physics(charts)
    answers.add_parser(charts)
    _add_reaction(charts)
    _add_hunting(charts)
    _add_frontier(charts)


def _add_detectors(charts: Any) -> None:
    text = "detectors: false events against delay, accuracy against compute, all from one run"
    parser = charts.add_parser("detectors", help=text, description=text)
    parser.add_argument(
        "detector", nargs="*", metavar="NAME", help="some of config/detectors (default: all)"
    )
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR",
        help="folders of `grasp dataset build`, or `collect`; the split `test` is drawn",
    )  # fmt: skip
    add_picture(parser, "detectors")
    parser.set_defaults(handler=draw_detectors)


def draw(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from scenarios.report.run_figure import draw_run
    from scenarios.trial.run_folder import find_recording

    out = args.out or find_recording(args.run).with_name("run.svg")
    draw_run(args.run, out)
    print(out)
    return exits.SUCCESS


def draw_detectors(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from detector.interface import DETECTORS
    from scenarios.benchmark.scoring import contender, read_split
    from scenarios.studies.detectors.figures import curve, draw_detectors

    check_named(args.detector)
    recordings = read_split(args.data, "test", exits.say)
    curves = {}
    for name, tell in one_by_one(args.detector or DETECTORS, "sweeping", hidden=False):
        data = f"{' '.join(folder.name for folder in args.data)}, test"
        made = contender(name, recordings, data, tell=tell)
        curves[name] = curve(made.evaluation(), made.points(tell))
    draw_detectors(curves, args.out)
    print(args.out)
    return exits.SUCCESS


def _add_physics(charts: Any) -> None:
    _add_computed(
        charts, "physics", draw_physics,
        "error against processor time of every contact model, integrator and step (1-2 minutes)",
    )  # fmt: skip
    _add_computed(
        charts, "stability", draw_stability,
        "at which step and stiffness each integrator holds a lift together (half a minute)",
    )  # fmt: skip


def _add_computed(charts: Any, name: str, handler: Any, text: str) -> None:
    parser = charts.add_parser(name, help=text, description=text)
    add_picture(parser, name)
    parser.set_defaults(handler=handler)


def draw_physics(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from scenarios.studies.physics import chart as physics_chart

    with progress("reference") as show:
        chart = physics_chart.compute(lambda text, done, total: show(done, total, text))
    physics_chart.draw(chart, args.out)
    write_numbers(args.out, chart)
    print(physics_chart.table(chart))
    print(args.out)
    return exits.SUCCESS


def draw_stability(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from scenarios.studies.physics import stability

    with progress("reference") as show:
        found = stability.compute(lambda text, done, total: show(done, total, text))
    stability.draw(found, args.out)
    write_numbers(args.out, found)
    for name, share in found.broken().items():
        print(f"{name:40} broken on {share:4.0%} of the map")
    print(args.out)
    return exits.SUCCESS


def _add_hunting(charts: Any) -> None:
    parser = charts.add_parser(
        "hunting",
        help="where the controller's own closing would set off the next compensation",
        description="Counts compensations of a reduced loop over latency, refractory time, hold "
        "time and force step, for three policies. The star is the default controller.",
    )
    parser.add_argument(
        "--out", type=picture, default=Path("hunting.svg"), metavar="FILE",
        help="picture to write, .svg, .png or .pdf (default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(handler=draw_hunting_map)


def draw_hunting_map(args: argparse.Namespace) -> int:
    from scenarios.campaign.config import load_config
    from scenarios.studies.reaction.hunting import POLICIES, default_loop, hunt, hunting_map
    from scenarios.studies.reaction.hunting_figure import draw_hunting

    need("charts", "matplotlib")
    latencies = [ms * 1e-3 for ms in range(0, MOST_LATENCY_MS + 1, STEP_MS)]
    refractories = [ms * 1e-3 for ms in range(0, MOST_REFRACTORY_MS + 1, STEP_MS)]
    maps = [
        hunting_map(policy, step, hold, latencies, refractories)
        for policy in range(len(POLICIES))
        for step in STEPS_N
        for hold in HOLDS_S
    ]
    default = default_loop(load_config("can", "simulated"), CLOSING_S, TRANSIENT_S)
    draw_hunting(maps, default, args.out)
    for m in maps:
        bounded = "" if m.bound is None else f", bound {m.bound}"
        clean = (m.compensations == 1).mean()
        print(f"{m.policy:<15} step {m.step_n:3g} N, hold {m.hold_s * 1e3:3.0f} ms: at most "
              f"{m.compensations.max():3d} compensations{bounded}, {clean:4.0%} clean")  # fmt: skip
    latency_ms, refractory_ms = default.latency_s * 1e3, default.refractory_s * 1e3
    print(f"default: latency {latency_ms:.0f} ms, refractory time {refractory_ms:.0f} ms: "
          f"{hunt(default)} compensation")  # fmt: skip
    print(args.out)
    return exits.SUCCESS


def _add_frontier(charts: Any) -> None:
    text = "success against each axis of `grasp campaign run frontier`, with what 10 N can hold"
    parser = charts.add_parser("frontier", help=text, description=text)
    parser.add_argument(
        "file", type=Path, nargs="+", metavar="FILE", help="SQLite file of a campaign with axes"
    )
    add_picture(parser, "frontier")
    parser.set_defaults(handler=draw_frontiers)


def draw_frontiers(args: argparse.Namespace) -> int:
    from drivers.errors import BadFile
    from scenarios.campaign.frontier import summarize
    from scenarios.campaign.store import CampaignStore
    from scenarios.studies.frontier_figure import draw_frontier

    need("charts", "matplotlib")
    found = []
    for path in args.file:
        with CampaignStore.open(path) as store:
            if not store.spec.axes:
                raise BadFile(path, "a campaign without axes", "one of `campaign run frontier`")
            found.append(summarize(store.spec.name, store.rows()))
    draw_frontier(found, args.out)
    write_numbers(args.out, found)
    print(args.out)
    return exits.SUCCESS


def _add_reaction(charts: Any) -> None:
    parser = charts.add_parser(
        "reaction",
        help="success and slip distance over reaction latency and closing speed",
        description="Lifts every object up to the onset of slip, then tries every reaction on a "
        "copy of that world. Some seeds are run in full beside it, as a check and to tell what a "
        "faster detector would be worth.",
    )
    _add_reaction_choices(parser)
    _add_reaction_size(parser)
    parser.set_defaults(handler=draw_reactions)


def _add_reaction_choices(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--objects", nargs="+", default=OBJECTS, metavar="NAME",
        help=f"{OBJECT_HELP} (default: the paper's six)",
    )  # fmt: skip
    parser.add_argument(
        "--profile", default="default", metavar="NAME",
        help="one of config/profiles (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--detector", metavar="NAME", help="for the check (default: the profile's)")
    parser.add_argument(
        "--latencies", nargs="+", type=decimal(0, 10_000), default=LATENCIES_MS, metavar="MS",
        help="slip onset to the fingers' first motion (default: 0 to 400)",
    )  # fmt: skip
    parser.add_argument(
        "--speeds", nargs="+", type=decimal(0.001, 1), default=SPEEDS_MPS, metavar="M/S",
        help="closing speeds (default: 0.022 to 0.11)",
    )  # fmt: skip


def _add_reaction_size(parser: argparse.ArgumentParser) -> None:
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
    add_picture(parser, "reaction")


def draw_reactions(args: argparse.Namespace) -> int:

    from scenarios.campaign.config import load_config
    from scenarios.studies.reaction.copies import Grid, studies
    from scenarios.studies.reaction.figure import draw_reaction
    from scenarios.studies.reaction.summary import summarize

    need("charts", "matplotlib")
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
    summary = summarize(
        args.profile, configs[0].detector_name, [c.object.name for c in configs], found
    )
    draw_reaction(summary, args.out)
    write_numbers(args.out, summary)
    _print_reactions(summary)
    print(args.out)
    return exits.SUCCESS


def _print_reactions(summary: "ReactionSummary") -> None:
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
        slip = (each.slip_mm.p50, each.slip_mm.p90, each.slip_mm.p99)
        slipped = " / ".join("lost" if math.isinf(mm) else f"{mm:.1f}" for mm in slip)
        print(f"{each.object:<12}{summary.detector} x{each.factor:g}: {each.success:4.0%} held, "
              f"slip p50 / p90 / p99 {slipped} mm, n {each.trials}")  # fmt: skip
    if summary.agreement is not None:
        a = summary.agreement
        print(f"check: {a.same_verdict} of {a.trials} verdicts as in the full run, slip distance "
              f"differs by {a.median_difference_mm:.3f} mm (median), "
              f"{a.largest_difference_mm:.3f} mm (most)")  # fmt: skip
