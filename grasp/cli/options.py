"""Options that several commands share, and parsers of option values."""

import argparse
import math
import os
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from drivers.errors import UsageError, one_line
from grasp.cli.parser import How, Options
from grasp.files import is_stream, nearest_folder, why_not_writable, write_error

if TYPE_CHECKING:
    from scenarios.rigs.workers import Workers

MOST_JOBS = 256
MOST_DIGITS = 100  # of a whole number: Python converts no more than 4,300
PICTURES = (".svg", ".png", ".pdf")
BUDGET = "false alarms per minute and hand"
OBJECT_HELP = "an object of config/objects (also the held-out ones), or your .toml file"


def whole(least: int, most: int) -> Callable[[str], int]:
    def number(text: str) -> int:
        if not (text.isascii() and text.removeprefix("-").isdecimal()):
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a whole number, allowed: {least} to {most}"
            )
        if len(text) > MOST_DIGITS or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{one_line(text)} is out of range: {least} to {most}")
        return int(text)

    return number


def decimal(least: float, most: float, unit: str = "") -> Callable[[str], float]:
    within = f"{least:g} to {most:g} {unit}".rstrip()

    def number(text: str) -> float:
        try:
            value = float(text) if text.isascii() and "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if math.isnan(value):
            point = ", write a decimal point" if "," in text else ""
            problem = f"{one_line(repr(text))} is not a number{point}, allowed: {within}"
            raise argparse.ArgumentTypeError(problem)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{one_line(text)} is out of range: {within}")
        return value

    return number


def file_to_write(text: str) -> Path:
    """Parse the name of a file in an existing, writable folder."""
    return _checked(text, _problem(Path(text), Path(text).parent))


def file_with_folders(text: str) -> Path:
    """Parse the name of a file to write; missing folders will be made."""
    return _checked(text, _problem(Path(text), nearest_folder(Path(text).parent)))


def folder_to_fill(text: str) -> Path:
    """Parse the name of a folder that exists or can be made."""
    return _checked(text, why_not_writable(nearest_folder(Path(text))))


def _checked(text: str, problem: str) -> Path:
    if problem:
        raise argparse.ArgumentTypeError(f"{text!r}: {problem}")
    return Path(text)


def _problem(path: Path, folder: Path) -> str:
    """Why a file cannot be written in a folder; empty if it can."""
    try:
        if path.is_dir():
            return "is a folder"
        if is_stream(path):
            return ""
    except OSError as error:
        return write_error(error, folder)
    return why_not_writable(folder)


def check_writable(path: Path, begins: str = "") -> None:
    """Raise UsageError if the file cannot be written, or exists and does not begin with
    ``begins``."""
    problem = _problem(path, path.parent)
    begun = begins and path.is_file() and not is_stream(path)
    if begun and not path.read_bytes().startswith(begins.encode()):
        problem = "exists already"
    if problem:
        raise UsageError(f"{path}: {problem}", "name another file")


def check_new(path: Path | None) -> None:
    """Raise UsageError if the path exists, before a person does the work."""
    if path is not None and path.exists():
        raise UsageError(f"{path} exists already", "name another file: none is overwritten")


def need(extra: str, *packages: str) -> None:
    """Raise UsageError, with the remedy, if packages of an extra are not installed."""
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        remedy = f"make install-{extra}, or pip install 'grasp-controller[{extra}]'"
        raise UsageError(f"not installed: {' and '.join(missing)}", remedy)


# Options with the same meaning in all commands
Detector = Annotated[str | None, "NAME", "one of config/detectors or of an installed package, "
    "FILE.py:NAME or FILE.onnx (default: the profile's)"]  # fmt: skip
Object = Annotated[str, "NAME", OBJECT_HELP]
Profile = Annotated[str, "NAME", "one of config/profiles"]
Rig = Annotated[str, "NAME", "emulated (real protocols, emulated devices), simulated (virtual "
    "time), hardware, or a .toml file"]  # fmt: skip
Runs = Annotated[Path, "DIR", "folder of recordings"]
Seed = Annotated[int, "N", "random seed", whole(0, 2**63 - 1)]


class Json(Options):
    """For commands with results."""

    json: Annotated[bool, "one JSON object on standard output, nothing else"] = False


class Settings(Options):
    """For commands that read settings."""

    config: Annotated[Sequence[Path] | None, "FILE", "settings file; overrides packaged ones "
        "(default: $GRASP_CONFIG)", How(repeated=True)] = None  # fmt: skip
    set: Annotated[Sequence[str], "SECTION.KEY=VALUE",
        "change one setting; `grasp config` lists them", How(repeated=True)] = ()  # fmt: skip


class SettingsJson(Settings, Json):
    """Settings and results."""


class Pool(Options):
    """For commands with worker processes: see ``scenarios.rigs.workers.Workers``."""

    jobs: Annotated[int, "N", "worker processes (default: one per core)",
        whole(1, MOST_JOBS)] = len(os.sched_getaffinity(0))  # fmt: skip
    cluster: Annotated[str | None, "ADDRESS",
        "Dask scheduler to use instead (extra `cluster`)"] = None  # fmt: skip


class Confirm(Options):
    """For commands that may move real devices."""

    confirm_motion: Annotated[bool, "confirm that the cell is clear and supervised; required for "
        "motion on the hardware rig"] = False  # fmt: skip


class Motion(Confirm):
    """For commands that may move real devices, or only say what they would move."""

    dry_run: Annotated[bool, "on real devices: check them and print the motion, move nothing"] = (
        False
    )


def workers(options: Pool) -> "Workers":
    from scenarios.rigs.workers import Workers

    return Workers(options.jobs, options.cluster)
