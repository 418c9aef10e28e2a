"""Detectors of other people: a class in a Python file, or one that an installed package offers.

It is made for each use by calling what its name stands for, with those of `fingers`, `taxels` and
the settings of section `own` that it has parameters for. It needs `reset()` and `update(counts)`;
`name`, `threshold` and `memory` are optional (``detector.interface.SlipDetector``). Whatever it
does wrong becomes one BadFile.
"""

import hashlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import BadFile, describe_exception, one_line

GROUP = "grasp.detectors"  # of entry points
MARK = ".py:"  # between a file and what it calls its detector
TRIED = 3  # frames at rest, when it is made
THRESHOLD = 0.5
REMEDY = "correct it: docs/extending.md says how a detector is called and what it returns"
FAILURES = (Exception, SystemExit)  # a plugin's sys.exit() must not end a run unseen

Scalar = bool | int | float | str


class OwnSettings(msgspec.Struct, frozen=True):
    """What such a detector is made with; ``code`` tells versions of it apart."""

    arguments: tuple[tuple[str, Scalar], ...] = ()
    code: str = ""


class PluginDetector:
    """Wraps one: what it is given cannot be written, what it returns is checked and copied."""

    def __init__(self, word: str, inner: Any, fingers: int, taxels: int) -> None:
        self._file, self._inner, self._fingers = _file(word), inner, fingers
        with _blamed(self._file, "name"):
            self.name = one_line(getattr(inner, "name", "")) or word.rpartition(":")[2]
        self.threshold = self._number("threshold", THRESHOLD, 1.0)
        self.memory = int(self._number("memory", 0, 100_000))
        self.reset()
        for _ in range(TRIED):
            self.update(np.zeros((fingers, taxels), np.int16))
        self.reset()

    def _number(self, name: str, default: float, most: float) -> float:
        with _blamed(self._file, name):
            value = getattr(self._inner, name, default)
            value = float(value) if isinstance(value, int | float) else one_line(repr(value))
        if not isinstance(value, float) or not 0.0 <= value <= most:
            raise _bad(self._file, f"{name} is {value}, not a number from 0 to {most:g}")
        return value

    def reset(self) -> None:
        """Forget all frames; raises BadFile for what goes wrong."""
        with _blamed(self._file, "reset"):
            self._inner.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take counts (fingers, taxels), give (fingers,); raises BadFile for what goes wrong."""
        shown = np.frombuffer(counts.tobytes(), counts.dtype).reshape(counts.shape)
        with _blamed(self._file, "update"):
            p = np.array(self._inner.update(shown))
        if p.dtype.kind not in "biuf":
            raise _bad(self._file, f"update gives {p.dtype}, not a number a finger")
        if p.shape != (self._fingers,):
            wanted = f"({self._fingers},): a number a finger"
            raise _bad(self._file, f"update gives shape {p.shape}, not {wanted}")
        if not ((p >= 0.0) & (p <= 1.0)).all():
            raise _bad(self._file, f"update gives {p.tolist()}, not probabilities from 0 to 1")
        return p.astype(np.float64)


def is_code(word: str) -> bool:
    """Whether it names a file that would be executed."""
    return MARK in word


@cache
def offered() -> dict[str, EntryPoint]:
    """What installed packages offer, by name."""
    return {each.name: each for each in entry_points(group=GROUP)}


def is_own(word: str) -> bool:
    """Whether a detector of that name is a plugin's code."""
    return is_code(word) or word in offered()


def load_plugin(word: str, settings: OwnSettings, fingers: int, taxels: int) -> PluginDetector:
    """Make it, reset and tried on frames at rest; raises BadFile."""
    file, found, given = _file(word), _found(word), dict(settings.arguments)
    with _blamed(file, "making it"):
        known = _parameters(found)
        unknown = [key for key in given if known is not None and key not in known]
        if unknown:
            raise _bad(file, f"takes no setting own.{unknown[0]}")
        shape = {"fingers": fingers, "taxels": taxels}
        made = found(**{k: n for k, n in shape.items() if known is None or k in known} | given)
    for verb in ("reset", "update"):
        with _blamed(file, verb):
            if not callable(getattr(made, verb, None)):
                raise _bad(file, f"has no {verb}()")
    return PluginDetector(word, made, fingers, taxels)


def code_digest(word: str) -> str:
    """SHA-256 of the file that the detector is in; its word where that cannot be read."""
    try:
        origin = _file(word)
        if not is_code(word):
            spec = importlib.util.find_spec(offered()[word].module)
            origin = (spec.origin if spec is not None else None) or ""
        return hashlib.sha256(Path(origin).read_bytes()).hexdigest()
    except (OSError, ImportError, ValueError):  # reported where it is loaded
        return word


def _file(word: str) -> str:
    return word.rpartition(":")[0] if is_code(word) else word


def _found(word: str) -> Any:
    """The class or function that it names."""
    if not is_code(word):
        try:
            return offered()[word].load()
        except FAILURES as error:
            raise _bad(word, f"cannot be imported: {describe_exception(error)}") from error
    file, _, name = word.rpartition(":")
    module = _module(Path(file))
    with _blamed(file, name):
        found = getattr(module, name, None)
    if not callable(found):
        raise BadFile(file, f"has no class or function {name!r}", "name one, as FILE.py:NAME")
    return found


def _module(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError as error:
        raise BadFile(path, f"cannot be read: {error.strerror}", "check the path") from None
    name = f"_plugin_{hashlib.sha256(str(path).encode() + source).hexdigest()[:16]}"
    if name not in sys.modules:
        module = ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module  # dataclasses and pickle look there
        try:
            with _blamed(str(path), "importing it"):
                exec(compile(source, str(path), "exec"), module.__dict__)
        except BadFile:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _parameters(found: Any) -> set[str] | None:
    """Names that it can be called with; None: any."""
    try:
        known = inspect.signature(found).parameters.values()
    except (TypeError, ValueError):  # made in C
        return set()
    return None if any(p.kind is p.VAR_KEYWORD for p in known) else {p.name for p in known}


def _bad(file: str, problem: str, line: int | None = None) -> BadFile:
    return BadFile(file, problem, REMEDY, line)


@contextmanager
def _blamed(file: str, verb: str) -> Iterator[None]:
    """What a plugin raises in here becomes a BadFile with the line of its file."""
    try:
        yield
    except BadFile:
        raise
    except FAILURES as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
        if isinstance(error, SyntaxError):
            lines = [error.lineno]
        line = lines[-1] if lines else None
        raise _bad(file, f"{verb} raised {describe_exception(error)}", line) from error
