"""`grasp campaign`: experiments by the hundred, in parallel, none of them lost."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp.cli import campaign_calibrate, exits
from grasp.cli.options import add_workers, whole, workers

if TYPE_CHECKING:
    from scenarios.campaign.spec import CampaignSpec

MOST_REPETITIONS = 10_000
HELP = "run a grid of trials in parallel; sum it up as the paper's Table IV"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("campaign", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _add_run(actions)
    campaign_calibrate.add_parser(actions)
    summary = actions.add_parser("summary", help="rates with intervals, latencies, slip distances")
    summary.add_argument("file", type=Path, metavar="FILE", help="SQLite file of a campaign")
    summary.add_argument("--json", action="store_true", help="one JSON object")
    summary.set_defaults(handler=summarize)
    export = actions.add_parser("export", help="write the rows as CSV")
    export.add_argument("file", type=Path, metavar="FILE", help="SQLite file of a campaign")
    export.add_argument(
        "--out", type=Path, metavar="CSV", help="file to write (default: standard output)"
    )
    export.set_defaults(handler=write_csv)


def _add_run(actions: Any) -> None:
    run = actions.add_parser(
        "run",
        help="run the trials of a campaign file",
        description="Runs every trial of a campaign file and writes each as a row of an SQLite "
        "file when it finishes. Exit code 0 when every trial ran, whatever its verdict; 1 if any "
        "errored; 130 when interrupted, with all finished rows kept.",
    )
    run.add_argument(
        "campaign", metavar="FILE", help="campaign file, or the name of one of config/campaigns"
    )
    add_workers(run)
    run.add_argument(
        "--out", type=Path, metavar="FILE",
        help="SQLite file to make (default: runs/campaigns/<name>.sqlite)",
    )  # fmt: skip
    run.add_argument(
        "--detector", metavar="NAME", help="in place of the detectors of the campaign file"
    )
    run.add_argument(
        "--repetitions",
        type=whole(1, MOST_REPETITIONS),
        metavar="N",
        help="in place of the campaign file's",
    )
    run.add_argument(
        "--resume", action="store_true",
        help="go on with an existing file: run what is missing or errored",
    )  # fmt: skip
    run.add_argument(
        "--json", action="store_true", help="the summary as one JSON object, nothing else"
    )
    run.set_defaults(handler=run_campaign)


def _spec(args: argparse.Namespace) -> "CampaignSpec":
    import msgspec

    from scenarios.campaign.spec import read_spec

    changes = {
        "detectors": (args.detector,) if args.detector else None,
        "repetitions": args.repetitions,
    }
    wanted = {key: value for key, value in changes.items() if value is not None}
    return msgspec.structs.replace(read_spec(_path(args.campaign)), **wanted)


def _path(word: str) -> Path:
    """A campaign file by its path, or by its name in config/campaigns."""
    from grasp.settings import config_dir, named_layer

    if word.endswith(".toml") or os.sep in word:
        return Path(word)
    named_layer("campaigns", word)  # raises ConfigError with the known names
    return config_dir() / "campaigns" / f"{word}.toml"


def run_campaign(args: argparse.Namespace) -> int:
    from grasp.cli.campaign_view import View
    from scenarios.campaign.run import default_path, run

    spec = _spec(args)
    out = args.out or default_path(spec)
    with View(spec.name, quiet=args.json) as view:
        try:
            progress = run(spec, out, workers(args), args.resume, view.show)
        except KeyboardInterrupt:
            view.close()
            return exits.report("interrupted", view.kept(out), "go on with --resume", args.json)
    _print_summary(out, args.json)
    if not args.json:
        print(out)
    return exits.TRIAL_FAILED if progress.errors else exits.SUCCESS


def summarize(args: argparse.Namespace) -> int:
    _print_summary(args.file, args.json)
    return exits.SUCCESS


def _print_summary(path: Path, as_json: bool) -> None:
    import msgspec

    from grasp.cli.campaign_view import print_summary
    from scenarios.campaign.store import CampaignStore
    from scenarios.campaign.summary import summarize as sum_up

    with CampaignStore.open(path) as store:
        summary = sum_up(store.spec.name, store.rows())
    if as_json:
        print(msgspec.json.encode(summary).decode())
    else:
        print_summary(summary)


def write_csv(args: argparse.Namespace) -> int:
    import sys

    from scenarios.campaign.store import CampaignStore

    with CampaignStore.open(args.file) as store:
        if args.out is None:
            store.write_csv(sys.stdout)
        else:
            with args.out.open("w", newline="", encoding="utf-8") as file:
                store.write_csv(file)
    return exits.SUCCESS
