"""Runs chosen tests against mutants: the fewest that can see each, the likeliest first.

Tests are collected once. For each mutant of what a function does the process forks, and the child
puts the changed code into the functions as they are and runs the tests that call them. What runs on
import, and what none of these kills, is written to a copy of the checkout, and the other tests run
there in a process of their own, the nearest first: emulators and commands run in others that tests
start. A test may fail by itself, for the clock's sake or the copy's: what kills must do so once
more with the mutant alone, and not without it. A test that waits for ever is told from one that
waits for the processor, of which a busy machine gives it little.
"""

import ast
import atexit
import gc
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import accumulate, islice
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import IO, Any

import msgspec
import pytest

from scripts.mutation import HOME, Mutant, Place, mutants, mutated

LEAST_CPU_S = 4.0  # of processor time: a mutant with which a test takes longer than this and five
TIMES = 5.0  # times what it takes is killed by its time-out
IDLE_S = 20.0  # in which nothing of a test runs or would: it waits for ever
LOOK_S = 1.0  # how often that is looked at: it takes 10 ms itself
BEGIN_CPU_S = 10.0  # of a process of its own, until its tests begin
TIME_OUT = "time-out"
PATIENT = ("-o", "timeout=0")  # a busy machine fails no test: the limits above are a mutant's
SILENT = ("-o", "console_output_style=classic")  # no share of tests that are done
COPIED = ("grasp", "drivers", "detector", "scenarios", "scripts", "tests", "config", "docs")
ENVIRONMENT = {"CI": "1", "PYTHONHASHSEED": "0", "OMP_NUM_THREADS": "1"}


class Fate(msgspec.Struct, frozen=True):
    """What became of a mutant: the test that killed it, "time-out", or empty: it survived."""

    mutant: Mutant
    killer: str
    tests: int  # that can see it
    shown: str = ""  # digest of the tests as they were then
    commit: str = ""  # of the checkout then


class Test(msgspec.Struct):
    """What a test called of the modules, and the processor time of it and what it started, s."""

    name: str
    seconds: float
    called: list[tuple[str, str]]  # paths and qualified names
    fails: bool = False


Swap = Sequence[tuple[FunctionType, CodeType]]  # functions, and the code they are to have
Told = Callable[[Fate], None]


class Fell(msgspec.Struct, frozen=True):
    """The first of tests that did not pass: itself, where it is known, and what was seen."""

    test: str
    how: str = ""  # empty: it failed; else "time-out", or "broken"

    @property
    def killer(self) -> str:
        return self.how or self.test


Attempt = Callable[[Sequence[str], bool], Fell | None]  # of tests, with a mutant or without


class Unfit(Exception):
    """The tests cannot be run, or not in time, without a mutant either."""


