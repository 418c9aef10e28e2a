"""The `grasp` command. Heavy imports live inside the verbs, so that `--help` answers at once."""

import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from drivers.errors import GraspError
from grasp import interruption
from grasp.cli import (
    arm,
    calibrate,
    campaign,
    chart,
    completion,
    config,
    dataset,
    detector,
    doctor,
    emulate,
    examples,
    exits,
    export,
    find,
    grip_search,
    gripper,
    release,
    replay,
    report,
    run,
    runs,
    tactile,
    world,
)
from grasp.cli.output import only_json, open_standard_streams
from grasp.cli.parser import EXAMPLES, Parser, RootParser

VERBS = (
    run, campaign, grip_search, replay, runs, report, export, chart, dataset, detector, tactile,
    world, config, doctor, find, gripper, arm, calibrate, emulate, release,
    completion,
)  # fmt: skip
GROUPS = {
    "try": ("run", "replay", "runs", "report", "export"),
    "measure": ("campaign", "chart", "grip-search", "dataset", "detector", "world"),
    "a lab's devices": (
        "find",
        "doctor",
        "gripper",
        "arm",
        "tactile",
        "calibrate",
        "release",
        "emulate",
    ),
    "set up": ("config", "completion"),
}

NUMBA_CACHE = ("numba", "core", "caching.py")
BAD_CACHE = (
    "compiled functions cannot be kept or read",
    "set NUMBA_CACHE_DIR to an empty folder that can be written",
)


def build_parser() -> Parser:
    """The whole command line; builds no device and imports nothing heavy."""
    parser = RootParser(
        prog="grasp",
        groups=GROUPS,
        description="Closed-loop grasp controller: feels slip with barometric fingertips and "
        "closes a Robotiq 3-Finger gripper as fast as it can within a force limit.",
        epilog="`grasp VERB --help` has a verb's options and examples. Exit codes: 0 success, 1 "
        "trial failed, 2 usage or configuration, 3 device, 4 safety stop, 5 could not record or "
        "internal error, 130 interrupted (143 told to end, 129 terminal closed).",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {_version()}")
    verbs = parser.add_subparsers(metavar="VERB", required=True, parser_class=Parser)
    for verb in VERBS:
        verb.add_parser(verbs)
    for name, lines in examples.EXAMPLES.items():
        _leaf(parser, name).epilog = EXAMPLES + "\n".join(f"  {line}" for line in lines)
    return parser


def _leaf(parser: Parser, name: str) -> Parser:
    """The parser of a verb, by the words that lead to it."""
    for word in name.split():
        parser = parser.verbs()[word]
    return parser


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("grasp-controller")
    except PackageNotFoundError:
        return "unknown (not installed)"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Expected errors become one line, no traceback."""
    if completion.ASKED in os.environ:
        completion.complete(build_parser())
    open_standard_streams()
    words = sys.argv[1:] if argv is None else argv
    as_json = "--json" in words
    asked = {"-h", "--help", "--version"} & set(words)
    try:
        with interruption.taken(), only_json() if as_json and not asked else nullcontext():
            return _run(words, as_json)
    except KeyboardInterrupt:  # before or after all that could be told of it
        return exits.INTERRUPTED


def _run(words: Sequence[str], as_json: bool) -> int:
    try:
        args = build_parser().parse_args(words)
        code = int(args.handler(args))
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        with interruption.sealed():
            return exits.report("interrupted", "interrupted", "", as_json)
    except BrokenPipeError:
        return exits.nobody_reads()
    except GraspError as error:
        return exits.report(error.kind, error.message, error.remedy, as_json)
    except OSError as error:
        if interruption.asked():
            return exits.nobody_reads()
        where = f"{error.filename}: " if error.filename else ""
        text = f"{where}{error.strerror or error}"
        lacking = isinstance(error, FileNotFoundError | NotADirectoryError)
        remedy = "name a folder that is there" if lacking else "free the path or the disk"
        return exits.report("could_not_record", text, remedy, as_json)
    except Exception as error:
        if _of_the_compiled(error):
            return exits.report("config", *BAD_CACHE, as_json)
        return _bug(error, as_json)


def _of_the_compiled(error: Exception) -> bool:
    """Whether it came from where numba keeps compiled functions: no folder can be written, or a
    file there was cut off."""
    frames = traceback.extract_tb(error.__traceback__)
    return any(Path(frame.filename).parts[-3:] == NUMBA_CACHE for frame in frames)


def _bug(error: Exception, as_json: bool) -> int:
    """A bug keeps its traceback, unless JSON was asked for."""
    if as_json:
        text = f"{type(error).__name__}: {error}"
        return exits.report("internal", text, "a bug: run without --json and report it", True)
    traceback.print_exc()
    return exits.INTERNAL
