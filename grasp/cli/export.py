"""`grasp export`: a run as a table, a picture or a viewer's layout; a campaign as a table."""

import argparse
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import need, no_settings
from grasp.cli.pictures import PICTURES
from grasp.cli.places import file_to_write, must_be_writable, own_or_new
from grasp.files import write_whole

HELP = "a run as a CSV table, a picture or a layout for Foxglove; a campaign as a CSV table"
LAYOUT = "foxglove-layout.json"
LAYOUT_BEGINS = '{\n "configById"'


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "export", help=HELP,
        description="csv: one row a control step, units in the names of the columns; of a campaign "
        "one row a trial. svg: force, slip probability and slip distance of a run over time (needs "
        "the extra `charts`). layout: how Foxglove and Lichtblick show a recording.mcap (side "
        "view, forces, probability, phases).",
    )  # fmt: skip
    parser.add_argument(
        "run", type=Path, metavar="RUN",
        help="folder or recording.mcap of a lift or a tap, or the SQLite file of a campaign",
    )  # fmt: skip
    parser.add_argument(
        "--to", choices=("csv", "svg", "layout"),
        help="(default: svg where the name of --out is one of a picture, else csv)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=file_to_write, metavar="FILE",
        help="(default: beside the recording or the campaign, with its name and .csv; svg: run.svg "
        f"there, a name may also end in .png or .pdf; layout: {LAYOUT} there)",
    )  # fmt: skip
    no_settings(parser)
    parser.set_defaults(handler=export)


def export(args: argparse.Namespace) -> int:
    from scenarios.campaign.store import is_database

    picture = args.out is not None and args.out.suffix in PICTURES
    to = args.to or ("svg" if picture else "csv")
    if is_database(args.run):
        if to != "csv":
            raise UsageError(f"{args.run} is a campaign, and no {to} is made of one", "--to csv")
        out = _campaign(args.run, args.out)
    elif to == "svg":
        out = _picture(args.run, args.out)
    else:
        out = _run(args.run, args.out, to == "csv")
    print(out)
    return exits.SUCCESS


def _run(run: Path, out: Path | None, table: bool) -> Path:
    from grasp.settings import config_dir
    from scenarios.report.export import BEGINS, as_csv
    from scenarios.trial.run_folder import find_recording, open_trial

    recording = find_recording(run)
    out = out or (recording.with_suffix(".csv") if table else recording.with_name(LAYOUT))
    if table:
        content = as_csv(run)
    else:
        open_trial(run)
        content = (config_dir() / "viewers" / "foxglove.json").read_text("utf-8")
    own_or_new(out, BEGINS if table else LAYOUT_BEGINS)
    write_whole(out, content.encode(), private=True)
    return out


def _picture(run: Path, out: Path | None) -> Path:
    need("charts", "matplotlib")
    from scenarios.report.run_figure import draw_run
    from scenarios.trial.run_folder import find_recording

    out = out or find_recording(run).with_name("run.svg")
    if out.suffix not in PICTURES:
        raise UsageError(f"--out {out}: not the name of a picture",
                         f"a name that ends in {', '.join(PICTURES)}")  # fmt: skip
    must_be_writable(out)
    draw_run(run, out)
    return out


def _campaign(file: Path, out: Path | None) -> Path:
    import io

    from scenarios.campaign.store import COLUMNS, CampaignStore

    text = io.StringIO(newline="")
    with CampaignStore.open(file) as store:
        store.write_csv(text)
    out = out or file.with_suffix(".csv")
    own_or_new(out, ",".join(COLUMNS[:3]))
    write_whole(out, text.getvalue().encode(), private=True)
    return out
