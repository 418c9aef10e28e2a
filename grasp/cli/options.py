"""Options that several verbs share."""

import argparse
import os
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.rigs.workers import Workers

MOST_JOBS = 256


def whole(least: int, most: int) -> Callable[[str], int]:
    """Reads a whole number within bounds."""

    def number(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r}: a whole number, {least} to {most}")
        return int(text)

    return number


def add_workers(parser: argparse.ArgumentParser) -> None:
    """`--jobs N`: worker processes on this machine; `--cluster ADDRESS`: a Dask cluster's."""
    parser.add_argument(
        "--jobs", type=whole(1, MOST_JOBS), default=len(os.sched_getaffinity(0)), metavar="N",
        help="worker processes (default: one a core)",
    )  # fmt: skip
    parser.add_argument(
        "--cluster", metavar="ADDRESS",
        help="work on the workers of this Dask scheduler instead, e.g. tcp://10.0.0.1:8786 "
        "(needs the extra `cluster`)",
    )  # fmt: skip


def workers(args: argparse.Namespace) -> "Workers":
    """Who works, by what `add_workers` read."""
    from scenarios.rigs.workers import Workers

    return Workers(args.jobs, args.cluster)
