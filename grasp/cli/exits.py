"""Exit codes, and the printing of an error as one line or one JSON object."""

import contextlib
import os
import sys
from typing import TYPE_CHECKING

from drivers.errors import one_line
from grasp.cli.output import print_json, standard_output
from grasp.run import signals

if TYPE_CHECKING:
    from scenarios.trial.final_state import FinalState
    from scenarios.trial.result import Failure

SUCCESS = 0
TRIAL_FAILED = 1
USAGE = 2
DEVICE = 3
SAFETY_STOP = 4
INTERNAL = 5
INTERRUPTED = 130  # by Ctrl-C; other signals by their own number
SIGNALLED = 128

MAX_CHARACTERS = 1_800  # of a message, and of its remedy, on a terminal

_CODE_OF_KIND = {
    **dict.fromkeys(("usage", "config", "bad_file"), USAGE),
    **dict.fromkeys(("link_lost", "device_fault"), DEVICE),
    **dict.fromkeys(("refused", "stale", "implausible", "safety_stop"), SAFETY_STOP),
    "interrupted": INTERRUPTED,
}


def code_of(kind: str) -> int:
    """Exit code of an error kind; an unknown kind is an internal error."""
    return _CODE_OF_KIND.get(kind, INTERNAL)


def report_failure(failure: "Failure", as_json: bool, **extra: object) -> int:
    """Report the failure of a started run: the error, the state of arm and hand, and the remedy,
    one line each; returns the exit code."""
    end = failure.end
    if end is None:
        return report(failure.kind, failure.message, failure.remedy, as_json, **extra)
    if as_json:
        return report(failure.kind, failure.message, failure.remedy, True, end=end, **extra)
    code = report(failure.kind, failure.message, "", False)
    print_end(end, failure.remedy)
    return code


def print_end(end: "FinalState", remedy: str = "") -> None:
    """Print the final state of arm and hand, the remedy, and how to continue, one line each."""
    where = f"{end.where}: " if end.where else ""
    missed = f"; not confirmed: {', '.join(end.unconfirmed)}"
    state = f"{where}{end.arm}; {end.hand}{missed if end.unconfirmed else ''}"
    for line in (state, remedy, end.advice):
        print_detail(line)


def report_line(line: str, begins: str = "grasp: ") -> None:
    """Print a line on standard error that does not change the exit code."""
    with contextlib.suppress(OSError):
        print(f"{begins}{one_line(line, MAX_CHARACTERS)}", file=sys.stderr)


def print_detail(line: str) -> None:
    """Print a further line of an error, unless it is empty."""
    if line:
        report_line(line, 7 * " ")


def report(kind: str, message: str, remedy: str, as_json: bool, **extra: object) -> int:
    """Print an error and its remedy, without control characters; returns the exit code."""
    code = code_of(kind)
    if code == INTERRUPTED:
        code = SIGNALLED + signals.number()
    with contextlib.suppress(OSError):  # the terminal was closed
        if as_json:
            error = {"kind": kind, "message": message, "remedy": remedy}
            print_json({"error": error, "exit_code": code, **extra})
        else:
            text, how = one_line(message, MAX_CHARACTERS), one_line(remedy, MAX_CHARACTERS)
            print(f"grasp: {text}" + (f" ({how})" if how else ""), file=sys.stderr)
    return code


def close_output() -> int:
    """Discard further output, because standard output has no reader; returns 0, or the code of the
    signal that ended the run."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), standard_output().fileno())
    return SIGNALLED + signals.number() if signals.received() else SUCCESS
