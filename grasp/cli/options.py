"""Options that several verbs share."""

import argparse
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.errors import UsageError
from grasp.cli.parser import Parser

if TYPE_CHECKING:
    from scenarios.rigs.config import AnyRigConfig
    from scenarios.rigs.permission import MotionPermit
    from scenarios.rigs.workers import Workers

MOST_JOBS = 256
RUNS = "runs"
LINES = 10  # where there is no terminal: a line for each tenth
OBJECT_HELP = (
    "one of config/objects (ball, box, can, cardboard, foam, football; kept for testing: book, "
    "bottle, jar, mug, orange, sponge), or the path of a .toml file of one's own"
)


def whole(least: int, most: int) -> Callable[[str], int]:
    """Reads a whole number within bounds."""

    def number(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r}: a whole number, {least} to {most}")
        return int(text)

    return number


def decimal(least: float, most: float) -> Callable[[str], float]:
    """Reads a number within bounds."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text!r}: a number, {least:g} to {most:g}")
        return value

    return number


seed = whole(0, 2**63 - 1)


def need(extra: str, *packages: str) -> None:
    """Raises UsageError, with the remedy, where packages of an extra are not installed."""
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        remedy = f"make install-{extra}, or elsewhere pip install 'grasp-controller[{extra}]'"
        raise UsageError(f"this needs {' and '.join(missing)}", remedy)


@contextmanager
def progress(
    doing: str, hidden: bool = False, every_s: float = math.inf
) -> "Iterator[Callable[..., None]]":
    """A moving bar with the time left on standard error, a line for each tenth where that is no
    terminal, and after ``every_s`` without one; yields what takes done, total and what is done
    now."""
    from rich.console import Console
    from rich.progress import Progress

    if not hidden and not sys.stderr.isatty():
        yield _lines(doing, every_s)
        return
    with Progress(console=Console(stderr=True), transient=True, disable=hidden) as bar:
        task = bar.add_task(doing, total=None)
        yield lambda done, total, text=doing: bar.update(
            task, completed=done, total=total, description=text
        )


def _lines(doing: str, every_s: float) -> Callable[..., None]:
    start_s, shown, last = time.monotonic(), 0, 0
    told_s = start_s

    def show(done: int, total: int, text: str = doing) -> None:
        nonlocal start_s, shown, last, told_s
        now_s = time.monotonic()
        if done < last:  # the next of several
            start_s, shown = now_s, 0
        last = done
        silent = done < 1 or now_s - told_s < every_s
        if LINES * done // max(1, total) <= shown and silent:
            return
        shown, told_s = LINES * done // total, now_s
        left_s = (now_s - start_s) * (total - done) / done
        print(f"{text}: {done} of {total}, {left_s:.0f} s left", file=sys.stderr)

    return show


def one_by_one(
    names: Sequence[str], doing: str, hidden: bool
) -> Iterator[tuple[str, Callable[[int, int], None]]]:
    """The names one by one, each with what takes how much of the work on it is done, of how much:
    a bar or lines of its own."""
    with progress(doing, hidden) as show:
        for name in names:
            yield name, partial(show, text=f"{doing} {name}")


def add_runs(parser: Parser, kind: Callable[[str], Path] = Path) -> None:
    """`--runs DIR`. ``kind``: what reads it, and the folder that nobody named too: a text."""
    parser.option("--runs DIR", "folder of recordings", kind, default=RUNS)


def add_settings(parser: Parser, of: str = "") -> None:
    """`--config FILE`, `--set SECTION.KEY=VALUE`. ``of``: what they are for, if not for all."""
    parser.option("--config FILE",
        f"{of}TOML over the packaged settings; several: later ones on top (default: "
        "$GRASP_CONFIG)", Path, action="append")  # fmt: skip
    parser.option("--set SECTION.KEY=VALUE",
        f"{of}one setting; may be repeated; `grasp config` lists them", action="append",
        default=[])  # fmt: skip


def no_settings(parser: Parser) -> None:
    """Of verbs that show what was made before: `--config` and `--set` would change nothing."""
    parser.refuse(
        "--config", "--set", because="what was recorded keeps the settings that it was made with"
    )


def add_confirmation(parser: Parser) -> None:
    """`--confirm-motion`, of the verbs that may move real devices."""
    parser.flag("--confirm-motion", "required for every motion of the hardware rig: confirms that "
        "the cell is clear and a person watches")  # fmt: skip


def motion_permit(config: "AnyRigConfig", args: argparse.Namespace) -> "MotionPermit | None":
    """Leave to move real devices, by what `add_settings` and `add_confirmation` read; None where
    the rig has none. For verbs made for a lab alone."""
    from scenarios.rigs.permission import permit

    return permit(config, args.confirm_motion, args.config, args.set, args.rig)


def network_path(word: str) -> Path:
    """The weights of a packaged network or of a file; raises UsageError for a name that is none."""
    from detector.network_file import is_weights, packaged_networks, weights_path
    from grasp.settings import meant

    known = packaged_networks()
    if not is_weights(word) and word not in known:
        told = f"{word!r} is no network of this project{meant(word, known)}"
        raise UsageError(told, f"one of {', '.join(known)}, or a file that ends in .onnx")
    return weights_path(word)


def add_workers(parser: Parser) -> None:
    """`--jobs N`: worker processes on this machine; `--cluster ADDRESS`: a Dask cluster's."""
    parser.option("--jobs N", "worker processes (default: one per core)", whole(1, MOST_JOBS),
        default=len(os.sched_getaffinity(0)))  # fmt: skip
    parser.option("--cluster ADDRESS", "use the workers of this Dask scheduler instead, e.g. "
        "tcp://10.0.0.1:8786 (needs the extra `cluster`)")  # fmt: skip


def workers(args: argparse.Namespace) -> "Workers":
    """Who works, by what `add_workers` read."""
    from scenarios.rigs.workers import Workers

    return Workers(args.jobs, args.cluster)
