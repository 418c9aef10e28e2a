"""`grasp export`: a run as a table, or the layout in which a viewer shows recordings."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits
from grasp.cli.options import no_settings
from grasp.cli.places import file_to_write, own_or_new
from grasp.files import write_whole

HELP = "a run as a CSV table; or a layout to import into Foxglove or Lichtblick"
LAYOUT = "foxglove-layout.json"
LAYOUT_BEGINS = '{\n "configById"'


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "export", help=HELP,
        description="csv: one row a control step, units in the names of the columns. layout: how "
        "Foxglove and Lichtblick show a recording.mcap (side view, forces, probability, phases).",
    )  # fmt: skip
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="folder or recording.mcap of a lift or a tap"
    )
    parser.add_argument(
        "--to", choices=("csv", "layout"), default="csv", help="(default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=file_to_write, metavar="FILE",
        help="(default: beside the recording, with its name and .csv; layout: "
        f"{LAYOUT} there)",
    )  # fmt: skip
    no_settings(parser)
    parser.set_defaults(handler=export)


def export(args: argparse.Namespace) -> int:
    from grasp.settings import config_dir
    from scenarios.report.export import BEGINS, as_csv
    from scenarios.trial.run_folder import find_recording, open_trial

    recording = find_recording(args.run)
    table = args.to == "csv"
    out = args.out or (recording.with_suffix(".csv") if table else recording.with_name(LAYOUT))
    if table:
        content = as_csv(args.run)
    else:
        open_trial(args.run)
        content = (config_dir() / "viewers" / "foxglove.json").read_text("utf-8")
    own_or_new(out, BEGINS if table else LAYOUT_BEGINS)
    write_whole(out, content.encode(), private=True)
    print(out)
    return exits.SUCCESS
