"""The `grasp` command. Heavy imports live inside the verbs, so that `--help` answers at once."""

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from drivers.errors import GraspError, UnreadError, UsageError, in_words, one_line
from grasp import signals
from grasp.cli import (
    arm,
    calibrate,
    campaign,
    completion,
    config,
    dataset,
    detector,
    doctor,
    emulate,
    examples,
    exits,
    export,
    gripper,
    replay,
    report,
    run,
    runs,
    tactile,
)
from grasp.cli.output import known_streams, only_json, open_standard_streams
from grasp.cli.parser import EXAMPLES, Parser, RootParser
from grasp.files import LEADS_NOWHERE, NO_NAMES, TOO_MANY

VERBS = (
    run, campaign, replay, runs, report, export, dataset, detector, tactile, config, doctor,
    gripper, arm, calibrate, emulate,
)  # fmt: skip
GROUPS = {
    "try": ("run", "replay", "runs", "report", "export"),
    "measure": ("campaign", "dataset", "detector"),
    "a lab's devices": (
        "doctor", "status", "gripper", "arm", "tactile", "calibrate", "release", "emulate",
    ),
    "set up": ("config",),
}  # fmt: skip

MORE_FILES = "let this program open more files at once: ulimit -n 1024"
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
    gripper.add_release(verbs)
    arm.add_status(verbs)
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
        json = only_json() if as_json and not asked else nullcontext()
        with signals.taken(lambda f: exits.report_failure(f, as_json)), known_streams(), json:
            return _run(words, as_json)
    except KeyboardInterrupt:  # before or after all that could be told of it
        return exits.INTERRUPTED
    except OSError as error:  # of what --json had still to write
        return exits.report(*_of_the_system(error, words), as_json=False)


def _run(words: Sequence[str], as_json: bool) -> int:
    try:
        _check_text(words)
        args = build_parser().parse_args(words)
    except UsageError as error:
        return exits.report(error.kind, error.message, error.remedy, as_json)
    code = _done(args, words, as_json)
    try:
        sys.stdout.flush()
    except UnreadError:
        signalled = exits.nobody_reads()
        return code or signalled
    except OSError as error:
        return code or _told(error, words, as_json)
    return code


def _done(args: argparse.Namespace, words: Sequence[str], as_json: bool) -> int:
    try:
        code = int(args.handler(args))
    except UnreadError:
        return exits.nobody_reads()
    except BaseException as error:  # some of somebody's library, as its sys.exit()
        return _told(error, words, as_json)
    return code


def _told(error: BaseException, words: Sequence[str], as_json: bool) -> int:
    if isinstance(error, KeyboardInterrupt):
        with signals.deferred(sealed=True):
            return exits.report("interrupted", "interrupted", "", as_json)
    if isinstance(error, GraspError):
        return exits.report(error.kind, error.message, error.remedy, as_json)
    if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):  # a device's pipe
        return exits.report(*_of_the_system(error, words), as_json)
    if isinstance(error, Exception) and _of_the_compiled(error):
        return exits.report("config", *BAD_CACHE, as_json)
    return _bug(error, as_json)


def _check_text(words: Sequence[str]) -> None:
    """Raises UsageError for what no file can be called, before anything is done in its name: a
    result that tells of it could not be written either."""
    for word in words:
        if "\0" in word:
            raise UsageError(f"{word}: holds a NUL character", "leave it out")
        try:
            word.encode()
        except UnicodeEncodeError:
            remedy = "write it in UTF-8, or rename the file"
            raise UsageError(f"{word}: is no text in UTF-8", remedy) from None


def _of_the_system(error: OSError, words: Sequence[str]) -> tuple[str, str, str]:
    """Kind, message and remedy."""
    where = f"{one_line(error.filename)}: " if error.filename else ""
    text = f"{where}{error.strerror or error}"
    if _leads_nowhere(error, words):
        return "usage", text, "name a file or a folder that can be there"
    if error.errno in TOO_MANY:
        return "could_not_record", text, MORE_FILES
    return "could_not_record", text, "free the path or the disk"


def _leads_nowhere(error: OSError, words: Sequence[str]) -> bool:
    """Whether a name that was given is what is wrong, and no disk nor right."""
    if error.errno in NO_NAMES:  # no name of ours is that long
        return True
    if error.errno not in LEADS_NOWHERE or not isinstance(error.filename, str):
        return False
    path = Path(error.filename)
    given = {Path(part) for word in words for part in (word, word.rpartition("=")[2]) if part}
    return not given.isdisjoint((path, *path.parents))


def _of_the_compiled(error: Exception) -> bool:
    """Whether it came from where numba keeps compiled functions: no folder can be written, or a
    file there was cut off."""
    frames = traceback.extract_tb(error.__traceback__)
    return any(Path(frame.filename).parts[-3:] == NUMBA_CACHE for frame in frames)


def _bug(error: BaseException, as_json: bool) -> int:
    """A bug keeps its traceback, unless JSON was asked for."""
    if as_json:
        text = in_words(error)
        return exits.report("internal", text, "a bug: run without --json and report it", True)
    traceback.print_exc()
    return exits.INTERNAL
