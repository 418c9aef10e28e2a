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
LOOK_S = 0.01  # between two looks of the guard
STUCK_S = 1.0
RESCUE_S = 40.0  # more than the devices get (loop.abort_s is 30 s at most)
INSISTS = 3  # signals, of which the last is raised though it should wait: something hangs
INTERNAL = 5  # exit code

_WORDS = {
    signal.SIGINT: "stopped by hand",
    signal.SIGTERM: "told to end (SIGTERM)",
    signal.SIGHUP: "the terminal was closed (SIGHUP)",
}


class Interruption(KeyboardInterrupt):
    """A signal asked the process to end."""


class _State:
    """Of a process whose signals are taken."""

    def __init__(self, report: Callable[[Any], int]) -> None:
        self.report = report
        self.number: int | None = None  # of the first signal
        self.deferred = False
        self.once = False  # the next one that is raised defers those that follow
        self.raised = False
        self.sealed = False
        self.guarded = False
        self.came = 0
        self.looks = 0
        self.given_up = False  # the guard thread commands the devices and ends the process
        self.last_acts: list[Callable[[], object]] = []

    def take(self, number: int, _: object) -> None:
        while self.given_up:
            time.sleep(RESCUE_S)
        self.number, self.came = self.number or number, self.came + 1
        if not self.deferred or (self.came >= INSISTS and not self.guarded):
            self.raised, self.deferred = True, self.deferred or self.once
            raise Interruption(self.number)


_state: _State | None = None


def _here() -> _State | None:
    return _state if threading.current_thread() is threading.main_thread() else None


@contextmanager
def taken(report: Callable[[Any], int] = lambda failure: INTERNAL) -> Iterator[None]:
    """Handle the signals, except those that the parent process ignores; restore them at the end.

    ``report``: prints what ``guarded``'s rescue returns, and gives the exit code."""
    global _state  # noqa: PLW0603  (signals are the process's)
    if threading.current_thread() is not threading.main_thread() or _state is not None:
        yield
        return
    _state = state = _State(report)
    before: dict[int, Any] = {}
    try:
        for number in map(int, SIGNALS):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, state.take)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _state = None


@contextmanager
def deferred(on: bool = True, sealed: bool = False) -> Iterator[None]:
    """Within, a signal waits for the next ``check``; where ``sealed``, for one after this."""
    state = _here()
    if state is None:
        yield
        return
    before = state.deferred, state.sealed
    state.deferred, state.sealed = on, sealed or state.sealed
    try:
        yield
    finally:
        state.deferred, state.sealed = before


@contextmanager
def immediate() -> Iterator[None]:
    """Inside ``deferred``: a long wait that a signal cuts short, and none what that unwinds."""
    state = _here()
    check()
    with deferred(on=False):
        if state is not None:
            state.once = True
        try:
            yield
        finally:
            if state is not None:
                state.once = False


def check(end: bool = True) -> None:
    """Raises Interruption, once, when a signal has come. Tells the guard that the main thread goes
    on; ``end`` is False where no signal may end what is done, as a safe state."""
    state = _here()
    if state is not None:
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
    return _state is not None and _state.number is not None


def number() -> int:
    """The signal that came first; SIGINT where none was taken."""
    return signal.SIGINT if _state is None or _state.number is None else _state.number


def cause(stop: KeyboardInterrupt) -> str:
    """In a person's words."""
    known = isinstance(stop, Interruption) and stop.args
    return _WORDS[signal.Signals(stop.args[0] if known else signal.SIGINT)]


@contextmanager
def lastly(act: Callable[[], object]) -> Iterator[None]:
    """Within, the guard runs ``act`` before it ends the process, which runs no `finally`."""
    acts = [] if (state := _here()) is None else state.last_acts
    acts.append(act)
    try:
        yield
    finally:
        acts.remove(act)


@contextmanager
def guarded(rescue: Callable[[], object]) -> Iterator[None]:
    """Within, the process ends by ``rescue`` where the main thread cannot end it: its result is
    reported, then each act of ``lastly`` done."""
    state = _here()
    if state is None:
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
    """It counts its own waits instead of reading a clock: a suspended computer must not look like a
    main thread that stands still."""
    number, looks, waits, since = state.number, state.looks, 0, 0
    while waits * LOOK_S < STUCK_S:
        if select.select([wakes], [], [], None if number is None else LOOK_S)[0]:
            received = wakes.recv(4096)
            if not received:
                return
            if number is not None and since * LOOK_S >= STUCK_S:
                break
            number = number or next((n for n in received if n in SIGNALS), None)
        elif state.looks != looks:
            looks, waits, since = state.looks, 0, since + 1
        else:
            waits, since = waits + 1, since + 1
    state.number, state.given_up = state.number or number, True
    ident = threading.main_thread().ident
    assert ident is not None  # noqa: S101
    signal.pthread_kill(ident, number or signal.SIGINT)  # code that comes back stops in `take`
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
