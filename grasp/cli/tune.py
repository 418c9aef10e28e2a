"""`grasp detector tune`: a rule, or the scalar's threshold, for a budget of false events."""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from drivers.errors import BadFile
from grasp.cli import exits

TUNING_OBJECTS = ("can", "box", "cardboard", "ball", "football", "foam")


def add_parser(actions: Any) -> None:
    text = "find the quickest decision within a budget of false events"
    parser = actions.add_parser(
        "tune",
        help=text,
        description=text + ". With --data: kind, threshold and length of the decision rule of any "
        "detector, on the split `validation`. Without: the least threshold of `energy`, on "
        "simulated lifts in which nothing slips (all objects), or on recordings of your own in "
        "which nothing slips.",
    )
    parser.add_argument("detector", nargs="?", default="energy", metavar="NAME")
    parser.add_argument(
        "--budget", type=float, default=1.0, metavar="N",
        help="false events a minute, three fingers together (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--data", type=Path, nargs="+", metavar="DIR", help="folders made by `grasp dataset build`"
    )
    parser.add_argument(
        "--lifts", type=int, default=60, metavar="N",
        help="simulated lifts an object (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--static", type=Path, nargs="+", metavar="PATH.csv",
        help="tune on these recordings instead; samples labelled slip are an error",
    )  # fmt: skip
    add_common(parser)
    parser.set_defaults(handler=tune)


def add_common(parser: argparse.ArgumentParser) -> None:
    """Options of every verb that loads a detector."""
    parser.add_argument(
        "--config", type=Path, metavar="FILE",
        help="TOML over the packaged settings (default: $GRASP_CONFIG)",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="one setting; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--json", action="store_true",
        help="JSON on standard output, one object a detector, nothing else",
    )  # fmt: skip


def shown(names: Sequence[str], doing: str, hidden: bool) -> Iterator[str]:
    """The names one by one, with a moving bar on standard error while each is worked on."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=hidden) as bar:
        task = bar.add_task(doing, total=len(names))
        for name in names:
            bar.update(task, description=f"{doing} {name}")
            yield name
            bar.advance(task)


def tune(args: argparse.Namespace) -> int:
    if args.data:
        return _tune_rule(args)
    if args.detector != "energy":
        remedy = "give --data, folders made by `grasp dataset build`"
        return exits.report("usage", f"{args.detector} is tuned on data sets", remedy, args.json)
    threshold, minutes = _tune_on_recordings(args) if args.static else _tune_on_lifts(args)
    if args.json:
        print(json.dumps({"threshold_counts": threshold, "minutes": minutes}))
    else:
        print(f"threshold_counts = {threshold:.3g}  # {args.budget:g} false events a minute, "
              f"tuned on {minutes:.1f} minutes")  # fmt: skip
    return exits.SUCCESS


def _tune_rule(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.studies.detectors.benchmark import contender, read_split, tune_rule

    recordings = read_split(args.data, "validation")
    (name,) = [args.detector]
    for _ in shown([name], "tuning", hidden=args.json):
        made = contender(name, recordings, "validation", "slip", args.config, args.set)
        chosen = tune_rule(made, args.budget)
    if chosen is None:
        remedy = "allow more false events with --budget"
        text = f"no rule keeps {name} within {args.budget:g} false events a minute"
        return exits.report("usage", text, remedy, args.json)
    if args.json:
        print(msgspec.json.encode(chosen).decode())
        return exits.SUCCESS
    print(f"# {chosen.false_per_min:.2f} false events a minute, delay {chosen.delay_ms:.0f} ms "
          f"median, {chosen.mean_delay_ms:.0f} mean, recall {chosen.recall:.3f}, on the split "
          f"validation\n[rule]")  # fmt: skip
    for key, value in msgspec.to_builtins(chosen.rule).items():
        print(f"{key} = {json.dumps(value if isinstance(value, str) else round(value, 4))}")
    return exits.SUCCESS


def _tune_on_lifts(args: argparse.Namespace) -> tuple[float, float]:
    from rich.console import Console
    from rich.progress import Progress

    from scenarios.campaign.settings import load_config
    from scenarios.studies.detectors.tune import tune as tune_on_lifts

    configs = [
        load_config(name, "simulated", "energy", args.config, args.set).for_lift()
        for name in TUNING_OBJECTS
    ]
    with Progress(console=Console(stderr=True), transient=True, disable=args.json) as bar:
        task = bar.add_task("static lifts", total=None)
        return tune_on_lifts(
            configs, args.lifts, args.budget,
            lambda done, total: bar.update(task, completed=done, total=total),
        )  # fmt: skip


def _tune_on_recordings(args: argparse.Namespace) -> tuple[float, float]:
    from detector.energy import tune_threshold
    from detector.recordings import read
    from scenarios.campaign.settings import load_config

    config = load_config("can", "simulated", "energy", args.config, args.set)
    recordings = [read(path) for path in args.static]
    for recording in recordings:
        if recording.slip.any():
            raise BadFile(
                recording.source, "holds samples labelled slip", "give recordings at rest"
            )
    threshold = tune_threshold(
        [r.counts for r in recordings], config.energy, config.rule, args.budget
    )
    return threshold, sum(len(r.t_s) for r in recordings) * config.loop.period_s / 60
