"""Handling of SIGINT, SIGTERM and SIGHUP, so that they interrupt no critical section.

Outside ``deferred`` a signal raises an ``Interruption`` at once. Inside, it sets a flag, and the
next ``check`` raises, once; a signal five seconds later is raised at once. Within ``watchdog``, as
in a run, ``Stuck`` interrupts a main thread that does not check for a second after a signal. A
further signal a second after the first raises ``Stuck`` once: a key that is held down must not
interrupt the stop that it requested. Native code cannot be interrupted; then a thread stops the
devices and ends the process. Native code that keeps Python's lock blocks all threads, and only
SIGKILL helps. Other threads are never interrupted. Outside ``taken`` signals have Python's default
meaning.
"""

import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
FORCE_AFTER_S = 5.0  # after the first or a raised signal, the next one is raised although deferred
WATCHDOG_PERIOD_S, STUCK_PERIODS = 0.1, 10  # periods without a check before `Stuck`
RESCUE_S = 20.0  # longer than stopping the devices takes
INTERNAL = 5  # exit code

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


class _State:
    def __init__(self) -> None:
        self.number: int | None = None  # of the first signal
        self.checks = 0
        self.deferred = self.defer_after_raise = self.ignore_checks = self.raised = False
        self.watched = self.raise_next = self.hangs = self.rescued = False
        self.raised_at_s = 0.0
        self.thread = threading.get_ident()

    def take(self, number: int, _: object) -> None:
        while self.rescued:  # the watchdog thread commands the devices and ends the process
            time.sleep(RESCUE_S)
        now_s = time.monotonic()
        if self.number is None:
            self.number, self.raised_at_s = number, now_s
        stuck = self.watched and (self.raise_next or self.hangs)
        self.raise_next = self.hangs = False  # once each
        late = not self.watched and now_s - self.raised_at_s >= FORCE_AFTER_S
        if stuck or late or not self.deferred:
            self.raised, self.raised_at_s = True, now_s
            self.deferred = self.deferred or self.defer_after_raise
            raise (Stuck if stuck else Interruption)(self.number)


_taken: _State | None = None


def _state() -> _State:
    """State of this process; an unused one in other threads and outside ``taken``."""
    return _taken_here() or _State()


def _taken_here() -> _State | None:
    """State of this process; None in other threads and outside ``taken``."""
    state = _taken
    return None if state is None or state.thread != threading.get_ident() else state


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
                before[number] = signal.signal(number, state.take)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _taken = None


@contextmanager
def deferred(on: bool = True, ignore_checks: bool = False) -> Iterator[None]:
    """Within, a signal waits for the next ``check``; with ``ignore_checks``, for one outside."""
    state = _state()
    before = state.deferred, state.ignore_checks
    state.deferred, state.ignore_checks = on, ignore_checks or state.ignore_checks
    try:
        yield
    finally:
        state.deferred, state.ignore_checks = before


@contextmanager
def immediate() -> Iterator[None]:
    """Inside ``deferred``: a signal interrupts the body at once, but not the clean-up after it."""
    check()
    state = _state()
    state.defer_after_raise = True
    try:
        with deferred(on=False):
            yield
    finally:
        state.defer_after_raise = False


@contextmanager
def watchdog(rescue: Callable[[], object]) -> Iterator[None]:
    """Within, ``Stuck`` interrupts a main thread that hangs after a signal. If that does not help,
    ``rescue`` makes the devices safe and the process exits with code 5."""
    state = _state()
    if state is not _taken:
        yield
        return
    reads, writes = socket.socketpair()  # signals arrive there even if no handler can run
    writes.setblocking(False)
    before = signal.set_wakeup_fd(writes.fileno(), warn_on_full_buffer=False)
    thread = threading.Thread(target=_watch, args=(state, reads, rescue), daemon=True)
    thread.start()
    state.watched = True
    try:
        yield
    finally:
        state.watched = False
        signal.set_wakeup_fd(before)
        writes.close()
        thread.join()
        reads.close()


def _watch(state: _State, reads: socket.socket, rescue: Callable[[], object]) -> None:
    """Body of the watchdog thread. It counts its own periods, so that a pause of the whole process
    does not look like a hanging main thread, and at most one per ``WATCHDOG_PERIOD_S``, however
    often a key repeats."""
    number, periods, stuck, checks, last_s = None, 0, 0, -1, 0.0
    while stuck < 3 * STUCK_PERIODS:
        if select.select([reads], [], [], None if number is None else WATCHDOG_PERIOD_S)[0]:
            if not (received := reads.recv(4096)):
                return
            number = number or next((n for n in received if n in SIGNALS), None)
        if number is None or time.monotonic() - last_s < WATCHDOG_PERIOD_S:
            continue
        last_s = time.monotonic()
        periods, stuck = periods + 1, stuck + 1 if state.checks == checks else 0
        checks, state.raise_next = state.checks, state.raise_next or periods == STUCK_PERIODS
        if stuck in (STUCK_PERIODS, 2 * STUCK_PERIODS):
            state.hangs = True
            signal.pthread_kill(threading.main_thread().ident or 0, number)
    state.rescued = True
    with suppress(BaseException):
        limit = threading.Timer(RESCUE_S, os._exit, (INTERNAL,))
        limit.daemon = True
        limit.start()
    with suppress(BaseException):
        rescue()
    with suppress(BaseException):  # in a thread, because nobody may read the stream
        text = "grasp: the program hangs: arm stop and hand hold were commanded, exit 5\n"
        threading.Thread(target=sys.stderr.write, args=(text,), daemon=True).start()
        time.sleep(WATCHDOG_PERIOD_S)
    os._exit(INTERNAL)


def check(end: bool = True) -> None:
    """Raise Interruption, once, if a signal was received. ``end``: False where no signal may end
    the current work, such as a safe state."""
    state = _taken_here()
    if state is None:
        return
    state.checks += 1
    if end and state.number is not None and not (state.raised or state.ignore_checks):
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
