"""Exit codes, and how an error becomes one line (or one JSON object) and a code."""

import contextlib
import os
import sys
from typing import Any

from drivers.errors import one_line
from grasp import signals
from grasp.cli.output import print_json, standard_output

SUCCESS = 0
TRIAL_FAILED = 1
USAGE = 2
DEVICE = 3
SAFETY_STOP = 4
INTERNAL = 5
INTERRUPTED = 130  # by Ctrl-C; other signals by their own number
SIGNALLED = 128

MOST_SAID = 1_800  # characters of a message, and of its remedy, on a terminal

_CODE_OF_KIND = {
    **dict.fromkeys(("usage", "config", "bad_file"), USAGE),
    **dict.fromkeys(("link_lost", "device_fault"), DEVICE),
    **dict.fromkeys(("refused", "stale", "implausible", "safety_stop"), SAFETY_STOP),
    "interrupted": INTERRUPTED,
}


def code_of(kind: str) -> int:
    """Exit code of an error kind; an unknown kind is an internal error."""
    return _CODE_OF_KIND.get(kind, INTERNAL)


def report_failure(failure: Any, as_json: bool, **extra: Any) -> int:
    """As ``report`` for a run that had begun: what happened, how arm and hand were left, and then
    what to do; a line each."""
    end = failure.end
    if end is None:
        return report(failure.kind, failure.message, failure.remedy, as_json, **extra)
    if as_json:
        return report(failure.kind, failure.message, failure.remedy, True, end=end, **extra)
    code = report(failure.kind, failure.message, "", False)
    say_end(end, failure.remedy)
    return code


def say_end(end: Any, remedy: str = "") -> None:
    """Where arm and hand were left, and how; what to do, and how to go on: a line each."""
    where = f"{end.where}: " if end.where else ""
    missed = f"; not confirmed: {', '.join(end.unconfirmed)}"
    state = f"{where}{end.arm}; {end.hand}{missed if end.unconfirmed else ''}"
    for line in (state, remedy, end.advice):
        say(line)


def report_line(line: str, begins: str = "grasp: ") -> None:
    """Print a line on standard error, of what does not change the exit code."""
    with contextlib.suppress(OSError):
        print(f"{begins}{one_line(line, MOST_SAID)}", file=sys.stderr)


def say(line: str) -> None:
    """A further line of an error; an empty one is none."""
    if line:
        report_line(line, 7 * " ")


def report(kind: str, message: str, remedy: str, as_json: bool, **extra: Any) -> int:
    """Print what went wrong and what to do, without control characters; returns the exit code."""
    code = code_of(kind)
    if code == INTERRUPTED:
        code = SIGNALLED + signals.number()
    with contextlib.suppress(OSError):  # a terminal that was closed: nobody reads it
        if as_json:
            error = {"kind": kind, "message": message, "remedy": remedy}
            print_json({"error": error, "exit_code": code, **extra})
        else:
            said, how = one_line(message, MOST_SAID), one_line(remedy, MOST_SAID)
            print(f"grasp: {said}" + (f" ({how})" if how else ""), file=sys.stderr)
    return code


def nobody_reads() -> int:
    """Standard output is gone: say no more there; 0, or the code of the signal that ended the
    run."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), standard_output().fileno())
    return SIGNALLED + signals.number() if signals.asked() else SUCCESS
