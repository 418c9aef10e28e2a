"""Detector plugins: a class in a Python file, or an entry point of an installed package.

The class (or function) is called with the settings of section `plugin`, and with `fingers` and
`taxels` if it has these parameters. The object needs `reset()` and `update(counts)`; `name`,
`threshold` and `memory` are optional (``detector.interface.SlipDetector``). Every error of a plugin
becomes a BadFile.
"""

import hashlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import BadFile, describe_exception, one_line

if TYPE_CHECKING:  # slow to import, and rarely needed
    from importlib.metadata import EntryPoint

GROUP = "grasp.detectors"  # of entry points
FILE_SEPARATOR = ".py:"  # between the file and the name of the class in it
TEST_FRAMES = 3  # frames at rest that a new plugin has to process
THRESHOLD = 0.5
REMEDY = "correct it: docs/extending.md describes how a detector is called and what it returns"
FAILURES = (Exception, SystemExit)  # a plugin's sys.exit() must not end a run unnoticed

Scalar = bool | int | float | str


class PluginSettings(msgspec.Struct, frozen=True):
    """Arguments of a plugin, and the digest of its code."""

    arguments: tuple[tuple[str, Scalar], ...] = ()
    code: str = ""


class PluginDetector:
    """Wrapper of a plugin: its inputs are read-only, its outputs are checked and copied."""

    def __init__(self, word: str, inner: Any, fingers: int, taxels: int) -> None:
        self._file, self._inner, self._fingers = _file(word), inner, fingers
        with _as_bad_file(self._file, "name"):
            self.name = one_line(getattr(inner, "name", "")) or word.rpartition(":")[2]
        self.threshold = self._number("threshold", THRESHOLD, 1.0)
        self.memory = int(self._number("memory", 0, 100_000))
        self.reset()
        for _ in range(TEST_FRAMES):
            self.update(np.zeros((fingers, taxels), np.int16))
        self.reset()

    def _number(self, name: str, default: float, maximum: float) -> float:
        with _as_bad_file(self._file, name):
            value = getattr(self._inner, name, default)
            value = float(value) if isinstance(value, int | float) else one_line(repr(value))
        if not isinstance(value, float) or not 0.0 <= value <= maximum:
            raise _bad(self._file, f"{name} is {value}, not a number from 0 to {maximum:g}")
        return value

    def reset(self) -> None:
        """Clear all state. Raises BadFile for any error of the plugin."""
        with _as_bad_file(self._file, "reset"):
            self._inner.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take counts (fingers, taxels); return (fingers,). Raises BadFile for any error."""
        read_only = np.frombuffer(counts.tobytes(), counts.dtype).reshape(counts.shape)
        with _as_bad_file(self._file, "update"):
            p = np.array(self._inner.update(read_only))
        if p.dtype.kind not in "biuf":
            raise _bad(self._file, f"update returns {p.dtype}, not a number per finger")
        if p.shape != (self._fingers,):
            expected = f"({self._fingers},): a number per finger"
            raise _bad(self._file, f"update returns shape {p.shape}, not {expected}")
        if not ((p >= 0.0) & (p <= 1.0)).all():
            raise _bad(self._file, f"update returns {p.tolist()}, not probabilities from 0 to 1")
        return p.astype(np.float64)


def is_plugin_file(word: str) -> bool:
    """Whether the name is that of a Python file, which loading executes."""
    return FILE_SEPARATOR in word


@cache
def installed_plugins() -> dict[str, "EntryPoint"]:
    """Entry points of installed packages, by name."""
    from importlib.metadata import entry_points

    return {each.name: each for each in entry_points(group=GROUP)}


def is_plugin(word: str) -> bool:
    """Whether the name is that of a plugin."""
    return is_plugin_file(word) or word in installed_plugins()


def load_plugin(word: str, settings: PluginSettings, fingers: int, taxels: int) -> PluginDetector:
    """Create the plugin's detector, reset, after a test on frames at rest. Raises BadFile."""
    file, factory, arguments = _file(word), _factory(word), dict(settings.arguments)
    with _as_bad_file(file, "creating it"):
        known = _parameters(factory)
        unknown = [key for key in arguments if known is not None and key not in known]
        if unknown:
            raise _bad(file, f"has no setting plugin.{unknown[0]}")
        shape = {"fingers": fingers, "taxels": taxels}
        accepted = {k: n for k, n in shape.items() if known is None or k in known}
        inner = factory(**accepted | arguments)
    for verb in ("reset", "update"):
        with _as_bad_file(file, verb):
            if not callable(getattr(inner, verb, None)):
                raise _bad(file, f"has no {verb}()")
    return PluginDetector(word, inner, fingers, taxels)


def code_digest(word: str) -> str:
    """SHA-256 of the plugin's file; its name if the file cannot be read."""
    try:
        origin = _file(word)
        if not is_plugin_file(word):
            spec = importlib.util.find_spec(installed_plugins()[word].module)
            origin = (spec.origin if spec is not None else None) or ""
        return hashlib.sha256(Path(origin).read_bytes()).hexdigest()
    except (OSError, ImportError, ValueError):  # loading it reports the error
        return word


def _file(word: str) -> str:
    return word.rpartition(":")[0] if is_plugin_file(word) else word


def _factory(word: str) -> Any:
    """The class or function of that name."""
    if not is_plugin_file(word):
        try:
            return installed_plugins()[word].load()
        except FAILURES as error:
            raise _bad(word, f"cannot be imported: {describe_exception(error)}") from error
    file, _, name = word.rpartition(":")
    module = _module(Path(file))
    with _as_bad_file(file, name):
        factory = getattr(module, name, None)
    if not callable(factory):
        raise BadFile(file, f"has no class or function {name!r}", "name one, as FILE.py:NAME")
    return factory


def _module(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError as error:
        raise BadFile(path, f"cannot be read: {error.strerror}", "check the path") from None
    name = f"_plugin_{hashlib.sha256(str(path).encode() + source).hexdigest()[:16]}"
    if name not in sys.modules:
        module = ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module  # dataclasses and pickle look it up there
        try:
            with _as_bad_file(str(path), "importing it"):
                exec(compile(source, str(path), "exec"), module.__dict__)
        except BadFile:
            del sys.modules[name]
            raise
    return sys.modules[name]


def _parameters(factory: Any) -> set[str] | None:
    """Names of its parameters; None: any."""
    try:
        known = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):  # written in C
        return set()
    return None if any(p.kind is p.VAR_KEYWORD for p in known) else {p.name for p in known}


def _bad(file: str, problem: str, line: int | None = None) -> BadFile:
    return BadFile(file, problem, REMEDY, line)


@contextmanager
def _as_bad_file(file: str, verb: str) -> Iterator[None]:
    """Convert exceptions of a plugin to a BadFile with the line of its file."""
    try:
        yield
    except BadFile:
        raise
    except FAILURES as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f.lineno for f in frames if f.filename == file]
        if isinstance(error, SyntaxError):
            lines = [error.lineno]
        line = lines[-1] if lines else None
        at = "" if line else f" ({frames[-1].filename}, line {frames[-1].lineno})"
        raise _bad(file, f"{verb} raised {describe_exception(error)}{at}", line) from error
