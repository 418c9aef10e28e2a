"""Detectors of one's own: a class in a Python file, or one that an installed package offers.

Such a detector is any object with `reset()` and `update(counts)`. It is made anew for each use by
calling what its name stands for, with those of `fingers`, `taxels` and the settings of section
`own` that it has a place for. It may have a `name`, a `threshold` and a `memory`
(``detector.interface.SlipDetector``). Whatever it does wrong becomes one BadFile.
"""

import hashlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import BadFile, in_words, one_line

GROUP = "grasp.detectors"  # of entry points
MARK = ".py:"  # between a file and what it calls its detector
TRIED = 3  # frames at rest, when it is made
THRESHOLD = 0.5
REMEDY = "mend it: docs/extending.md says what a detector is called with and what it gives"
FAILURES = (Exception, SystemExit)  # of somebody's code: sys.exit() in it must not end a run unseen

Scalar = bool | int | float | str


class OwnSettings(msgspec.Struct, frozen=True):
    """What a detector of one's own is made with; ``code`` tells versions of it apart."""

    arguments: tuple[tuple[str, Scalar], ...] = ()
    code: str = ""


class OwnDetector:
    """Guards one: what it is given cannot be written, what it gives is checked and copied."""

    def __init__(self, word: str, inner: Any, fingers: int, taxels: int) -> None:
        self._file = word.rpartition(":")[0] if MARK in word else word
        self._inner = inner
        self._fingers = fingers
        self.name = self._told_of("name", "", one_line) or _called(word)
        self.threshold = self._number("threshold", THRESHOLD, 0.0, 1.0)
        self.memory = int(self._number("memory", 0, 0, 100_000))
        self.reset()
        for _ in range(TRIED):
            self.update(np.zeros((fingers, taxels), np.int16))
        self.reset()

    def _told_of(self, name: str, default: Any, read: Callable[[Any], Any] = lambda v: v) -> Any:
        try:
            return read(getattr(self._inner, name, default))
        except FAILURES as error:
            raise self._bad(*_told(name, error, self._file)) from error

    def _number(self, name: str, default: float, low: float, high: float) -> float:
        value = self._told_of(name, default, _plain)
        if not isinstance(value, float) or not low <= value <= high:
            raise self._bad(f"{name} is {value}, not a number from {low:g} to {high:g}")
        return value

    def reset(self) -> None:
        """Forget all frames; raises BadFile for what goes wrong."""
        try:
            self._inner.reset()
        except FAILURES as error:
            raise self._bad(*_told("reset", error, self._file)) from error

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take counts (fingers, taxels), give (fingers,); raises BadFile for what goes wrong."""
        shown = np.frombuffer(counts.tobytes(), counts.dtype).reshape(counts.shape)
        try:
            given = self._inner.update(shown)
            told = np.array(given)
        except FAILURES as error:
            raise self._bad(*_told("update", error, self._file)) from error
        if isinstance(given, np.ma.MaskedArray):  # what its mask hides would count
            raise self._bad("update gives a masked array, not a number a finger")
        if told.dtype.kind not in "biuf":
            raise self._bad(f"update gives what is not a number a finger: {told.dtype}")
        answer = told.astype(np.float64)
        if answer.shape != (self._fingers,):
            raise self._bad(
                f"update gives shape {answer.shape}, not ({self._fingers},): a number a finger"
            )
        if not ((answer >= 0.0) & (answer <= 1.0)).all():
            raise self._bad(f"update gives {answer.tolist()}, not probabilities from 0 to 1")
        return answer

    def _bad(self, problem: str, line: int | None = None) -> BadFile:
        return BadFile(self._file, problem, REMEDY, line)


def _plain(value: Any) -> float | str:
    """A number of Python's own, which compares and prints as one; else how it is written."""
    return float(value) if isinstance(value, int | float) else one_line(repr(value))


def is_code(word: str) -> bool:
    """Whether it names a file that would be executed."""
    return MARK in word


@cache
def offered() -> dict[str, EntryPoint]:
    """What installed packages offer, by name."""
    return {each.name: each for each in entry_points(group=GROUP)}


