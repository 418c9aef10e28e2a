"""SIGINT, SIGTERM and SIGHUP, taken where nothing is left half done.

The command line takes them (``taken``); without that they mean what they mean in Python. They
become an ``Interruption``, a KeyboardInterrupt: at once as a rule, and inside ``held`` only where
``check`` is called, so that no step, no recording and no closing of a device is cut in two. While a
module is imported they wait for its end, for there some libraries turn it into an ImportError, and
callbacks of the import system lose it; so does whoever looks up a type hint from C, as msgspec. A
second one a second later cuts that wait. What stands still is cut by a further signal: a second
after the last look in a loop that looks often (``watched``), after ten anywhere. Inside ``guarded``
the first signal is enough for such a loop, even where the main thread runs native code. State is a
process's, as signals are; in other threads than the main one nothing here does anything.
"""

import os
import select
import signal
import socket
import sys
import threading
import time
import typing
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from enum import Enum, auto
from types import FrameType
from typing import Any, NoReturn

from drivers.errors import SuppressAll
from grasp.clock import stopwatch_ns

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LOSING = ("<frozen importlib._bootstrap>", typing.__file__)  # files of frames that lose exceptions
LOOK_S = 0.01  # between two looks whether they have ended
STUCK_NS = 1_000_000_000  # what has not looked for so long stands still: a further one cuts in
HUNG_NS = 10_000_000_000  # and where nobody looks
MOST_CUTS = 3  # consecutive, without progress of the loop: code may catch an Interruption and go on
RESCUE_S = 40.0  # more than the devices get (loop.abort_s is 30 s at most)
INTERNAL = 5  # exit code of a bug

_WORDS = {
    signal.SIGINT: "stopped by hand",
    signal.SIGTERM: "told to end (SIGTERM)",
    signal.SIGHUP: "the terminal was closed (SIGHUP)",
}


class Interruption(KeyboardInterrupt):
    """A signal asked the process to end. ``cut``: raised inside code that did not return."""

    def __init__(self, number: int, cut: bool = False) -> None:
        super().__init__(number, cut)
        self.number, self.cut = number, cut


class _Mode(Enum):
    RAISE = auto()  # at once
    HOLD = auto()  # at the next look
    WATCH = auto()  # as HOLD, but a further one cuts in where nobody has looked for a second
    ALLOW = auto()  # at once, but only the first one: what it unwinds is not cut again
    SEAL = auto()  # not any more


class _Taker:
    """Takes the signals of a process."""

    def __init__(self) -> None:
        self.mode = _Mode.RAISE
        self.asked: int | None = None  # by the first signal
        self.raised = False
        self.put_off = False  # it has cut off no more than what hung
        self._since_ns = 0  # the first signal, the last look after it or the last that cut in
        self._losing = _losing(sys._getframe())  # noqa: SLF001  (whoever calls us may be imported)
        self._alarm: Any = None  # what took SIGALRM before
        # shared with the thread of `guarded`
        self.looks = 0
        self.handled = False  # the main thread has taken the signal that was sent last
        self.cutting = False  # that signal interrupts a loop that stands still
        self.given_up = False
        self.report: Callable[[Any], int] = lambda failure: INTERNAL
        self.last_acts: list[Callable[[], object]] = []

    def take(self, number: int, frame: FrameType | None) -> None:
        self.handled = True
        cutting, self.cutting = self.cutting, False
        while self.given_up:  # another thread commands the devices and ends the process
            time.sleep(RESCUE_S)
        if self.asked is None:
            self.asked, self._since_ns = number, stopwatch_ns()
        still_ns = stopwatch_ns() - self._since_ns
        if self.mode is _Mode.RAISE or (not self.raised and self.mode is _Mode.ALLOW):
            if _losing(frame) > self._losing and still_ns <= STUCK_NS:
                self._end_later()
            else:
                self.end()
        elif still_ns > HUNG_NS or (self.mode is _Mode.WATCH and (cutting or still_ns > STUCK_NS)):
            self.end(cut=True)

    def _end_later(self) -> None:
        if self._alarm is None:
            self._alarm = signal.signal(signal.SIGALRM, self._now)
        signal.setitimer(signal.ITIMER_REAL, LOOK_S)

    def _now(self, _: int, frame: FrameType | None) -> None:
        if self.raised or self.mode not in (_Mode.RAISE, _Mode.ALLOW):
            return  # whoever holds it looks
        if _losing(frame) > self._losing:
            signal.setitimer(signal.ITIMER_REAL, LOOK_S)
        else:
            self.end()

    def close(self) -> None:
        if self._alarm is not None:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._alarm)

    def look(self) -> None:
        if self.asked is not None and not self.raised and self.mode is not _Mode.SEAL:
            self.end()
        self.go()

    def go(self) -> None:
        self.looks += 1
        if self.asked is not None:
            self._since_ns = stopwatch_ns()

    def end(self, cut: bool = False) -> NoReturn:
        self.raised, self.put_off = True, False
        self._since_ns = stopwatch_ns()
        assert self.asked is not None  # noqa: S101
        raise Interruption(self.asked, cut)


def _losing(frame: FrameType | None) -> int:
    """How many frames that may lose an exception lie below and at a frame."""
    found = 0
    while frame is not None:
        found += frame.f_code.co_filename in LOSING
        frame = frame.f_back
    return found


_taker: _Taker | None = None


@contextmanager
def taken(report: Callable[[Any], int] = lambda failure: INTERNAL) -> Iterator[None]:
    """Handle the signals, except those that the parent process ignores; restore them at the end.

    ``report``: prints the result of ``guarded``'s rescue, and returns the exit code."""
    global _taker  # noqa: PLW0603  (signals are the process's)
    if threading.current_thread() is not threading.main_thread() or _taker is not None:
        yield
        return
    before: dict[int, Any] = {}
    _taker = _Taker()
    _taker.report = report
    try:
        for number in map(int, SIGNALS):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, _taker.take)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _taker.close()
        _taker = None


