"""Handling of SIGINT, SIGTERM and SIGHUP, so that they interrupt no critical section.

By default a signal raises an ``Interruption`` at once. Within ``deferred`` it waits for the next
``check``, which raises it, once. Within ``watched``, as in a run, ``Stuck`` is raised in a main
thread that has not checked for a second since a signal. Everywhere a signal is raised at once five
seconds after the last one: a key that is held down must not interrupt the stop that it requested.

Native code cannot be interrupted: the threads and processes of hand and arm then make them safe by
themselves after a second without a step, and only SIGKILL ends the program. Other threads are never
interrupted. Outside ``taken`` signals have Python's default meaning.
"""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum, auto
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
FORCE_AFTER_S = 5.0  # after the first or a raised signal, the next one is raised although deferred
HANG_S = 1.0  # without a check after a signal, before `Stuck`

_CAUSES = {
    signal.SIGINT: "stopped by hand",
    signal.SIGTERM: "terminated (SIGTERM)",
    signal.SIGHUP: "the terminal was closed (SIGHUP)",
}


class Interruption(KeyboardInterrupt):
    """A signal asked the process to end."""


class Stuck(Interruption):
    """A signal asked the process to end, and the main thread hangs."""

    def __str__(self) -> str:
        return f"{cause(self)} while the program hung"


class _Mode(Enum):
    IMMEDIATE = auto()  # a signal is raised at once
    ONCE = auto()  # the next one is, and those after it wait
    DEFERRED = auto()  # a signal waits for a check
    HELD = auto()  # for a check outside


class _State:
    def __init__(self) -> None:
        self.mode = _Mode.IMMEDIATE
        self.number: int | None = None  # of the first signal
        self.raised = self.watched = self.armed = False
        self.alarm_before: Any = None  # handler of SIGALRM that the timer's replaces
        self.raised_s = 0.0  # when the first signal came, or the last one was raised
        self.checks = self.checks_before = 0
        self.thread = threading.get_ident()

    def receive(self, number: int, _: object) -> None:
        now_s = time.monotonic()
        if self.number is None:
            self.number, self.raised_s = number, now_s
            if self.watched:
                self.arm()
        late = now_s - self.raised_s >= FORCE_AFTER_S
        if late or self.mode in (_Mode.IMMEDIATE, _Mode.ONCE):
            self._raise(Stuck if self.watched else Interruption)

    def arm(self) -> None:
        """Start the timer that looks for a hang."""
        self.armed, self.checks_before = True, self.checks
        self.alarm_before = signal.signal(signal.SIGALRM, self.look_for_hang)
        signal.setitimer(signal.ITIMER_REAL, HANG_S, HANG_S)

    def disarm(self) -> None:
        """Stop it; a timer of somebody else is left alone."""
        if self.armed:
            self.armed = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self.alarm_before)

    def look_for_hang(self, *_: object) -> None:
        before, self.checks_before = self.checks_before, self.checks
        if self.watched and self.checks == before:
            self._raise(Stuck)

    def _raise(self, kind: type[Interruption]) -> None:
        self.raised, self.raised_s = True, time.monotonic()
        self.mode = _Mode.DEFERRED if self.mode is _Mode.ONCE else self.mode
        raise kind(self.number)


_taken: _State | None = None
_UNUSED = _State()  # of other threads, and outside `taken`


def _state() -> _State:
    """State of this process; an unused one in other threads and outside ``taken``."""
    here = _taken is not None and _taken.thread == threading.get_ident()
    return _taken if _taken and here else _UNUSED


@contextmanager
def taken() -> Iterator[None]:
    """Handle the signals, except those that the parent process ignores; restore them at the end."""
    global _taken  # noqa: PLW0603  (signals are the process's)
    if threading.current_thread() is not threading.main_thread() or _taken is not None:
        yield
        return
    before: dict[int, Any] = {}
    _taken = state = _State()
    try:
        for number in map(int, SIGNALS):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, state.receive)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _taken = None


@contextmanager
def _mode(mode: _Mode) -> Iterator[None]:
    state = _state()
    before, state.mode = state.mode, mode
    try:
        yield
    finally:
        state.mode = before


@contextmanager
def deferred(ignore_checks: bool = False) -> Iterator[None]:
    """Within, a signal waits for the next ``check``; with ``ignore_checks``, for one outside."""
    held = ignore_checks or _state().mode is _Mode.HELD
    with _mode(_Mode.HELD if held else _Mode.DEFERRED):
        yield


@contextmanager
def immediate() -> Iterator[None]:
    """Inside ``deferred``: a signal interrupts the body at once, but not the clean-up after it."""
    check()
    with _mode(_Mode.ONCE):
        yield


@contextmanager
def watched() -> Iterator[None]:
    """Within, ``Stuck`` interrupts a main thread that hangs after a signal."""
    state = _state()
    if state is not _taken:
        yield
        return
    state.watched = True
    try:
        if state.number is not None:
            state.arm()
        yield
    finally:
        try:
            state.watched = False
        finally:  # also where `Stuck` comes just now
            state.disarm()


def check(end: bool = True) -> None:
    """Raise Interruption, once, if a signal was received. ``end``: False where no signal may end
    the current work, such as a safe state."""
    state = _state()
    state.checks += 1
    if end and state.number is not None and not state.raised and state.mode is not _Mode.HELD:
        state.raised = True
        raise Interruption(state.number)


def raise_if_received() -> None:
    """Raise Interruption if a signal was received, also one that has ended a trial: a caller with
    further trials ends too."""
    if received():
        raise Interruption(number())


def received() -> bool:
    """Whether a signal was received."""
    return _taken is not None and _taken.number is not None


def number() -> int:
    """Number of the first signal received; SIGINT if there was none."""
    return (_taken and _taken.number) or signal.SIGINT


def cause(stop: KeyboardInterrupt) -> str:
    """Cause of an interruption, for messages."""
    known = isinstance(stop, Interruption) and stop.args
    return _CAUSES[signal.Signals(stop.args[0] if known else signal.SIGINT)]
