"""`grasp report`: a run, a campaign or an evaluation as one page that opens from disk."""

import argparse
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, UsageError
from grasp.cli import exits
from grasp.cli.options import no_settings
from grasp.cli.parser import verb
from grasp.cli.places import file_to_write, own_or_new
from grasp.files import write_whole

HELP = "one page that shows a run, a campaign or an evaluation, in one file that opens from disk"
EVALUATION = ".json"


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "report", report, HELP, ". A run: verdict, a picture that plays, forces, "
        "slip probability, commands, settings. A campaign: Table IV, distributions, failures. An "
        "evaluation of detectors: false events against delay, calibration, the worst "
        "misses.")  # fmt: skip
    parser.option("run RUN", "folder or recording.mcap of a lift or a tap, a folder of such "
        "folders (each gets a page of its own), the SQLite file of a campaign, or the .json file "
        "of `grasp detector evaluate --out`", Path)  # fmt: skip
    parser.option("--out FILE.html", "(default: beside the recording, or beside the file of a "
        "campaign or an evaluation, with its name)", file_to_write)  # fmt: skip
    no_settings(parser)


def report(args: argparse.Namespace) -> int:
    if args.out is not None and args.out.suffix != ".html":
        raise UsageError(
            f"--out {args.out}: not an HTML file name", "use a name that ends in .html"
        )
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
