"""SIGINT, SIGTERM and SIGHUP, taken by the command line so that they cut nothing in two.

Outside ``deferred`` a signal raises an ``Interruption`` at once. Inside, it sets a flag that the
next ``check`` raises, once; one that comes five seconds later is raised at once. Within
``guarded``, as a run is, a main thread that does not check for a second after a signal is
interrupted by ``Stuck``, and once by a further signal a second after the first: a key that is held
down must not cut off the stop that it asked for. Native code cannot be interrupted: a thread stops
the devices and ends the process then. Native code that keeps Python's lock stops all threads: only
SIGKILL helps. Other threads never are interrupted. Where the signals are not taken they mean what
they mean in Python.
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
INSISTS_S = 5.0  # after the first or one raised so, a signal is raised though it should wait
LOOK_S, STUCK_LOOKS = 0.1, 10  # without a check since the first
RESCUE_S = 20.0  # more than stopping the devices takes
INTERNAL = 5  # exit code

_WORDS = {
    signal.SIGINT: "stopped by hand",
    signal.SIGTERM: "told to end (SIGTERM)",
    signal.SIGHUP: "the terminal was closed (SIGHUP)",
}


class Interruption(KeyboardInterrupt):
    """A signal asked the process to end."""


class Stuck(Interruption):
    """It did, and what the main thread does hangs."""

    def __str__(self) -> str:
        return f"{cause(self)} while this stood still"


class _State:
    def __init__(self) -> None:
        self.number: int | None = None  # of the first signal
        self.checks = 0
        self.deferred = self.once = self.sealed = self.raised = False
        self.guarded = self.insists = self.hangs = self.rescued = False
        self.raised_at_s = 0.0

    def take(self, number: int, _: object) -> None:
        while self.rescued:  # another thread commands the devices and ends the process
            time.sleep(RESCUE_S)
        now_s = time.monotonic()
        if self.number is None:
            self.number, self.raised_at_s = number, now_s
        stuck = self.guarded and (self.insists or self.hangs)
        self.insists = self.hangs = False  # once each
        late = not self.guarded and now_s - self.raised_at_s >= INSISTS_S
        if stuck or late or not self.deferred:
            self.raised, self.deferred, self.raised_at_s = True, self.deferred or self.once, now_s
            raise (Stuck if stuck else Interruption)(self.number)


_taken: _State | None = None


def _state() -> _State:
    """Of this process; an idle one in other threads, and where the signals are not taken."""
    main = threading.current_thread() is threading.main_thread()
    return _taken if main and _taken is not None else _State()


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


@contextmanager
def guarded(rescue: Callable[[], object]) -> Iterator[None]:
    """Within, a main thread that hangs after a signal is interrupted by ``Stuck``; where that does
    not help, ``rescue`` makes the devices safe and the process exits with code 5."""
    state = _state()
    if state is not _taken:
        yield
        return
    wakes, ours = socket.socketpair()  # a signal is written there though no handler can run
    ours.setblocking(False)
    before = signal.set_wakeup_fd(ours.fileno(), warn_on_full_buffer=False)
    thread = threading.Thread(target=_end_hang, args=(state, wakes, rescue), daemon=True)
    thread.start()
    state.guarded = True
    try:
        yield
    finally:
        state.guarded = False
        signal.set_wakeup_fd(before)
        ours.close()
        thread.join()
        wakes.close()


def _end_hang(state: _State, wakes: socket.socket, rescue: Callable[[], object]) -> None:
    """Counts its own looks, so that no pause of the whole process looks like a main thread that
    hangs, and no more than one in ``LOOK_S``, however often a key repeats."""
    number, looks, still, checks, looked_s = None, 0, 0, -1, 0.0
    while still < 3 * STUCK_LOOKS:
        if select.select([wakes], [], [], None if number is None else LOOK_S)[0]:
            if not (received := wakes.recv(4096)):
                return
            number = number or next((n for n in received if n in SIGNALS), None)
        if number is None or time.monotonic() - looked_s < LOOK_S:
            continue
        looked_s = time.monotonic()
        looks, still = looks + 1, still + 1 if state.checks == checks else 0
        checks, state.insists = state.checks, state.insists or looks == STUCK_LOOKS
        if still in (STUCK_LOOKS, 2 * STUCK_LOOKS):
            state.hangs = True
            signal.pthread_kill(threading.main_thread().ident or 0, number)
    state.rescued = True
    with suppress(BaseException):
        limit = threading.Timer(RESCUE_S, os._exit, (INTERNAL,))
        limit.daemon = True
        limit.start()
    with suppress(BaseException):
        rescue()
    with suppress(BaseException):  # in a thread: nobody may read it
        words = ("grasp: the program hangs: the arm was stopped, the hand told to hold, exit 5\n",)
        threading.Thread(target=sys.stderr.write, args=words, daemon=True).start()
        time.sleep(LOOK_S)
    os._exit(INTERNAL)


def check(end: bool = True) -> None:
    """Raises Interruption, once, when a signal has come; ``end`` is False where no signal may end
    what is done, as a safe state."""
    state = _state()
    state.checks += 1
    if end and state.number is not None and not (state.raised or state.sealed):
        state.raised = True
        raise Interruption(state.number)


def go_on() -> None:
    """Raises Interruption when a signal has come, though a trial has taken it for its end: a caller
    with more than that trial to do ends too."""
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
