"""Thread that polls the gripper driver in wall time; a ``Gripper`` whose ``poll`` does no I/O."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
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
_MAX_BUGS: Final = 3  # unexpected exceptions in a row that end the thread
_AFTER_BUG_S: Final = 0.01
_LOCK_WAIT_S: Final = 0.002  # longest wait of a verb for an exchange: most are over by then
# Time without a poll after which the program is taken to hang. By then the heartbeat (0.15 s) has
# braked the arm, and a step this late ends the run in a fault (monitors.standstill_s).
_HANG_NS: Final = 1_000_000_000
# The thread reads this long before the next poll is expected, so that a poll finds a recent status
# and a command after it waits for no exchange. Assumed: most exchanges take less.
_LEAD_NS: Final = 3_000_000
_DEFERRED_NOTE = "the hand has not replied yet: the command is sent as soon as it has"

_LOG = logging.getLogger(__name__)

_Verb = Callable[[], Applied]


def next_tick_ns(tick_ns: int, polled_ns: int | None, period_ns: int, now_ns: int) -> int:
    """Time of the thread's next exchange, at least half a period from now. Ticks are whole periods
    apart, and ``_LEAD_NS`` before the caller's polls once it polls (``polled_ns``)."""
    if polled_ns is not None:
        tick_ns = polled_ns - _LEAD_NS
    periods = (now_ns + period_ns // 2 - tick_ns) // period_ns + 1
    return tick_ns + periods * period_ns


class ThreadedGripper:
    """A ``Gripper`` whose core is polled by a thread; ``poll`` of this one does no I/O.

    Verbs set intent and wake the thread. An exchange lasts up to the timeout when the hand does not
    reply, and a verb waits for it for two milliseconds at most. After that the verb is deferred:
    the thread executes it when the exchange is over, unless another verb replaces it. A deferred
    verb returns what was requested, with a note, since what is applied is not known yet; ``poll``
    raises its refusal. Only ``activate`` waits for the exchange.
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
        """``write_interval_s`` and ``clock`` are those of the core; a delayed command is sent when
        the interval is over. ``close`` closes the connection after the last poll."""
        self._core = core
        self._close = close
        self._clock = clock
        self._period_ns = round(period_s * 1e9)
        self._interval_ns = round(write_interval_s * 1e9)
        self._lock = threading.Lock()  # guards the core
        self._wake: SimpleQueue[None] = SimpleQueue()  # ends the thread's wait for its next tick
        self._refreshed = threading.Event()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._state: GripperState | None = core.state
        self._errors: list[GraspError] = []
        self._bugs: list[BaseException] = []
        self._thread_ended = False  # by too many bugs
        self._lost = False
        self._fallback: tuple[Callable[[Gripper], Applied], str] | None = None
        self._fallback_sent = False
        self._polled_ns = 0
        self._poll_ns: int | None = None  # time given with the last ``poll``
        self._commanded_ns: int | None = None  # oldest verb whose write is not acknowledged
        self._deferred: tuple[int, _Verb] | None = None  # until the exchange in flight is over
        self._deferred_lock = threading.Lock()  # guards ``_deferred``; never held for long
        self._written_ns = 0  # time of the poll that wrote last
        self.polls = 0  # exchanges so far
        self._acknowledged: deque[tuple[int, int]] = deque(maxlen=_ACKNOWLEDGEMENTS_KEPT)

    # Start and stop

    def start(self, within_s: float = _JOIN_S) -> None:
        """Start polling; returns after the first exchange, successful or not."""
        if self._thread is not None:
            return
        self._stopping.clear()
        self._refreshed.clear()
        self._deferred = None  # from before the last stop
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()
        self._refreshed.wait(within_s)

    def stop(self) -> None:
        """End the thread; commands that were not sent yet are dropped."""
        thread = self._thread
        if thread is None:
            return
        self._stopping.set()
        self._wake.put(None)
        thread.join(_JOIN_S)
        if thread.is_alive():
            message = f"the gripper's thread did not end within {_JOIN_S:g} s"
            raise LinkLost(message, "an exchange hangs: check the timeout of the link")
        self._thread = None

    def close(self) -> None:
        """Stop, and close the connection."""
        self.stop()
        if self._close is not None:
            self._close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # State

    @property
    def state(self) -> GripperState | None:
        """Latest snapshot, without waiting; not fresh while a verb is deferred."""
        state = self._state
        if state is not None and state.fresh and self._deferred is not None:
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
        """Grasping mode (rMOD) of the hand at connection."""
        return self._core.mode

    @property
    def acknowledged(self) -> bool:
        """Whether the gripper has acknowledged the write of everything requested."""
        return self._commanded_ns is None and self._deferred is None

    @property
    def acknowledgements_ns(self) -> tuple[tuple[int, int], ...]:
        """Latest pairs of times: a verb, and the acknowledgement of its write; oldest first."""
        return tuple(self._acknowledged.copy())

    def poll(self, now_ns: int) -> None:
        """Raise the thread's errors since the last call, each once; no I/O.

        A link that stays lost is one error. After an unexpected exception the thread continues, so
        that the hand can still be made safe. Three in a row end it, and every call then raises the
        oldest one that was not raised before.
        """
        self._mark_polled()
        self._poll_ns = now_ns
        if self._bugs:
            raise self._bugs[0] if self._thread_ended else self._bugs.pop(0)
        if self._errors:
            raise self._errors.pop(0)

    def set_fallback(self, command: Callable[[Gripper], Applied] | None, text: str = "") -> None:
        """Set the command that this thread sends by itself when the program hangs, that is when
        neither ``poll`` nor a verb is called for a second. ``text`` describes it in the log."""
        self._fallback = None if command is None else (command, text)
        self._mark_polled()

    def _mark_polled(self) -> None:
        self._polled_ns, self._fallback_sent = self._clock(), False

    # Verbs

    def activate(self, dropping: bool = False) -> Applied:
        self._mark_polled()
        called_ns = self._clock()
        with self._lock:
            self._deferred = None
            return self._execute(called_ns, lambda: self._core.activate(dropping))

    def open(self, speed_mps: float) -> Applied:
        request = Applied((0, 0, 0), speed_mps, self.least_force_n, note=_DEFERRED_NOTE)
        return self._command(lambda: self._core.open(speed_mps), request)

    def move_to(self, targets_counts: Counts3, speed_mps: float, force_n: float) -> Applied:
        request = Applied(targets_counts, speed_mps, force_n, note=_DEFERRED_NOTE)
        return self._command(
            lambda: self._core.move_to(targets_counts, speed_mps, force_n), request
        )

    def close_to_limit(
        self,
        force_limit_n: float,
        closing: tuple[bool, bool, bool],
        ends_counts: Counts3,
        speed_mps: float,
    ) -> Applied:
        targets = closing_targets(closing, ends_counts, self._positions)
        request = Applied(targets, speed_mps, force_limit_n, note=_DEFERRED_NOTE)
        limits = force_limit_n, closing, ends_counts, speed_mps
        return self._command(lambda: self._core.close_to_limit(*limits), request)

    def hold(self) -> Applied:
        request = Applied(self._positions, 0.0, self.least_force_n, note=_DEFERRED_NOTE)
        return self._command(self._core.hold, request)

    @property
    def _positions(self) -> Counts3:
        """Last known finger positions."""
        return (0, 0, 0) if self._state is None else self._state.positions

    def _command(self, verb: _Verb, request: Applied) -> Applied:
        self._mark_polled()
        called_ns = self._clock()
        if self._thread_ended:
            message = "no command reaches the gripper: its thread ended after repeated exceptions"
            raise LinkLost(message, "connect again, and report the exceptions as bugs")
        if self._lock.acquire(timeout=_LOCK_WAIT_S):
            try:
                self._deferred = None
                return self._execute(called_ns, verb)
            finally:
                self._lock.release()
        with self._deferred_lock:
            self._deferred = called_ns, verb
        self._wake.put(None)
        return request

    def _execute(self, called_ns: int, verb: _Verb) -> Applied:
        """Execute a verb; the caller holds the lock."""
        applied = verb()
        self._state = self._core.state  # no longer fresh
        if self._commanded_ns is None:
            self._commanded_ns = called_ns
        self._wake.put(None)
        return applied

    # Thread

    def _run(self) -> None:
        tick_ns, bugs = self._clock(), 0
        while not self._stopping.is_set() and bugs < _MAX_BUGS:
            try:
                self._wait_until(tick_ns)
                if self._stopping.is_set():
                    return
                now_ns = self._clock()
                self._exchange(now_ns)
                tick_ns = next_tick_ns(tick_ns, self._poll_ns, self._period_ns, now_ns)
                bugs = 0
            except BaseException as bug:  # ``poll`` raises it in the caller's thread
                bugs += 1
                self._thread_ended = bugs == _MAX_BUGS  # set before the bug can be raised
                self._bugs.append(bug)
                self._refreshed.set()
                self._stopping.wait(_AFTER_BUG_S)

    def _wait_until(self, tick_ns: int) -> None:
        """Wait until the tick, until a delayed command may be sent, or until a verb is called."""
        if self._commanded_ns is not None:
            tick_ns = min(tick_ns, self._written_ns + self._interval_ns)
        with suppress(Empty):
            self._wake.get(timeout=max(0, tick_ns - self._clock()) / _NS)
            while True:  # one exchange serves all verbs so far
                self._wake.get_nowait()

    def _exchange(self, now_ns: int) -> None:
        with self._lock:
            self._execute_deferred()
            self._send_fallback(now_ns)
            try:
                self._core.poll(now_ns)
                self._lost = False
            except LinkLost as error:
                if not self._lost:
                    self._keep_error(error)
                self._lost, self._fallback_sent = (
                    True,
                    False,
                )  # the fallback command may be lost too
            except GraspError as error:
                self._keep_error(error)
                self._lost = False
            self._state = self._core.state
            self._update_acknowledged(now_ns)
            self._execute_deferred()
        self.polls += 1
        self._refreshed.set()

    def _execute_deferred(self) -> None:
        """Execute the deferred verb."""
        deferred = self._deferred
        if deferred is None:
            return
        try:
            self._execute(*deferred)
        except GraspError as error:
            self._keep_error(error)
        finally:
            with self._deferred_lock:  # keeps a verb that was deferred in the meantime
                if self._deferred is deferred:
                    self._deferred = None

    def _send_fallback(self, now_ns: int) -> None:
        """Send the fallback command, once, if the last poll is too long ago. The caller holds the
        lock."""
        fallback = self._fallback
        unpolled_ns = now_ns - self._polled_ns
        if fallback is None or self._fallback_sent or self._lost or unpolled_ns < _HANG_NS:
            return
        command, text = fallback
        self._fallback_sent = True
        try:
            self._execute(now_ns, lambda: command(self._core))
        except GraspError as error:
            self._keep_error(error)
            text = f"cannot {text}: {error.message}"
        warning = f"no control step for {_HANG_NS / _NS:g} s; the gripper acts by itself: {text}"
        # in its own thread, since a blocked terminal must not stop the exchange with the hand
        threading.Thread(target=_LOG.warning, args=(f"grasp: {warning}",), daemon=True).start()

    def _keep_error(self, error: GraspError) -> None:
        if len(self._errors) < _ERRORS_KEPT:
            self._errors.append(error)

    def _update_acknowledged(self, now_ns: int) -> None:
        """Note the acknowledgement of the pending command, or that it needed no write."""
        acknowledged_ns = self._core.acknowledged_ns
        if acknowledged_ns >= now_ns:
            self._written_ns = now_ns
            if self._commanded_ns is not None:
                self._acknowledged.append((self._commanded_ns, acknowledged_ns))
        elif not self._lost and now_ns - self._written_ns < self._interval_ns:
            return
        self._commanded_ns = None
