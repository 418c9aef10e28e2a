"""Options that several verbs share."""

import argparse
import os
from collections.abc import Callable

MOST_JOBS = 256


def whole(least: int, most: int) -> Callable[[str], int]:
    """Reads a whole number within bounds."""

    def number(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r}: a whole number, {least} to {most}")
        return int(text)

    return number


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """`--jobs N`: worker processes on this machine."""
    parser.add_argument(
        "--jobs", type=whole(1, MOST_JOBS), default=len(os.sched_getaffinity(0)), metavar="N",
        help="worker processes (default: one a core)",
    )  # fmt: skip
