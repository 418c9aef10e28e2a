"""`grasp chart`: pictures. Needs the extra `charts`."""

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from grasp.cli import chart_hunting, chart_physics, chart_reaction, exits

HELP = "draw pictures of runs, of detectors and of the physics"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("chart", help=HELP, description=HELP)
    charts = parser.add_subparsers(metavar="CHART", required=True)
    run = charts.add_parser("run", help="force, slip probability and slip distance over time")
    run.add_argument("run", type=Path, metavar="RUN", help="folder or recording.mcap of a run")
    run.add_argument(
        "--out", type=Path, metavar="FILE",
        help="picture to write, .svg, .png or .pdf (default: run.svg beside the recording)",
    )  # fmt: skip
    run.set_defaults(handler=draw)
    _add_detectors(charts)
    chart_physics.add_parsers(charts)
    chart_reaction.add_parser(charts)
    chart_hunting.add_parser(charts)


def _add_detectors(charts: Any) -> None:
    text = "detectors: false events against delay, accuracy against compute, all from one run"
    parser = charts.add_parser("detectors", help=text, description=text)
    parser.add_argument(
        "detector", nargs="*", metavar="NAME", help="some of config/detectors (default: all)"
    )
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR",
        help="folders made by `grasp dataset build`; the split `test` is drawn",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("detectors.svg"), metavar="FILE",
        help="picture to write; the numbers go beside it as .json (default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(handler=draw_detectors)


def draw(args: argparse.Namespace) -> int:
    if find_spec("matplotlib") is None:
        remedy = "pip install 'grasp-controller[charts]'"
        return exits.report("usage", "charts need matplotlib", remedy, as_json=False)
    from scenarios.report.run_figure import draw_run
    from scenarios.trial.replay import find_recording

    out = args.out or find_recording(args.run).with_name("run.svg")
    draw_run(args.run, out)
    print(out)
    return exits.SUCCESS


def draw_detectors(args: argparse.Namespace) -> int:
    if find_spec("matplotlib") is None:
        remedy = "pip install 'grasp-controller[charts]'"
        return exits.report("usage", "charts need matplotlib", remedy, as_json=False)
    from detector.interface import DETECTORS
    from grasp.cli.tune import shown
    from scenarios.studies.detectors.benchmark import contender, read_split
    from scenarios.studies.detectors.figures import curve, draw_detectors

    recordings = read_split(args.data, "test")
    curves = {}
    for name in shown(args.detector or DETECTORS, "sweeping", hidden=False):
        made = contender(name, recordings, "test")
        curves[name] = curve(made.evaluation(), made.points())
    draw_detectors(curves, args.out)
    print(args.out)
    return exits.SUCCESS
