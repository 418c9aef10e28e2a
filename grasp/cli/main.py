"""The `grasp` command. Heavy imports are inside the commands, so that `--help` answers at once."""

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from drivers.errors import GraspError, UnreadError, UsageError, in_words, one_line
from grasp import interruption
from grasp.cli import (
    calibrate,
    campaign,
    config,
    dataset,
    detector,
    devices,
    emulate,
    exits,
    fingertips,
    recordings,
    run,
)
from grasp.cli.output import guarded_streams, only_json, open_standard_streams
from grasp.cli.parser import COMPLETING, Parser, complete
from grasp.files import LEADS_NOWHERE, NO_NAMES, TOO_MANY

# section of the help, command, its help, and what adds its options or its own commands
TRY, MEASURE, LAB, SET_UP = "try", "measure", "a lab's devices", "set up"
COMMANDS = (
    (TRY, "run", "run a scenario", run.add_scenarios),
    (TRY, "replay", "feed a recording through detector, slip monitor and controller",
     recordings.add_replay),
    (TRY, "runs", "list recorded runs with their verdicts; summarise a campaign as the paper's "
     "Table IV", recordings.add_runs),
    (TRY, "report", "one page that shows a run, a campaign or an evaluation, in one file that "
     "opens from disk", recordings.add_report),
    (TRY, "export", "a run or a campaign as a CSV table, a run as a picture, or a viewer's layout",
     recordings.add_export),
    (MEASURE, "campaign", "run a grid of trials in parallel; sum it up as the paper's Table IV",
     campaign.add_commands),
    (MEASURE, "dataset", "build and collect data sets of labelled fingertip recordings",
     dataset.add_commands),
    (MEASURE, "detector", "score, tune and train slip detectors", detector.add_commands),
    (LAB, "doctor", "check this machine and the devices, or which devices answer at addresses; "
     "moves nothing", devices.add_doctor),
    (LAB, "status", "what a lab's gripper or arm reports, and what prevents a run; moves nothing",
     devices.add_status),
    (LAB, "gripper", "activate a lab's gripper, move it slowly", devices.add_gripper),
    (LAB, "arm", "move a lab's arm by one slow step, stop it", devices.add_arm),
    (LAB, "tactile", "fingertips: wiring, rest and noise", fingertips.add_commands),
    (LAB, "calibrate", "calibrate counts and force bytes on a scale; fit the simulated fingertip",
     calibrate.add_commands),
    (LAB, "release", "open all fingers of a hand slowly, at its least force", devices.add_release),
    (LAB, "emulate", "run the emulated cell: gripper on Modbus TCP, fingertips over USB transfers, "
     "arm on RTDE", emulate.add_options),
    (SET_UP, "config", "show the resolved settings, check files of your own", config.add_options),
)  # fmt: skip
MORE_FILES = "let this program open more files at once: ulimit -n 1024"
NUMBA_CACHE = ("numba", "core", "caching.py")
BAD_CACHE = (
    "compiled functions cannot be kept or read",
    "set NUMBA_CACHE_DIR to an empty folder that can be written",
)


def build_parser(only: str = "") -> Parser:
    """The whole command line, or of its commands the ``only`` one with what it takes."""
    parser = Parser(
        prog="grasp",
        description="Closed-loop grasp controller: feels slip with barometric fingertips and "
        "closes a Robotiq 3-Finger gripper as fast as it can within a force limit.",
        epilog="`grasp VERB --help` has a verb's options and examples. Exit codes: 0 success, 1 "
        "trial failed, 2 usage or configuration, 3 device, 4 safety stop, 5 could not record or "
        "internal error, 130 interrupted (143 told to end, 129 terminal closed).",
    )
    parser.add_argument("--version", action="store_true", help="show the version and exit")
    for section, name, text, add in COMMANDS:
        command = parser.command(name, text, section, "VERB")
        if only in ("", name):
            add(command)
    return parser


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("grasp-controller")
    except PackageNotFoundError:
        return "unknown (not installed)"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Expected errors become one line, no traceback."""
    if COMPLETING in os.environ:
        complete(build_parser())
    open_standard_streams()
    words = sys.argv[1:] if argv is None else argv
    if words[:1] == ["--version"]:
        print(f"grasp {_version()}")
        return exits.SUCCESS
    as_json = "--json" in words
    json = only_json() if as_json and not {"-h", "--help"} & set(words) else nullcontext()
    try:
        with (
            interruption.taken(lambda failure: exits.report_failure(failure, as_json)),
            guarded_streams(),
            json,
        ):
            return _run(words, as_json)
    except KeyboardInterrupt:  # before or after all that could be reported of it
        return exits.INTERRUPTED
    except OSError as error:  # of what --json had still to write
        return exits.report(*_of_the_system(error, words), as_json=False)


def _run(words: Sequence[str], as_json: bool) -> int:
    try:
        _check_text(words)
        named = {name for _, name, *_ in COMMANDS}
        args = build_parser(next((w for w in words if w in named), "-")).parse_args(words)
    except UsageError as error:
        return exits.report(error.kind, error.message, error.remedy, as_json)
    code = _done(args, words, as_json)
    try:
        sys.stdout.flush()
    except UnreadError:
        signalled = exits.nobody_reads()
        return code or signalled
    except OSError as error:
        return code or _failed(error, words, as_json)
    return code


def _done(args: argparse.Namespace, words: Sequence[str], as_json: bool) -> int:
    try:
        code = int(args.handler(args))
        interruption.check_put_off()
    except UnreadError:
        return exits.nobody_reads()
    except BaseException as error:  # some of somebody's library, as its sys.exit()
        return _failed(error, words, as_json)
    return code


def _failed(error: BaseException, words: Sequence[str], as_json: bool) -> int:
    if isinstance(error, KeyboardInterrupt):
        with interruption.sealed():
            return exits.report("interrupted", "interrupted", "", as_json)
    if isinstance(error, GraspError):
        return exits.report(error.kind, error.message, error.remedy, as_json)
    if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):  # a device's pipe
        return exits.report(*_of_the_system(error, words), as_json)
    frames = traceback.extract_tb(error.__traceback__)
    if isinstance(error, Exception) and any(
        Path(frame.filename).parts[-3:] == NUMBA_CACHE for frame in frames
    ):
        return exits.report("config", *BAD_CACHE, as_json)
    if as_json:
        text = in_words(error)
        return exits.report("internal", text, "a bug: run without --json and report it", True)
    traceback.print_exc()
    return exits.INTERNAL


def _check_text(words: Sequence[str]) -> None:
    """Raises UsageError for what no file can be called: a message that names it could not be
    written either."""
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
    """Whether the user named what is wrong, and neither disk nor permissions are."""
    if error.errno in NO_NAMES:  # no name of ours is that long
        return True
    if error.errno not in LEADS_NOWHERE or not isinstance(error.filename, str):
        return False
    path = Path(error.filename)
    given = {Path(part) for word in words for part in (word, word.rpartition("=")[2]) if part}
    return not given.isdisjoint((path, *path.parents))
