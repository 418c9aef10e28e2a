"""`grasp chart`: pictures. Needs the extra `charts`."""

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from grasp.cli import exits

HELP = "draw pictures of runs"


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


def draw(args: argparse.Namespace) -> int:
    if find_spec("matplotlib") is None:
        remedy = "pip install 'grasp-controller[charts]'"
        return exits.report("usage", "charts need matplotlib", remedy, as_json=False)
    from scenarios.figures import draw_run
    from scenarios.replay import find_recording

    out = args.out or find_recording(args.run).with_name("run.svg")
    draw_run(args.run, out)
    print(out)
    return exits.SUCCESS
