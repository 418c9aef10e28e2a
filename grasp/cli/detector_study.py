"""`grasp detector robustness`, `grasp chart observer` and `grasp detector fingertips`: what is
endured, what is possible, and with which fingertip."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits
from grasp.cli.options import add_workers, decimal, need, progress, whole, workers
from grasp.cli.pictures import add_picture, write_numbers
from grasp.cli.rules import check_named

COMPARED = ("tcn", "gru", "energy", "psd-fair")


def add_robustness(actions: Any) -> None:
    text = "detectors on recordings with something wrong: gain, taxels, noise, samples, rate, pad"
    parser = actions.add_parser(
        "robustness", help=text,
        description=text + ". A fixed part of the split `test`, by the packaged rules; prints a "
        "Markdown table. Needs the extra `charts`.",
    )  # fmt: skip
    _add_names(parser)
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR",
        help="folders of `grasp dataset build`, or `collect`",
    )  # fmt: skip
    parser.add_argument(
        "--recordings", type=whole(1, 100_000), default=150, metavar="N",
        help="at most about so many, the same share of every cause (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--no-pad", action="store_true", help="leave out the stiffer pad, which is simulated anew"
    )
    add_picture(parser, "robustness")
    parser.set_defaults(handler=robustness)


def add_observer(charts: Any) -> None:
    text = "how good any detector could be: an ideal observer of blows and lifts, and detectors"
    parser = charts.add_parser(
        "observer", help=text,
        description=text + ". Draws and records objects of its own, some 3,000 blows (minutes), "
        "and trains on them. Needs the extras `train` and `charts`.",
    )  # fmt: skip
    _add_names(parser)
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR",
        help="where its recordings are kept; what is there already is not made again",
    )  # fmt: skip
    parser.add_argument(
        "--share", type=decimal(1e-3, 1), default=0.75, metavar="X",
        help="of the recordings of config/datasets/observer.toml (default: %(default)s)",
    )  # fmt: skip
    add_workers(parser)
    add_picture(parser, "observer")
    parser.set_defaults(handler=observer)


def add_fingertips(actions: Any) -> None:
    text = "what an ideal observer of blows would hear of another fingertip: rate, taxels, noise"
    parser = actions.add_parser(
        "fingertips", help=text,
        description=text + ". The same drawn objects and blows, felt by fingertips that differ in "
        "one thing each, so that differences are paired; the observer learns anew from each, and "
        "is judged on objects that it has not learnt from. Lesser fingertips are made of the "
        "recordings as they are; others are recorded anew, a second or two a recording. All seeds "
        "are fixed: equal shares give equal numbers. Prints Markdown tables. Needs the extra "
        "`train`.",
    )  # fmt: skip
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR",
        help="where its recordings are kept, a folder a fingertip; what is there already is not "
        "made again, and `run` is that of `grasp chart observer`",
    )  # fmt: skip
    parser.add_argument(
        "--share", type=decimal(1e-3, 1), default=0.15, metavar="X",
        help="of the recordings of blows of config/datasets/observer.toml (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--share-anew", type=decimal(0, 1), default=0.15, metavar="X",
        help="likewise, for fingertips that are recorded anew; 0: none (default: %(default)s)",
    )  # fmt: skip
    add_workers(parser)
    parser.set_defaults(handler=fingertips)


def _add_names(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "detector", nargs="*", metavar="NAME", default=COMPARED,
        help=f"some of config/detectors (default: {' '.join(COMPARED)})",
    )  # fmt: skip


def robustness(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from scenarios.benchmark.scoring import read_split
    from scenarios.studies.detectors.robustness import (
        chosen,
        made_stiffer,
        rest_min,
        study,
        table,
    )
    from scenarios.studies.detectors.robustness_figure import draw_robustness

    check_named(args.detector)
    recordings = chosen(read_split(args.data, "test", exits.say), args.recordings)
    with progress("a stiffer pad") as show:
        stiffer = [] if args.no_pad else made_stiffer(args.data, recordings, show)
    with progress("streaming") as show:
        found = study(args.detector, recordings, stiffer, show)
    draw_robustness(found, args.out)
    write_numbers(args.out, found)
    print(table(found))
    if minutes := rest_min(recordings):
        exits.say(
            f"{len(recordings)} recordings, some {minutes:.1f} minutes of a hand at rest: one "
            f"false event more or less is {1.0 / minutes:.2g} a minute"
        )
    print(args.out)
    return exits.SUCCESS


def observer(args: argparse.Namespace) -> int:
    need("train", "torch")
    need("charts", "matplotlib")
    from scenarios.studies.detectors.observer_figure import draw_observer
    from scenarios.studies.detectors.observer_study import study, tables

    check_named(args.detector)
    with progress("recordings") as show:
        found = study(args.detector, args.data, args.share, workers(args), show)
    draw_observer(found, args.out)
    write_numbers(args.out, found)
    print(tables(found))
    print(args.out)
    return exits.SUCCESS


def fingertips(args: argparse.Namespace) -> int:
    need("train", "torch")
    from scenarios.studies.detectors.fingertips import study, tables

    with progress("recordings") as show:
        found = study(args.data, args.share, args.share_anew, workers(args), show)
    print(tables(found))
    return exits.SUCCESS
