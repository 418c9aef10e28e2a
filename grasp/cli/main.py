"""The `grasp` command. Heavy imports are inside the commands, so that `--help` is fast."""

import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import nullcontext
from importlib import import_module
from types import ModuleType

from drivers.errors import GraspError, OutputClosedError, UsageError, describe_exception, one_line
from grasp.cli import exits
from grasp.cli.commands import build_parser
from grasp.cli.output import checked_streams, only_json, open_standard_streams
from grasp.cli.parser import COMPLETING, complete
from grasp.files import PATH_ERRORS, use_writable_cache
from grasp.run import signals

MODULES = {
    **dict.fromkeys(("replay", "runs", "report", "export"), "recordings"),
    **dict.fromkeys(("status", "gripper", "arm", "release"), "devices"),
    "dataset": "training", "detector train": "training", "tactile": "calibrate",
}  # fmt: skip


def module_of(command: str) -> ModuleType:
    """Import and return the module that implements a command."""
    group = command.partition(" ")[0]
    return import_module(f"grasp.cli.{MODULES.get(command) or MODULES.get(group, group)}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Expected errors are printed as one line."""
    if COMPLETING in os.environ:
        complete(build_parser())
    open_standard_streams()
    words = sys.argv[1:] if argv is None else argv
    if words[:1] == ["--version"]:
        from importlib.metadata import version

        print(f"grasp {version('grasp-controller')}")
        return exits.SUCCESS
    use_writable_cache()
    as_json = "--json" in words
    json = only_json() if as_json and not {"-h", "--help"} & set(words) else nullcontext()
    try:
        with (
            signals.taken(),
            checked_streams(),
            json,
        ):
            return _run(words, as_json)
    except KeyboardInterrupt:  # outside of the code that reports it
        return exits.INTERRUPTED
    except OSError as error:  # while --json flushes its output
        return exits.report(*_system_error(error), as_json=False)


def _run(words: Sequence[str], as_json: bool) -> int:
    try:
        parsed = build_parser().parse_args([_checked(word) for word in words])
        options = parsed.options.of(parsed)
    except UsageError as error:
        return exits.report(error.kind, error.message, error.remedy, as_json)
    code = exits.SUCCESS
    try:
        run = getattr(module_of(parsed.command), parsed.command.replace(" ", "_"))
        code = int(run(options))
        sys.stdout.flush()
    except OutputClosedError:
        signalled = exits.close_output()
        return code or signalled
    except OSError as error:
        code = code or _failed(error, as_json)
        try:
            sys.stdout.flush()
        except OSError:  # a full disk: at its end the interpreter would try and complain again
            exits.close_output()
        return code
    except BaseException as error:  # also of libraries, for example sys.exit()
        return _failed(error, as_json)
    return code


def _failed(error: BaseException, as_json: bool) -> int:
    if isinstance(error, KeyboardInterrupt):
        with signals.deferred(ignore_checks=True):
            return exits.report("interrupted", "interrupted", "", as_json)
    if isinstance(error, GraspError):
        return exits.report(error.kind, error.message, error.remedy, as_json)
    if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):  # a device's pipe
        return exits.report(*_system_error(error), as_json)
    if as_json:
        text = describe_exception(error)
        return exits.report("internal", text, "a bug: run without --json and report it", True)
    traceback.print_exc()
    return exits.INTERNAL


def _checked(word: str) -> str:
    """The word, with the home folder for `~` and `~user`, which no shell replaces in
    `--runs=~/runs`. Raises UsageError for text that is not valid in file names or messages."""
    if "\0" in word or word.encode(errors="replace").decode() != word:
        raise UsageError(f"{word}: not UTF-8 text without NUL", "use other characters")
    option, equals, value = word.rpartition("=")
    user, slash, _ = value.partition("/")
    path = os.path.expanduser(value)
    if path == value and (user == "~" or (user.startswith("~") and slash)):
        raise UsageError(f"{word}: the home folder is not known", "set HOME, or omit `~`")
    return f"{option}{equals}{path}"


def _system_error(error: OSError) -> tuple[str, str, str]:
    """Kind, message and remedy."""
    where = f"{one_line(error.filename)}: " if error.filename else ""
    text = f"{where}{error.strerror or error}"
    if error.errno in PATH_ERRORS:
        return "usage", text, "give a valid path of a file or a folder"
    return "could_not_record", text, "check the path, its permissions and the free disk space"
