"""SIGINT, SIGTERM and SIGHUP, taken by the command line so that they cut nothing in two.

Outside ``deferred`` a signal raises an ``Interruption`` at once. Inside, the first one sets a flag
that the next ``check`` raises, once; a third is raised at once. Within ``guarded``, as a run is, a
thread ends the process with exit code 5 where the main thread does not check for a second, or where
a further signal comes a second after the first. Native code that keeps Python's global lock stops
that thread too: then only SIGKILL helps. Other threads than the main one are never interrupted.
Where the signals are not taken they mean what they mean in Python.
"""

import os
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INSISTS = 3  # signals, of which the last is raised though it should wait: something hangs
LOOK_S, STUCK_S = 0.01, 1.0  # between two looks of the guard; without a check
RESCUE_S = 40.0  # more than the devices get
INTERNAL = 5  # exit code

_WORDS = {
    signal.SIGINT: "stopped by hand",
    signal.SIGTERM: "told to end (SIGTERM)",
    signal.SIGHUP: "the terminal was closed (SIGHUP)",
}


class Interruption(KeyboardInterrupt):
    """A signal asked the process to end."""


class _State:
    def __init__(self, report: Callable[[Any], int] = lambda failure: INTERNAL) -> None:
        self.report = report
        self.number: int | None = None  # of the first signal
        self.came = 0
        self.deferred = self.once = self.sealed = self.guarded = False
        self.raised = False
        self.looks = 0
        self.given_up = False  # the guard commands the devices and ends the process
        self.last_acts: list[Callable[[], object]] = []

    def take(self, number: int, _: object) -> None:
        while self.given_up:
            time.sleep(RESCUE_S)
        self.number, self.came = self.number or number, self.came + 1
        if not self.deferred or (self.came >= INSISTS and not self.guarded):
            self.raised, self.deferred = True, self.deferred or self.once
            raise Interruption(self.number)


_taken: _State | None = None


def _state() -> _State:
    """Of this process; an idle one in other threads, and where the signals are not taken."""
    main = threading.current_thread() is threading.main_thread()
    return _taken if main and _taken is not None else _State()


@contextmanager
def taken(report: Callable[[Any], int] = lambda failure: INTERNAL) -> Iterator[None]:
    """Handle the signals, except those that the parent process ignores; restore them at the end.

    ``report``: prints what ``guarded``'s rescue returns, and gives the exit code."""
    global _taken  # noqa: PLW0603  (signals are the process's)
    if threading.current_thread() is not threading.main_thread() or _taken is not None:
        yield
        return
    before: dict[int, Any] = {}
    _taken = state = _State(report)
    try:
        for number in map(int, SIGNALS):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, state.take)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _taken = None


@contextmanager
def deferred(on: bool = True, sealed: bool = False) -> Iterator[None]:
    """Within, a signal waits for the next ``check``; where ``sealed``, for one after this."""
    state = _state()
    before = state.deferred, state.sealed
    state.deferred, state.sealed = on, sealed or state.sealed
    try:
        yield
    finally:
        state.deferred, state.sealed = before


@contextmanager
def immediate() -> Iterator[None]:
    """Inside ``deferred``: a long wait that a signal cuts short, and none what that unwinds."""
    check()
    state = _state()
    state.once = True
    try:
        with deferred(on=False):
            yield
    finally:
        state.once = False


def check(end: bool = True) -> None:
    """Raises Interruption, once, when a signal has come. Tells the guard that the main thread goes
    on; ``end`` is False where no signal may end what is done, as a safe state."""
    state = _state()
    state.looks += 1
    if end and state.number is not None and not (state.raised or state.sealed):
        state.raised = True
        raise Interruption(state.number)


def go_on() -> None:
    """Raises Interruption when a signal has come, though a trial has taken it for its end: whoever
    has more than that trial to do ends too."""
    if asked():
        raise Interruption(number())


def asked() -> bool:
    """Whether a signal has come."""
    return _taken is not None and _taken.number is not None


def number() -> int:
    """The signal that came first; SIGINT where none was taken."""
    return (_taken and _taken.number) or signal.SIGINT


def cause(stop: KeyboardInterrupt) -> str:
    """In a person's words."""
    known = isinstance(stop, Interruption) and stop.args
    return _WORDS[signal.Signals(stop.args[0] if known else signal.SIGINT)]


@contextmanager
def lastly(act: Callable[[], object]) -> Iterator[None]:
    """Within, the guard runs ``act`` before it ends the process, which runs no `finally`."""
    acts = _state().last_acts
    acts.append(act)
    try:
        yield
    finally:
        acts.remove(act)


@contextmanager
def guarded(rescue: Callable[[], object]) -> Iterator[None]:
    """Within, the process ends by ``rescue`` where the main thread cannot end it: each act of
    ``lastly`` is done, then the rescue's result reported."""
    state = _state()
    if state is not _taken:
        yield
        return
    ours, wakes = socket.socketpair()  # tells of a signal though no handler runs
    wakes.setblocking(False)
    before = signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)
    guard = threading.Thread(target=_guard, args=(state, ours, rescue), name="guard", daemon=True)
    guard.start()
    state.guarded = True
    try:
        yield
    finally:
        state.guarded = False
        signal.set_wakeup_fd(before)
        wakes.close()
        guard.join()
        ours.close()


def _guard(state: _State, wakes: socket.socket, rescue: Callable[[], object]) -> None:
    """Counts its own waits instead of reading a clock: a suspended computer must not look like a
    main thread that stands still."""
    number, looks, still, since = state.number, state.looks, 0, 0
    while still * LOOK_S < STUCK_S:
        if select.select([wakes], [], [], None if number is None else LOOK_S)[0]:
            received = wakes.recv(4096)
            if not received:
                return
            if number is not None and since * LOOK_S >= STUCK_S:
                break
            number = number or next((n for n in received if n in SIGNALS), None)
        else:
            still = 0 if state.looks != looks else still + 1
            looks, since = state.looks, since + 1
    state.number, state.given_up = state.number or number, True
    signal.pthread_kill(threading.main_thread().ident or 0, number or signal.SIGINT)  # to `take`
    limit = threading.Timer(RESCUE_S, os._exit, (INTERNAL,))
    limit.daemon = True
    limit.start()
    code, failure = INTERNAL, None
    with suppress(BaseException):
        failure = rescue()
    for act in reversed(state.last_acts):
        with suppress(BaseException):
            act()
    with suppress(BaseException):
        code = state.report(failure)
    os._exit(code)
