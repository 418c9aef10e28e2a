"""A thin thread that polls the driver core in wall time, and the gripper that it makes of it."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final, Self

import msgspec

from drivers.errors import GraspError, LinkLost
from drivers.interfaces import Applied, Counts3, Gripper, GripperState
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.hand_state import closing_targets

_NS: Final = 1_000_000_000
_JOIN_S: Final = 5.0
_ERRORS_KEPT: Final = 8
_ACKNOWLEDGEMENTS_KEPT: Final = 4096
_MOST_BUGS: Final = 3  # in a row
_AFTER_BUG_S: Final = 0.01
_PATIENCE_S: Final = 0.002  # a verb waits for so much of an exchange: most are over by then
# After this time the program is taken to hang. The heartbeat (0.15 s) has braked the arm, and a
# step this late ends the run in a fault (monitors.standstill_s).
_UNPOLLED_NS: Final = 1_000_000_000
_NOT_YET = "the hand has not answered yet: told to it as soon as it has"

_LOG = logging.getLogger(__name__)

_Verb = Callable[[], Applied]


class ThreadedGripper:
    """A ``Gripper`` whose core is polled by a thread; ``poll`` of this one does no I/O.

    Verbs set intent and wake the thread. While an exchange is in flight, which lasts a timeout on a
    hand that has fallen silent, a verb waits for it for two milliseconds alone. Then the thread
    does the verb once the exchange is over, unless another is given before, and what was asked is
    returned, with a note, since what could really be applied is not known yet; ``poll`` raises a
    refusal of it. ``activate`` alone waits.
    """

    def __init__(
        self,
        core: RobotiqDriver,
        period_s: float,
        *,
        write_interval_s: float = 0.01,
        close: Callable[[], None] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """``write_interval_s`` and ``clock`` are those of the core: a command that it holds back is
        sent as soon as it may be. ``close`` lets go of the connection after the last poll."""
        self._core = core
        self._close = close
        self._clock = clock
        self._period_ns = round(period_s * 1e9)
        self._interval_ns = round(write_interval_s * 1e9)
        self._lock = threading.Lock()  # guards the core
        self._wake = threading.Event()
        self._refreshed = threading.Event()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._state: GripperState | None = core.state
        self._errors: list[GraspError] = []
        self._bugs: list[BaseException] = []
        self._ended = False  # by too many of them
        self._lost = False
        self._fallback: tuple[Callable[[Gripper], Applied], str] | None = None
        self._fell_back = False
        self._polled_ns = 0
        self._commanded_ns: int | None = None  # oldest verb whose write is not acknowledged
        self._put_off: tuple[int, _Verb] | None = None  # until the exchange in flight is over
        self._slot = threading.Lock()  # of what is put off; held for no longer than it takes
        self._written_ns = 0  # time of the poll that wrote last
        self.polls = 0  # exchanges so far
        self._acknowledged: deque[tuple[int, int]] = deque(maxlen=_ACKNOWLEDGEMENTS_KEPT)

    # Life

    def start(self, within_s: float = _JOIN_S) -> None:
        """Start polling; returns after the first exchange, answered or not."""
        if self._thread is not None:
            return
        self._stopping.clear()
        self._refreshed.clear()
        self._put_off = None  # given to the thread before, and not sent by it
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()
        self._refreshed.wait(within_s)

    def stop(self) -> None:
        """End the thread; what was commanded and not yet sent stays unsent."""
        thread = self._thread
        if thread is None:
            return
        self._stopping.set()
        self._wake.set()
        thread.join(_JOIN_S)
        if thread.is_alive():
            told = f"the gripper's thread did not end within {_JOIN_S:g} s"
            raise LinkLost(told, "an exchange hangs: check the timeout of the link")
        self._thread = None

    def close(self) -> None:
        """Stop, and let go of the connection."""
        self.stop()
        if self._close is not None:
            self._close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # What is known

    @property
    def state(self) -> GripperState | None:
        """Latest snapshot, without waiting for anything; not fresh while a verb is put off."""
        state = self._state
        if state is not None and state.fresh and self._put_off is not None:
            return msgspec.structs.replace(state, fresh=False)
        return state

    @property
    def least_force_n(self) -> float:
        """Calibrated static force of the smallest force setting, N."""
        return self._core.least_force_n

    @property
    def m_per_count(self) -> float:
        """Fingertip travel of one motor count, m."""
        return self._core.m_per_count

    @property
    def mode(self) -> int:
        """That the hand was taken over in."""
        return self._core.mode

    @property
    def acknowledged(self) -> bool:
        """Whether the gripper has answered the write of everything that was asked for."""
        return self._commanded_ns is None and self._put_off is None

    @property
    def acknowledgements_ns(self) -> tuple[tuple[int, int], ...]:
        """Latest pairs of times, of a verb and of the reply to its write, oldest first."""
        return tuple(self._acknowledged.copy())

    def poll(self, now_ns: int) -> None:
        """Raise what the thread met since the last call, each error once; no I/O.

        A link that stays lost is one error. After a bug in the core the thread goes on, so that a
        hand can still be made safe; three in a row end it, and every call raises the last.
        """
        self._polled()
        if self._bugs:
            raise self._bugs[0] if self._ended else self._bugs.pop(0)
        if self._errors:
            raise self._errors.pop(0)

    def set_fallback(self, command: Callable[[Gripper], Applied] | None, words: str = "") -> None:
        """Set the command that this thread sends by itself when neither ``poll`` nor a verb is
        called for a second: the program hangs. ``words`` go into the log."""
        self._fallback = None if command is None else (command, words)
        self._polled()

    def _polled(self) -> None:
        self._polled_ns, self._fell_back = self._clock(), False

    # Verbs

    def activate(self, dropping: bool = False) -> Applied:
        self._polled()
        called_ns = self._clock()
        with self._lock:
            self._put_off = None
            return self._do(called_ns, lambda: self._core.activate(dropping))

    def open(self, speed_mps: float) -> Applied:
        asked = Applied((0, 0, 0), speed_mps, self.least_force_n, note=_NOT_YET)
        return self._command(lambda: self._core.open(speed_mps), asked)

    def move_to(self, targets_counts: Counts3, speed_mps: float, force_n: float) -> Applied:
        asked = Applied(targets_counts, speed_mps, force_n, note=_NOT_YET)
        return self._command(lambda: self._core.move_to(targets_counts, speed_mps, force_n), asked)

    def close_fast(
        self,
        force_cap_n: float,
        closing: tuple[bool, bool, bool],
        limits_counts: Counts3,
        speed_mps: float,
    ) -> Applied:
        targets = closing_targets(closing, limits_counts, self._here)
        asked = Applied(targets, speed_mps, force_cap_n, note=_NOT_YET)
        return self._command(
            lambda: self._core.close_fast(force_cap_n, closing, limits_counts, speed_mps), asked
        )

    def hold(self) -> Applied:
        asked = Applied(self._here, 0.0, self.least_force_n, note=_NOT_YET)
        return self._command(self._core.hold, asked)

    @property
    def _here(self) -> Counts3:
        """Last known finger positions."""
        return (0, 0, 0) if self._state is None else self._state.positions

    def _command(self, verb: _Verb, asked: Applied) -> Applied:
        self._polled()
        called_ns = self._clock()
        if self._ended:
            told = "nothing reaches the gripper: its thread has met too many bugs in a row"
            raise LinkLost(told, "connect again, and report the bugs")
        if self._lock.acquire(timeout=_PATIENCE_S):
            try:
                self._put_off = None
                return self._do(called_ns, verb)
            finally:
                self._lock.release()
        with self._slot:
            self._put_off = called_ns, verb
        self._wake.set()
        return asked

    def _do(self, called_ns: int, verb: _Verb) -> Applied:
        """Who does it has the lock."""
        answer = verb()
        self._state = self._core.state  # no longer fresh
        if self._commanded_ns is None:
            self._commanded_ns = called_ns
        self._wake.set()
        return answer

    # Thread

    def _run(self) -> None:
        tick_ns, met = self._clock(), 0
        while not self._stopping.is_set() and met < _MOST_BUGS:
            try:
                self._wait_until(tick_ns)
                if self._stopping.is_set():
                    return
                now_ns = self._clock()
                self._exchange(now_ns)
                tick_ns, met = self._next_tick(tick_ns, now_ns), 0
            except BaseException as bug:  # in a thread of its own nobody else is told of it
                met += 1
                self._ended = met == _MOST_BUGS  # before it is told
                self._bugs.append(bug)
                self._refreshed.set()
                self._stopping.wait(_AFTER_BUG_S)

    def _wait_until(self, tick_ns: int) -> None:
        """Until then, until a command that is held back may be sent, or until a verb is called."""
        if self._commanded_ns is not None:
            tick_ns = min(tick_ns, self._written_ns + self._interval_ns)
        self._wake.wait(max(0, tick_ns - self._clock()) / _NS)
        self._wake.clear()

    def _next_tick(self, tick_ns: int, now_ns: int) -> int:
        """The first tick after now: ticks that passed meanwhile are missed, not made up for."""
        passed = (now_ns - tick_ns) // self._period_ns + 1
        return tick_ns + max(0, passed) * self._period_ns

    def _exchange(self, now_ns: int) -> None:
        with self._lock:
            self._catch_up()
            self._fall_back(now_ns)
            try:
                self._core.poll(now_ns)
                self._lost = False
            except LinkLost as error:
                if not self._lost:
                    self._note(error)
                self._lost, self._fell_back = True, False  # the fallback command may be lost too
            except GraspError as error:
                self._note(error)
                self._lost = False
            self._state = self._core.state
            self._settle(now_ns)
            self._catch_up()
        self.polls += 1
        self._refreshed.set()

    def _catch_up(self) -> None:
        """Do the verb that was put off, whose caller has long gone on."""
        put_off = self._put_off
        if put_off is None:
            return
        try:
            self._do(*put_off)
        except GraspError as error:
            self._note(error)
        finally:
            with self._slot:  # one that came between question and answer would be lost
                if self._put_off is put_off:
                    self._put_off = None

    def _fall_back(self, now_ns: int) -> None:
        """Send the fallback command, once, if the last poll is too long ago. Needs the lock."""
        fallback = self._fallback
        unpolled_ns = now_ns - self._polled_ns
        if fallback is None or self._fell_back or self._lost or unpolled_ns < _UNPOLLED_NS:
            return
        command, words = fallback
        self._fell_back = True
        try:
            self._do(now_ns, lambda: command(self._core))
        except GraspError as error:
            self._note(error)
            words = f"cannot {words}: {error.message}"
        # a blocked terminal must not stop the exchange with the hand
        text = f"no control step for {_UNPOLLED_NS / _NS:g} s; the gripper acts by itself: {words}"
        threading.Thread(target=_LOG.warning, args=(f"grasp: {text}",), daemon=True).start()

    def _note(self, error: GraspError) -> None:
        if len(self._errors) < _ERRORS_KEPT:
            self._errors.append(error)

    def _settle(self, now_ns: int) -> None:
        """Whether the command that waits was acknowledged, has nothing to send, or still waits."""
        acknowledged_ns = self._core.acknowledged_ns
        if acknowledged_ns >= now_ns:
            self._written_ns = now_ns
            if self._commanded_ns is not None:
                self._acknowledged.append((self._commanded_ns, acknowledged_ns))
        elif not self._lost and now_ns - self._written_ns < self._interval_ns:
            return
        self._commanded_ns = None
