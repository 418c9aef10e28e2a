"""`grasp report`: a run, a campaign or an evaluation as one page that opens from disk, a table, a
picture or a viewer's layout."""

import argparse
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, UsageError
from grasp.cli import exits
from grasp.cli.options import need, no_settings
from grasp.cli.parser import verb
from grasp.cli.places import PICTURES, file_to_write, must_be_writable, own_or_new
from grasp.files import write_whole

HELP = "a run, a campaign or an evaluation as a page, a table, a picture or a viewer's layout"
EVALUATION = ".json"
LAYOUT = "foxglove-layout.json"
LAYOUT_BEGINS = '{\n "configById"'
ENDINGS = {".html": "page", ".csv": "csv", ".json": "layout", **dict.fromkeys(PICTURES, "svg")}


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "report", report, HELP, ". page: a run (verdict, a picture that plays, "
        "forces, slip probability, commands, settings), a campaign (Table IV, distributions, what "
        "was varied, failures) or an evaluation of detectors (false events against delay, "
        "calibration, the worst misses), in one file that opens from disk. csv: one row a control "
        "step, units in the names of the columns; of a campaign one row a trial. svg: force, slip "
        "probability and slip distance over time (needs the extra `charts`). layout: how Foxglove "
        "and Lichtblick show a recording.mcap.")  # fmt: skip
    parser.option("run RUN", "folder or recording.mcap of a lift or a tap, a folder of such "
        "folders (each gets a page of its own), the SQLite file of a campaign, or the .json file "
        "of `grasp detector evaluate --out`", Path)  # fmt: skip
    parser.option("--to", "(default: by the name of --out, else page)",
        choices=("page", "csv", "svg", "layout"))  # fmt: skip
    parser.option("--out FILE", "(default: beside the recording, or beside the file of a campaign "
        "or an evaluation, with its name; page: .html, csv: .csv, svg: .svg, .png or .pdf, layout: "
        ".json)", file_to_write)  # fmt: skip
    no_settings(parser)


def report(args: argparse.Namespace) -> int:
    meant = None if args.out is None else ENDINGS.get(args.out.suffix)
    if args.to is None and args.out is not None and meant is None:
        raise UsageError(
            f"--out {args.out}: what is to be written is not told by its name",
            f"a name that ends in {', '.join(ENDINGS)}, or --to",
        )
    to = args.to or meant or "page"
    if to != "page":
        print(_exported(args.run, args.out, to))
        return exits.SUCCESS
    if args.out is not None and meant != "page":
        raise UsageError(f"--out {args.out}: not the name of a page", "a name that ends in .html")
    runs = _runs(args.run)
    if args.out is not None and len(runs) > 1:
        raise UsageError(f"{args.run} holds {len(runs)} runs", "leave --out out, or name one run")
    code = exits.SUCCESS
    for run in runs:
        try:
            print(write_page(run, args.out))
        except (BadFile, UsageError) as error:
            if len(runs) == 1:
                raise
            code = exits.report(error.kind, error.message, error.remedy, as_json=False)
    return code


def _runs(path: Path) -> list[Path]:
    """The run at a path, or the lifts and taps in it; raises BadFile where there is none."""
    from detector.recordings import SUFFIX
    from scenarios.acquire.acquire import SAMPLES
    from scenarios.trial.run_folder import RECORDING

    if not path.exists():
        raise BadFile(path, "is not there", "give the folder of a run; `grasp runs` lists them")
    if path.is_file() or (path / RECORDING).exists():
        return [path]
    if not path.is_dir():
        raise BadFile(path, "is no file", "give the folder of a run; `grasp runs` lists them")
    found = [file.parent for file in sorted(path.glob(f"*/{RECORDING}"))]
    runs = [run for run in found if not list(run.glob(f"{SAMPLES}*{SUFFIX}"))]
    if not runs:
        wanted = f"the folder of a run, with a {RECORDING}; `grasp runs` lists them"
        raise BadFile(path, "is no run: there is no recording in it", f"give {wanted}")
    return runs


def write_page(run: Path, out: Path | None = None) -> Path:
    """The page of one run, campaign or evaluation. Raises BadFile where it is none, UsageError
    where something else than a page of ours stands in the way."""
    from scenarios.campaign.store import is_database
    from scenarios.report.campaign_page import campaign_page
    from scenarios.report.page import BEGINS
    from scenarios.report.run_page import page_path, run_page

    database, evaluation = is_database(run), run.suffix == EVALUATION
    path = out or (run.with_suffix(".html") if database or evaluation else page_path(run))
    own_or_new(path, BEGINS)
    if database:
        page = campaign_page(run, path)
    elif evaluation:
        from scenarios.report.evaluation_page import evaluation_page  # needs the compiled world

        page = evaluation_page(run)
    else:
        page = run_page(run)
    write_whole(path, page.encode(), private=True)
    return path


def _exported(run: Path, out: Path | None, to: str) -> Path:
    """A table, a picture or a layout, and where it is."""
    from scenarios.campaign.store import is_database

    if is_database(run):
        if to != "csv":
            raise UsageError(f"{run} is a campaign, and no {to} is made of one", "--to csv")
        return _campaign(run, out)
    return _picture(run, out) if to == "svg" else _table(run, out, to == "csv")


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