def held() -> AbstractContextManager[None]:
    """Within, a signal waits for the next ``check``."""
    return _in(_Mode.HOLD)


def watched() -> AbstractContextManager[None]:
    """As ``held``, for a loop that looks often, or says that it goes: where it stands still a
    further signal cuts in."""
    return _in(_Mode.WATCH)


@contextmanager
def guarded(rescue: Callable[[], object]) -> Iterator[None]:
    """Within, one signal ends a ``watched`` loop that has stood still for a second.

    The loop gets an Interruption. Native code can block that exception. Then another thread runs
    ``rescue``, then each act of ``lastly``, reports the result of ``rescue``, and ends the process.
    """
    taker = _here()
    if taker is None:
        yield
        return
    ours, wakes = socket.socketpair()
    wakes.setblocking(False)
    before = signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)
    thread = threading.Thread(target=_guard, args=(taker, ours, rescue), name="guard", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        wakes.close()
        thread.join()
        ours.close()


def _guard(taker: _Taker, wakes: socket.socket, rescue: Callable[[], object]) -> None:
    """Body of the guard thread. It counts its own waits instead of reading a clock: a suspended
    computer must not look like a loop that stands still."""
    number, looks, waits, cuts = taker.asked, -1, 0, 0
    while True:
        if select.select([wakes], [], [], None if number is None else LOOK_S)[0]:
            received = wakes.recv(4096)
            if not received:
                return
            number = number or next((n for n in received if n in SIGNALS), None)
        elif taker.mode is not _Mode.WATCH or taker.looks != looks:
            looks, waits, cuts = taker.looks, 0, 0
        elif (waits := waits + 1) * LOOK_S * 1e9 >= STUCK_NS and number is not None:
            if not taker.handled or cuts == MOST_CUTS:
                break
            waits, cuts = 0, cuts + 1
            taker.handled, taker.cutting = False, True
            _strike(number)
    taker.asked, taker.given_up = taker.asked or number, True
    _strike(taker.asked or signal.SIGINT)  # code that comes back now stops in `take`
    _end_process(taker, rescue)


def _strike(number: int) -> None:
    """Send a signal to the main thread, so that a blocking system call returns."""
    ident = threading.main_thread().ident
    assert ident is not None  # noqa: S101
    signal.pthread_kill(ident, number)


def _end_process(taker: _Taker, rescue: Callable[[], object]) -> NoReturn:
    limit = threading.Timer(RESCUE_S, os._exit, (INTERNAL,))
    limit.daemon = True
    limit.start()
    code, failure = INTERNAL, None
    with SuppressAll():
        failure = rescue()
    for act in reversed(taker.last_acts):
        with SuppressAll():
            act()
    with SuppressAll():
        code = taker.report(failure)
    os._exit(code)


@contextmanager
def lastly(act: Callable[[], object]) -> Iterator[None]:
    """Within, ``guarded`` runs ``act`` before it ends the process, which runs no `finally`."""
    taker = _here()
    if taker is not None:
        taker.last_acts.append(act)
    try:
        yield
    finally:
        if taker is not None:
            taker.last_acts.remove(act)


def allowed() -> AbstractContextManager[None]:
    """Inside ``held``: a long wait that a signal may cut short, and none cuts what that unwinds."""
    return _in(_Mode.ALLOW)


def sealed() -> AbstractContextManager[None]:
    """It is too late: a signal waits for a ``check`` after this, whatever is done within."""
    return _in(_Mode.SEAL)


def seal() -> None:
    """As ``sealed``, until the end of the ``held`` that surrounds this; nothing without one."""
    taker = _here()
    if taker is not None and taker.mode is _Mode.HOLD:
        taker.mode = _Mode.SEAL


def check() -> None:
    """Raises Interruption, once, when a signal has come."""
    taker = _here()
    if taker is not None:
        taker.look()


@contextmanager
def _in(mode: _Mode) -> Iterator[None]:
    taker = _here()
    if taker is None or taker.mode is _Mode.SEAL:
        yield
        return
    before, taker.mode = taker.mode, mode
    try:
        if mode is _Mode.ALLOW:
            taker.look()
        yield
    finally:
        taker.mode = before


def goes() -> None:
    """What no signal is to end says here, often, that it does not stand still."""
    taker = _here()
    if taker is not None:
        taker.go()


def put_off() -> bool:
    """Says that what was raised has only cut off something, and that more is to end: the next look
    raises it anew. Whether there will be one; elsewhere than in the command line there is not."""
    taker = _here()
    if taker is None:
        return False
    taker.raised, taker.put_off = False, True
    return True


def check_put_off() -> None:
    """As ``check``, where one was put off and nobody has looked since."""
    taker = _here()
    if taker is not None and taker.put_off:
        taker.look()


def go_on() -> None:
    """Raises Interruption when a signal has come, though a trial has taken it for its end: whoever
    has more than that trial to do ends too."""
    if asked():
        raise Interruption(number())


def asked() -> bool:
    """Whether a signal has come."""
    return _taker is not None and _taker.asked is not None


def number() -> int:
    """The signal that came first; SIGINT where none was taken."""
    return signal.SIGINT if _taker is None or _taker.asked is None else _taker.asked


def cause(stop: KeyboardInterrupt) -> str:
    """In a person's words."""
    return _WORDS[signal.Signals(stop.number if isinstance(stop, Interruption) else signal.SIGINT)]


def _here() -> _Taker | None:
    return _taker if threading.current_thread() is threading.main_thread() else None
