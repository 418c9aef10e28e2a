"""`grasp campaign`: experiments by the hundred, in parallel, none of them lost."""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import add_workers, no_settings, whole, workers
from grasp.cli.places import file_to_write, file_with_folders, folder_to_fill
from grasp.files import write_whole

if TYPE_CHECKING:
    from scenarios.campaign.spec import CampaignSpec
    from scenarios.studies.table4.calibrate import Calibration, LikelihoodProfile, TradeOff
    from scenarios.studies.table4.cause import Cause

MOST_REPETITIONS = 10_000
HELP = "run a grid of trials in parallel; sum it up as the paper's Table IV"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("campaign", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _add_run(actions)
    _add_calibrate(actions)
    summary = actions.add_parser("summary", help="rates with intervals, latencies, slip distances")
    summary.add_argument("file", type=Path, metavar="FILE", help="SQLite file of a campaign")
    summary.add_argument("--json", action="store_true", help="one JSON object")
    no_settings(summary)
    summary.set_defaults(handler=summarize)
    export = actions.add_parser("export", help="write the rows as CSV")
    export.add_argument("file", type=Path, metavar="FILE", help="SQLite file of a campaign")
    export.add_argument(
        "--out", type=file_to_write, metavar="CSV", help="file to write (default: standard output)"
    )
    no_settings(export)
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
        "--out", type=file_with_folders, metavar="FILE",
        help="SQLite file to make (default: runs/campaigns/<name>.sqlite)",
    )  # fmt: skip
    run.add_argument(
        "--detector", metavar="NAME", help="in place of the detectors of the campaign file"
    )
    run.add_argument(
        "--profile", metavar="NAME", help="in place of the profiles of the campaign file"
    )
    run.add_argument(
        "--config", type=Path, action="append", metavar="FILE",
        help="TOML over the packaged settings and the campaign's `config`, for every trial; "
        "several: later ones on top",
    )  # fmt: skip
    run.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="one setting, for every trial; may be repeated; `grasp config show` lists them",
    )  # fmt: skip
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
        if key in spec.sweep or key in spec.unknowns:
            where = "sweep" if key in spec.sweep else "unknowns"
            raise UsageError(f"--set: {key} is set by {where} of the campaign", "leave it out")
    detector = next(iter(spec.detectors), None)
    files = [Path(word) for word in spec.config]
    load_config(spec.objects[0], "simulated", detector, files, assignments, spec.profiles[0])


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
    """As a frontier where the campaign has axes, as a range where it draws unknowns, else as Table
    IV."""
    import msgspec

    from grasp.cli import campaign_view, frontier_view
    from scenarios.campaign import frontier, spread
    from scenarios.campaign import summary as table
    from scenarios.campaign.store import CampaignStore

    with CampaignStore.open(path) as store:
        spec, rows = store.spec, store.rows()
    found: Any
    show: Any
    if spec.axes:
        found, show = frontier.summarize(spec.name, rows), frontier_view.print_frontier
    elif spec.unknowns:
        found, show = spread.summarize(spec.name, rows), frontier_view.print_spread
    else:
        found, show = table.summarize(spec.name, rows), campaign_view.print_summary
    if as_json:
        print(msgspec.json.encode(found).decode())
    else:
        show(found)


def write_csv(args: argparse.Namespace) -> int:
    import io
    import sys

    from scenarios.campaign.store import CampaignStore, is_database

    if args.out is not None and is_database(args.out):
        raise UsageError(f"{args.out} is a campaign itself", "name another file")
    with CampaignStore.open(args.file) as store:
        if args.out is None:
            store.write_csv(sys.stdout)
        else:
            text = io.StringIO(newline="")
            store.write_csv(text)
            write_whole(args.out, text.getvalue().encode())
    return exits.SUCCESS


