"""`grasp campaign`: experiments by the hundred, in parallel, none of them lost."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import add_workers, progress, whole, workers
from grasp.cli.parser import group, verb
from grasp.cli.places import file_with_folders

if TYPE_CHECKING:
    from scenarios.campaign.spec import CampaignSpec

MOST_REPETITIONS = 10_000
HELP = "run a grid of trials in parallel; sum it up as the paper's Table IV"


def add_parser(verbs: Any) -> None:
    actions = group(verbs, "campaign", HELP)
    _add_run(actions)


def _add_run(actions: Any) -> None:
    run = verb(actions, "run", run_campaign, "run the trials of a campaign file", ". Runs every "
        "trial of a campaign file and writes each as a row of an SQLite file when it finishes. "
        "Exit code 0 when every trial ran, whatever its verdict; 1 if any errored; 130 when "
        "interrupted, with all finished rows kept.")  # fmt: skip
    run.option("campaign FILE", "campaign file, or the name of one of config/campaigns")
    add_workers(run)
    run.option("--out FILE", "SQLite file to write (default: runs/campaigns/<name>.sqlite)",
        file_with_folders)  # fmt: skip
    run.option("--detector NAME", "use this instead of the detectors of the campaign file")
    run.option("--profile NAME", "use this instead of the profiles of the campaign file")
    run.option("--config FILE", "TOML over the packaged settings and the campaign's `config`, for "
        "every trial; several: later ones on top", Path, action="append")  # fmt: skip
    run.option("--set SECTION.KEY=VALUE", "one setting, for every trial; may be repeated; `grasp "
        "config` lists them", action="append", default=[])  # fmt: skip
    run.option(
        "--repetitions N", "use this instead of the campaign file's", whole(1, MOST_REPETITIONS)
    )
    run.flag("--resume", "continue an existing file: run the missing and errored trials")
    run.flag("--json", "the summary as one JSON object, nothing else")


def _spec(args: argparse.Namespace) -> "CampaignSpec":
    import msgspec

    from grasp.settings import file_of
    from scenarios.campaign.spec import read_spec

    changes = {
        "detectors": (args.detector,) if args.detector is not None else None,
        "profiles": (args.profile,) if args.profile is not None else None,
        "repetitions": args.repetitions,
    }
    wanted = {key: value for key, value in changes.items() if value is not None}
    spec = read_spec(file_of("campaigns", args.campaign))
    own = (*spec.config, *map(str, args.config or ()))
    spec = msgspec.structs.replace(spec, config=own, **wanted)
    _check_set(spec, args.set)
    return msgspec.structs.replace(spec, settings=(*spec.settings, *args.set))


def _check_set(spec: "CampaignSpec", assignments: Sequence[str]) -> None:
    """Raises ConfigError that names `--set` for a wrong one, UsageError for what the campaign
    itself sets in each trial: it would be ignored."""
    from scenarios.campaign.config import load_config

    if not assignments:
        return
    for assignment in assignments:
        key = assignment.partition("=")[0].strip()
        if key in spec.sweep:
            raise UsageError(f"--set: the campaign's sweep already sets {key}", "leave it out")
    detector = next(iter(spec.detectors), None)
    files = [Path(word) for word in spec.config]
    load_config(spec.objects[0], "simulated", detector, files, assignments, spec.profiles[0])


def run_campaign(args: argparse.Namespace) -> int:
    from scenarios.campaign.run import default_path, run

    spec = _spec(args)
    out, last = args.out or default_path(spec), None
    with progress(spec.name, hidden=args.json) as bar:

        def show(at: Any) -> None:
            nonlocal last
            last = at
            good = f", {at.successes / at.new:.0%} succeeded" if at.new else ""
            wrong = f", {at.errors} ERRORS" if at.errors else ""
            bar(at.new, at.total - at.done + at.new, f"{spec.name}{good}{wrong}")

        try:
            ended = run(spec, out, workers(args), args.resume, show)
        except KeyboardInterrupt:
            kept = "interrupted before any trial ended"
            if last is not None:
                kept = f"{last.done} of {last.total} trials are in {out}"
            return exits.report("interrupted", kept, "continue with --resume", args.json)
    print_summary(out, args.json)
    if not args.json:
        print(out)
    return exits.TRIAL_FAILED if ended.errors else exits.SUCCESS


def print_summary(path: Path, as_json: bool) -> None:
    """Print Table IV of a campaign file."""
    import msgspec

    from grasp.cli.campaign_view import print_summary as print_tables
    from scenarios.campaign.store import CampaignStore
    from scenarios.campaign.summary import summarize

    with CampaignStore.open(path) as store:
        found = summarize(store.spec.name, store.rows())
    if as_json:
        print(msgspec.json.encode(found).decode())
    else:
        print_tables(found)
