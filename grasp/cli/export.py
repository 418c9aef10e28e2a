"""`grasp export`: a run or a campaign as a table, a run as a picture, or a viewer's layout."""

import argparse
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import need, no_settings
from grasp.cli.parser import verb
from grasp.cli.places import PICTURES, file_to_write, must_be_writable, own_or_new
from grasp.files import write_whole

HELP = "a run or a campaign as a CSV table, a run as a picture, or a viewer's layout"
LAYOUT = "foxglove-layout.json"
LAYOUT_BEGINS = '{\n "configById"'
ENDINGS = {".csv": "csv", ".json": "layout", **dict.fromkeys(PICTURES, "svg")}


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "export", export, HELP, ". csv: one row per control step with units in "
        "the column names; for a campaign one row per trial. svg: force, slip probability and "
        "slip distance over time (needs the extra `charts`). layout: a Foxglove and Lichtblick "
        "layout for recording.mcap.")  # fmt: skip
    parser.option("run RUN", "folder or recording.mcap of a lift or a tap, or the SQLite file of a "
        "campaign", Path)  # fmt: skip
    parser.option("--to", "(default: by the name of --out, else csv)",
        choices=("csv", "svg", "layout"))  # fmt: skip
    parser.option("--out FILE", "(default: beside the recording or the campaign, with its name; "
        "csv: .csv, svg: .svg, .png or .pdf, layout: .json)", file_to_write)  # fmt: skip
    no_settings(parser)


def export(args: argparse.Namespace) -> int:
    from scenarios.campaign.store import is_database

    meant = None if args.out is None else ENDINGS.get(args.out.suffix)
    if args.to is None and args.out is not None and meant is None:
        raise UsageError(
            f"--out {args.out}: no known file ending",
            f"use a name that ends in {', '.join(ENDINGS)}, or give --to",
        )
    to = args.to or meant or "csv"
    if is_database(args.run):
        if to != "csv":
            raise UsageError(f"{args.run}: a campaign cannot be exported as {to}", "use --to csv")
        print(_campaign(args.run, args.out))
    elif to == "svg":
        print(_picture(args.run, args.out))
    else:
        print(_table(args.run, args.out, to == "csv"))
    return exits.SUCCESS


def _table(run: Path, out: Path | None, table: bool) -> Path:
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
    from scenarios.report.export import draw_run
    from scenarios.trial.run_folder import find_recording

    out = out or find_recording(run).with_name("run.svg")
    if out.suffix not in PICTURES:
        raise UsageError(f"--out {out}: not an image file name",
                         f"use a name that ends in {', '.join(PICTURES)}")  # fmt: skip
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