def _add_calibrate(actions: Any) -> None:
    parser = actions.add_parser(
        "calibrate",
        help="fit arm speed and one length a short object to the paper's lift column",
        description="Runs lifts over a grid of arm speeds (acceleration in proportion) and of one "
        "length for each of ball, foam and football; gives the most likely values for the paper's "
        "lift column, how well it tells them, which trade off, and for what is not reproduced the "
        "cause. The tap column is never used. May be interrupted and run again.",
    )
    parser.add_argument(
        "--profile", default="paper", metavar="NAME",
        help="one of config/profiles (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--detector", metavar="NAME", help="default: the profile's")
    parser.add_argument(
        "--repetitions", type=whole(1, 100_000), default=20, metavar="N",
        help="lifts at each place of the grid (default: %(default)s; 60 places)",
    )  # fmt: skip
    add_workers(parser)
    parser.add_argument(
        "--out", type=folder_to_fill, default="runs/calibration", metavar="DIR",
        help="folder of the campaign files and of calibration.json (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.set_defaults(handler=calibrate_lengths)


def calibrate_lengths(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.cli.campaign_view import View
    from scenarios.studies.table4.calibrate import calibrate
    from scenarios.studies.table4.cause import explain

    by, out = workers(args), args.out
    with View("calibrate", quiet=args.json) as view:
        try:
            result = calibrate(args.detector, args.profile, args.repetitions, out, by, view.show)
            causes = explain(result, out, by, view.show)
        except KeyboardInterrupt:
            view.close()
            return exits.report(
                "interrupted", view.kept(out), "run the same command again", args.json
            )
    table = {"calibration": result, "causes": causes}
    text = msgspec.json.encode(table)
    write_whole(out / "calibration.json", msgspec.json.format(text, indent=1) + b"\n")
    if args.json:
        print(text.decode())
    else:
        _print_calibration(result, causes)
        print(out / "calibration.json")
    return exits.SUCCESS


def _print_calibration(result: "Calibration", causes: "list[Cause]") -> None:
    print(f"lift column, profile {result.profile}, detector {result.detector}, "
          f"{result.repetitions} lifts a place; arm speed {result.speed_mps:g} m/s")  # fmt: skip
    if result.coarse:
        print("COARSE: too few lifts a place to tell places apart, run it with 20 or more")
    for each in result.best:
        length = "" if each.length_m is None else f"  length {each.length_m * 1e3:g} mm"
        counts = "+".join(map(str, each.counts))
        print(f"  {each.object:<10} {each.rate:4.0%} ({counts})  p {each.p_value:.2g}{length}")
    away = result.best_possible - result.log_likelihood
    print(f"joint log-likelihood {result.log_likelihood:.1f}, {away:.1f} below the best possible")
    for profile in result.profiles:
        _print_profile(profile)
    for trade in result.trade_offs:
        _print_trade_off(trade)
    for cause in causes:
        _print_cause(cause)


def _print_profile(profile: "LikelihoodProfile") -> None:
    pairs = zip(profile.values, profile.log_likelihood, strict=True)
    shown = ", ".join(f"{value:g}: {score:.1f}" for value, score in pairs)
    plausible = ", ".join(f"{value:g}" for value in profile.plausible)
    border = f"; {plausible} plausible, the best at the border" if profile.at_border else ""
    flat = "; flat: not identified" if len(profile.plausible) == len(profile.values) else ""
    print(f"profile of {profile.object} {profile.setting}: {shown}{flat or border}")


def _print_trade_off(trade: "TradeOff") -> None:
    from scenarios.studies.table4.calibrate import trades

    pair = f"arm speed and {trade.object} {trade.setting}"
    if trade.everything:
        print(f"{pair}: every pair explains the object about as well: neither is identified by it")
    elif trades(trade):
        shown = ", ".join(f"{v:g} m/s with {x * 1e3:g} mm" for v, x in trade.pairs)
        print(f"{pair} trade off: {shown}")
    else:
        print(f"{pair} do not trade off")


def _print_cause(cause: "Cause") -> None:
    shown = _by_class((f"{share:.0%}" for share in cause.shares), cause)
    paper = _by_class((f"{low:.0%}-{high:.0%}" for low, high in cause.paper), cause)
    print(f"{cause.object}: {shown}; the paper {paper}. Alone, over its range:")
    for each in cause.ranges:
        verdict = "could be the cause" if each.reaches else "cannot be the cause"
        spans = (f"{a:.0%} to {b:.0%}" for a, b in zip(each.low, each.high, strict=True))
        print(f"  {each.cause:<24} gives {_by_class(spans, cause)}: {verdict}")


def _by_class(texts: Iterable[str], cause: "Cause") -> str:
    names = ("within 6 cm", "within 12 cm", "lost") if len(cause.paper) == 3 else ("held", "lost")
    return ", ".join(f"{text} {name}" for text, name in zip(texts, names, strict=True))