def is_own(word: str) -> bool:
    """Whether a detector of that name is somebody's own code."""
    return is_code(word) or word in offered()


def load_own(word: str, settings: OwnSettings, fingers: int, taxels: int) -> OwnDetector:
    """Make it, reset and tried on frames at rest; raises BadFile."""
    made = _made(word, _found(word), settings, fingers, taxels)
    return OwnDetector(word, made, fingers, taxels)


def code_digest(word: str) -> str:
    """SHA-256 of the file that the detector is in; its word where that cannot be read."""
    try:
        if is_code(word):
            origin = word.rpartition(":")[0]
        else:
            spec = importlib.util.find_spec(offered()[word].module)
            origin = (spec.origin if spec is not None else None) or ""
        return hashlib.sha256(Path(origin).read_bytes()).hexdigest()
    except (OSError, ImportError, ValueError):  # told where it is loaded
        return word


def _found(word: str) -> Any:
    """The class, factory or object that it names."""
    if not is_code(word):
        try:
            return offered()[word].load()
        except FAILURES as error:
            raise _broken(word, f"cannot be imported: {in_words(error)}") from error
    file, _, name = word.rpartition(":")
    module = _module(Path(file))
    try:
        found = getattr(module, name, None)
    except FAILURES as error:
        raise _broken(word, f"{name} raised {in_words(error)}") from error
    if found is None:
        raise BadFile(file, f"has no {name!r}", "name a class of it, as FILE.py:NAME")
    return found


def _module(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError as error:
        raise BadFile(path, f"cannot be read: {error.strerror}", "check the path") from None
    name = f"_own_detector_{hashlib.sha256(str(path).encode() + source).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadFile(path, "is no Python file", "name a class of one, as FILE.py:NAME")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look there
    try:
        exec(compile(source, str(path), "exec"), module.__dict__)
    except FAILURES as error:
        del sys.modules[name]
        problem, line = _told("importing it", error, str(path))
        raise BadFile(path, problem, "mend the file", line) from error
    return module


def _made(word: str, found: Any, settings: OwnSettings, fingers: int, taxels: int) -> Any:
    """What it is called with: those of its parameters that there is something for."""
    given = dict(settings.arguments)
    if not callable(found):
        if given:
            raise _broken(word, f"is an object: it takes no setting own.{next(iter(given))}")
        try:
            made = deepcopy(found)
        except FAILURES as error:
            raise _broken(word, f"cannot be copied: {in_words(error)}") from error
    else:
        known = _parameters(found)
        unknown = [key for key in given if known is not None and key not in known]
        if unknown:
            raise _broken(word, f"takes no setting own.{unknown[0]}")
        shape = {"fingers": fingers, "taxels": taxels}
        offers = {key: n for key, n in shape.items() if known is None or key in known}
        try:
            made = found(**{**offers, **given})
        except FAILURES as error:
            file = word.rpartition(":")[0] if is_code(word) else word
            problem, line = _told("making it", error, file)
            raise BadFile(file, problem, REMEDY, line) from error
    for verb in ("reset", "update"):
        try:
            there = callable(getattr(made, verb, None))
        except FAILURES as error:
            raise _broken(word, f"{verb} raised {in_words(error)}") from error
        if not there:
            raise _broken(word, f"has no {verb}()")
    return made


def _parameters(found: Callable[..., Any]) -> set[str] | None:
    """Names that it can be called with; None: any."""
    try:
        known = inspect.signature(found).parameters.values()
    except (TypeError, ValueError):  # made in C
        return set()
    return None if any(p.kind is p.VAR_KEYWORD for p in known) else {p.name for p in known}


def _broken(word: str, problem: str) -> BadFile:
    return BadFile(word, problem, REMEDY)


def _told(verb: str, error: BaseException, file: str) -> tuple[str, int | None]:
    """What it raised, and in which line of its file."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    if isinstance(error, SyntaxError):
        lines = [error.lineno]
    return f"{verb} raised {in_words(error)}", lines[-1] if lines else None


def _called(word: str) -> str:
    return word.rpartition(":")[2]