def run(tests: Sequence[str], chosen: Sequence[Mutant], most_s: float, tell: Told) -> int:
    """Fates of the chosen mutants by these tests, of which each is shown so much processor time;
    exit code of pytest. Raises KeyboardInterrupt, which pytest would keep to itself."""
    os.environ.update(ENVIRONMENT)
    plugin = Attack(chosen, most_s, tell)
    known = "ignore::pytest.PytestAssertRewriteWarning"  # what is imported by then is not of a test
    options = ("-qq", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", known, *SILENT, *PATIENT)
    code = int(pytest.main([*options, *tests], plugins=[plugin]))
    if plugin.interrupted:
        raise KeyboardInterrupt
    return code


class Attack:
    """A plugin of pytest: in place of running the tests, run them against each mutant."""

    def __init__(self, chosen: Sequence[Mutant], most_s: float, tell: Told) -> None:
        self._paths = {str(HOME / mutant.path): mutant.path for mutant in chosen}
        self._chosen, self._most_s, self._tell = chosen, most_s, tell
        self.interrupted = False
        self._failed = ""
        self._caches: list[Any] = []
        self._killers: dict[str, list[str]] = {}  # of a function, the latest first

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self._failed:
            self._failed = report.nodeid

    @pytest.hookimpl(tryfirst=True)
    def pytest_report_teststatus(self, report: pytest.TestReport) -> tuple[str, str, str]:
        """Nothing: that a test fails with a mutant is as it should be, and no failing test."""
        return report.outcome, "", ""

    def pytest_keyboard_interrupt(self, excinfo: pytest.ExceptionInfo[BaseException]) -> None:
        self.interrupted = isinstance(excinfo.value, KeyboardInterrupt)

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        if session.testsfailed:
            raise pytest.UsageError("tests could not be collected")

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self._items = {item.nodeid: item for item in session.items}
        gc.unfreeze()  # of the part before
        gc.collect()
        functions = _functions(self._paths)
        self._caches = [f for f in gc.get_objects() if type(f).__name__ == "_lru_cache_wrapper"]
        self._caches = [f for f in self._caches if f.__module__.partition(".")[0] in COPIED]
        gc.freeze()
        tests = self._measured()
        self._seconds = {test.name: test.seconds for test in tests}
        places: dict[Mutant, Place] = {}
        for path in self._paths.values():
            places.update(mutants(path))
        # those last that need a process of their own, of which each takes ten times as long
        for mutant in sorted(self._chosen, key=lambda mutant: places[mutant].on_import):
            try:
                self._tell(self._fate(mutant, places[mutant], tests, functions))
            except Unfit as error:
                print(f"not run: {mutant}: {error}", flush=True)
        return True

    def _fate(
        self, mutant: Mutant, place: Place, tests: Sequence[Test], functions: Sequence[FunctionType]
    ) -> Fate:
        """Raises Unfit."""
        key = mutant.path, mutant.where
        seeing = [] if place.on_import else [test for test in tests if key in test.called]
        names, _ = self._in_turn(mutant, seeing)
        killer = sure(partial(self._forked, _swaps(mutant, place, functions)), names)
        if not killer:  # it may be seen on import, or in a process that a test starts
            others = [test for test in tests if test.name not in names]
            more, seconds = self._in_turn(mutant, others)
            killer = sure(partial(in_copy, mutant, place, seconds), more)
            names += more
        if killer in self._items:
            latest = self._killers.setdefault(mutant.path + mutant.where, [])
            latest[:] = [killer, *(name for name in latest if name != killer)][:5]
        return Fate(mutant, killer, len(names))

    def _in_turn(self, mutant: Mutant, seeing: Sequence[Test]) -> tuple[list[str], float]:
        """Those over no wire first, which do not wait; of each those that have killed others of its
        function, then those named after its module, that call any of it, the nearest, the quickest;
        and the time that all take."""
        latest = self._killers.get(mutant.path + mutant.where, [])
        rank = {name: i for i, name in enumerate(latest)}
        stem = Path(mutant.path).stem
        named = f"test_{stem}", f"_{stem}.py::"
        folders = Path(mutant.path).parts[:-1]

        def turn(test: Test) -> tuple[bool, int, bool, bool, int, float]:
            far = sum(folder not in test.name.split("/") for folder in folders)
            stranger = all(path != mutant.path for path, _ in test.called)
            other = all(name not in test.name for name in named)
            early = "/wire/" in test.name, rank.get(test.name, len(rank)), other
            return *early, stranger, far, test.seconds

        order = sorted(seeing, key=turn)
        spent = accumulate(test.seconds for test in order)
        chosen = [t for t, s in zip(order, spent, strict=True) if s - t.seconds <= self._most_s]
        return [test.name for test in chosen], sum(test.seconds for test in chosen)

    def _measured(self) -> list[Test]:
        """All tests without a mutant, in a child. One that fails then tells nothing of a mutant:
        it is left out, and named."""
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(read)
            try:
                with os.fdopen(write, "wb") as told:
                    told.write(msgspec.json.encode(list(self._watched())))
            finally:
                os._exit(0)
        os.close(write)
        with os.fdopen(read, "rb") as told:
            text = told.read()
        os.waitpid(child, 0)
        if not text:
            raise RuntimeError("a test ended the process that runs them, without a mutant")
        tests = msgspec.json.decode(text, type=list[Test])
        for test in tests:
            if test.fails:
                print(f"left out, fails without a mutant: {test.name}", flush=True)
        return [test for test in tests if not test.fails]

    def _forget(self) -> None:
        """What the original found, or another test asked for."""
        for cached in self._caches:
            cached.cache_clear()

    def _watched(self) -> Iterator[Test]:
        _quiet()
        called: set[tuple[str, str]] = set()
        paths = self._paths

        def called_now(frame: FrameType, event: str, argument: Any) -> None:
            code = frame.f_code
            if event == "call" and code.co_filename in paths:
                called.add((paths[code.co_filename], _outermost(code.co_qualname)))

        items = list(self._items.values())
        for item, following in zip(items, [*items[1:], None], strict=True):
            called.clear()
            self._forget()
            start_s = sum(os.times()[:4])
            threading.setprofile(called_now)
            sys.setprofile(called_now)
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            sys.setprofile(None)
            threading.setprofile(None)
            seconds, fails = sum(os.times()[:4]) - start_s, bool(self._failed)
            self._failed = ""
            yield Test(item.nodeid, seconds, sorted(called.copy()), fails)

    def _forked(self, swap: Swap, names: Sequence[str], changed: bool) -> Fell | None:
        """What fell first, in a child."""
        with tempfile.TemporaryFile() as told:
            child = os.fork()
            if child == 0:
                os.setpgid(0, 0)
                _quiet()
                try:
                    for function, code in swap if changed else ():
                        function.__code__ = code
                    self._forget()
                    self._run_each(names, told.fileno())
                finally:
                    os._exit(0)
            ended = _waited(child, told, lambda: os.waitpid(child, os.WNOHANG)[0] != 0)
            _end_all(child)
            if not ended:
                os.waitpid(child, 0)
            told.seek(0)
            *begun, last = told.read().decode().split("\n")
        if last == "passed":
            return None
        return Fell(begun[-1] if begun else "", "" if last == "failed" else TIME_OUT)

    def _run_each(self, names: Sequence[str], told: int) -> None:
        """Tell of each before it runs, and how the last one ended: of one that does not end is
        known which it was."""
        items = [self._items[name] for name in names]
        for item, following in zip(items, [*items[1:], None], strict=True):
            os.write(told, f"{item.nodeid}\n".encode())
            _limit(0, self._seconds[item.nodeid], sum(os.times()[:2]))
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self._failed:
                os.write(told, b"failed")
                return
        os.write(told, b"passed")


def sure(attempt: Attempt, names: Sequence[str]) -> str:
    """What kills a mutant: what fell once more with it, and did not without it. Raises Unfit where
    no test passes without it either."""
    left, unfit, passed = list(names), list[str](), False
    while left and (fell := attempt(left, True)):
        alone = _alone(fell.test, left)
        if without := attempt(alone, False):
            unfit.append(without.killer)
        elif attempt(alone, True):
            return fell.killer
        else:
            passed = True
        left = [name for name in left if name not in alone]
    if unfit and not left and not passed:
        raise Unfit(f"without a mutant too: {', '.join(unfit)}")
    return ""


def _alone(test: str, left: list[str]) -> list[str]:
    """Itself; of a file that cannot be imported one of it; all where none is named."""
    named = (name for name in left if test and f"{name}::".startswith(f"{test}::"))
    return [*islice(named, 1)] or left


def in_copy(
    mutant: Mutant, place: Place, seconds: float, names: Sequence[str], changed: bool
) -> Fell | None:
    """What fell first in a copy of the checkout."""
    home = _copy()
    path = home / mutant.path
    source = path.read_text(encoding="utf-8")
    if changed:
        path.write_text(ast.unparse(mutated(mutant.path, place)), encoding="utf-8")
    options = ("-x", "-q", "-p", "no:cacheprovider", *PATIENT)
    try:
        with (
            tempfile.TemporaryFile("w+", encoding="utf-8") as told,
            subprocess.Popen(
                [sys.executable, "-P", "-m", "pytest", *options, *names],
                cwd=home, env=os.environ | {"PYTHONPATH": str(home), "PYTHONUNBUFFERED": "1"},
                stdout=told, stderr=subprocess.DEVNULL, start_new_session=True,
            ) as child,
        ):  # fmt: skip
            _limit(child.pid, seconds + BEGIN_CPU_S)
            try:
                ended = _waited(child.pid, told, lambda: child.poll() is not None)
            finally:
                _end_all(child.pid)
            code = child.wait()
            told.seek(0)
            said = told.read()
    finally:
        path.write_text(source, encoding="utf-8")
    if not ended or code < 0:
        return Fell("", TIME_OUT)
    if code == 0:
        return None
    failed = [line for line in said.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return Fell(failed[0].partition(" ")[2].partition(" - ")[0]) if failed else Fell("", "broken")


def _end_all(group: int) -> None:
    """What tests have started and not ended."""
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def _functions(paths: Iterable[str]) -> list[FunctionType]:
    """All that are of these files."""
    wanted = set(paths)
    every = [f for f in gc.get_objects() if type(f) is FunctionType]
    return [f for f in every if f.__code__.co_filename in wanted]


def _swaps(mutant: Mutant, place: Place, functions: Iterable[FunctionType]) -> Swap:
    """The functions whose code a mutant changes."""
    path = str(HOME / mutant.path)
    codes = dict(_codes(compile(mutated(mutant.path, place), path, "exec")))
    found = []
    for function in functions:
        code = function.__code__
        key = code.co_qualname, code.co_firstlineno
        mine = code.co_filename == path and _outermost(code.co_qualname) == mutant.where
        if mine and key in codes and codes[key].co_freevars == code.co_freevars:
            found.append((function, codes[key]))
    return found


def _codes(code: CodeType) -> Iterator[tuple[tuple[str, int], CodeType]]:
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield (inner.co_qualname, inner.co_firstlineno), inner
            yield from _codes(inner)


def _outermost(qualified: str) -> str:
    """Name of the function that something was defined in, or of itself."""
    return qualified.partition(".<locals>")[0]


def _limit(pid: int, seconds: float, taken_s: float = 0.0) -> None:
    """So much processor time may a process take besides what it has, this one if 0."""
    most = round(taken_s + LEAST_CPU_S + TIMES * seconds)
    _, hard = resource.prlimit(pid, resource.RLIMIT_CPU)
    resource.prlimit(pid, resource.RLIMIT_CPU, (most, hard))


def _waited(child: int, told: IO[Any], ended: Callable[[], bool]) -> bool:
    """Whether it ended, by itself or by its limit: not if a test of those that it tells of waits
    for what never comes. A machine that has no time for it does not make it late."""
    size, idle, looked_s = 0, 0, time.monotonic()
    while idle * LOOK_S < IDLE_S:
        if ended():
            return True
        time.sleep(0.002)
        if time.monotonic() - looked_s > LOOK_S:
            before, size = size, os.fstat(told.fileno()).st_size
            idle = 0 if size > before else idle + _idle(child)
            looked_s = time.monotonic()
    return False


def _idle(root: int) -> bool:
    """Whether no thread of a process and of what it has started runs or would run."""
    parents: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            parents[int(path.parent.name)] = int(_state(path)[1])
    family = {root}
    while more := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= more
    for pid in family:
        for path in Path(f"/proc/{pid}/task").glob("*/stat"):
            with suppress(OSError):
                if _state(path)[0] in "RD":
                    return False
    return True


def _state(path: Path) -> list[str]:
    """Of a process or thread: its state's letter, its parent, and what follows."""
    return path.read_text().rpartition(")")[2].split()


def _quiet() -> None:
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)


def _copy() -> Path:
    """Of the checkout, made when it is first asked for."""
    home = HOME / "build" / f"mutants-{os.getpid()}"
    if not hasattr(_copy, "made"):
        atexit.register(shutil.rmtree, home, ignore_errors=True)
        for name in COPIED:
            shutil.copytree(HOME / name, home / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("pyproject.toml", "README.md", "Makefile", "CHANGELOG.md"):
            shutil.copy(HOME / name, home / name)
        _copy.made = True  # type: ignore[attr-defined]
    return home
