"""The `grasp` command. Heavy imports are inside the commands, so that `--help` answers at once."""

import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import nullcontext
from importlib import import_module
from types import ModuleType

from drivers.errors import GraspError, OutputClosedError, UsageError, describe_exception, one_line
from grasp import signals
from grasp.cli import exits
from grasp.cli.commands import build_parser
from grasp.cli.output import guarded_streams, only_json, open_standard_streams
from grasp.cli.parser import COMPLETING, complete
from grasp.files import LEADS_NOWHERE

MODULES = {
    **dict.fromkeys(("replay", "runs", "report", "export"), "recordings"),
    **dict.fromkeys(("status", "gripper", "arm", "release"), "devices"),
    "dataset": "training", "detector train": "training", "tactile": "calibrate",
}  # fmt: skip


def module_of(command: str) -> ModuleType:
    """The module with what a command does, imported when it runs."""
    group = command.partition(" ")[0]
    return import_module(f"grasp.cli.{MODULES.get(command) or MODULES.get(group, group)}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Expected errors become one line, no traceback."""
    if COMPLETING in os.environ:
        complete(build_parser())
    open_standard_streams()
    words = sys.argv[1:] if argv is None else argv
    if words[:1] == ["--version"]:
        from importlib.metadata import version

        print(f"grasp {version('grasp-controller')}")
        return exits.SUCCESS
    as_json = "--json" in words
    json = only_json() if as_json and not {"-h", "--help"} & set(words) else nullcontext()
    try:
        with (
            signals.taken(),
            guarded_streams(),
            json,
        ):
            return _run(words, as_json)
    except KeyboardInterrupt:  # before or after all that could be reported of it
        return exits.INTERRUPTED
    except OSError as error:  # of what --json had still to write
        return exits.report(*_of_the_system(error), as_json=False)


def _run(words: Sequence[str], as_json: bool) -> int:
    try:
        _check_text(words)
        args = build_parser().parse_args(words)
    except UsageError as error:
        return exits.report(error.kind, error.message, error.remedy, as_json)
    code = exits.SUCCESS
    try:
        run = getattr(module_of(args.command), args.command.replace(" ", "_"))
        code = int(run(args))
        sys.stdout.flush()
    except OutputClosedError:
        signalled = exits.nobody_reads()
        return code or signalled
    except OSError as error:
        return code or _failed(error, as_json)
    except BaseException as error:  # some of somebody's library, as its sys.exit()
        return _failed(error, as_json)
    return code


def _failed(error: BaseException, as_json: bool) -> int:
    if isinstance(error, KeyboardInterrupt):
        with signals.deferred(sealed=True):
            return exits.report("interrupted", "interrupted", "", as_json)
    if isinstance(error, GraspError):
        return exits.report(error.kind, error.message, error.remedy, as_json)
    if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):  # a device's pipe
        return exits.report(*_of_the_system(error), as_json)
    if as_json:
        text = describe_exception(error)
        return exits.report("internal", text, "a bug: run without --json and report it", True)
    traceback.print_exc()
    return exits.INTERNAL


def _check_text(words: Sequence[str]) -> None:
    """Raises UsageError for text that no file name or message can hold."""
    for word in words:
        if "\0" in word or word.encode(errors="replace").decode() != word:
            raise UsageError(f"{word}: no text in UTF-8 without NUL", "name it otherwise")


def _of_the_system(error: OSError) -> tuple[str, str, str]:
    where = f"{one_line(error.filename)}: " if error.filename else ""
    text = f"{where}{error.strerror or error}"
    if error.errno in LEADS_NOWHERE:
        return "usage", text, "name a file or a folder that can be there"
    return "could_not_record", text, "free the path or the disk"
