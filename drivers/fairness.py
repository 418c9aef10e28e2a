"""What keeps one client of an emulator from starving the others: shares of time, places, slices.

A server does not know who is well-behaved. It serves whoever has used less than its share, and
lets the others wait; their bytes wait in their own sockets. Times are seconds of any clock.
"""

import math
import threading
import time
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Member = TypeVar("Member", bound=Hashable)
Result = TypeVar("Result")

IDLE_S = 5.0  # who has asked nothing for so long makes room where all places are taken
_RECENT_S = 0.1  # who has been served since then counts as one who shares
_BURST_S = 0.01  # of a share, this much at once
_SAVED_S = 5e-3  # of a budget that was not needed, for when it is
_LOOK_EACH = 16  # calls; the processor's clock takes a microsecond to read


class Shares(Generic[Member]):
    """Divides ``part`` of a server's time evenly among those who ask for it.

    What a client has used leaks away at the rate of its share; while more is left than a burst of
    it, the client waits.
    """

    def __init__(self, part: float, burst_s: float = _BURST_S) -> None:
        """``burst_s``: at that rate."""
        self._part, self._burst_s = part, burst_s
        self._used: dict[Member, tuple[float, float]] = {}  # seconds used, as of when
        self._rate, self._counted_s = part, float("-inf")

    def charge(self, member: Member, used_s: float, now_s: float) -> None:
        """The client has been served for so long."""
        self._used[member] = (self._left(member, now_s) + used_s, now_s)

    def wait_s(self, member: Member, now_s: float) -> float:
        """How long the client has to wait before it is served; 0 for one within its share."""
        rate = self._rate_at(now_s)
        return max(0.0, self._left(member, now_s) / rate - self._burst_s)

    def used_s(self, member: Member, now_s: float) -> float:
        """Of late: who has used less goes first."""
        return self._left(member, now_s)

    def forget(self, member: Member) -> None:
        self._used.pop(member, None)

    def _left(self, member: Member, now_s: float) -> float:
        used_s, at_s = self._used.get(member, (0.0, now_s))
        return max(0.0, used_s - (now_s - at_s) * self._rate_at(now_s))

    def _rate_at(self, now_s: float) -> float:
        if now_s - self._counted_s > _BURST_S:
            recent = sum(now_s - at_s < _RECENT_S for _, at_s in self._used.values())
            self._rate, self._counted_s = self._part / max(1, recent), now_s
        return self._rate


class Places(Generic[Member]):
    """At most so many clients at a time. Where all places are taken, a newcomer gets the place of
    whoever has said nothing for longest, once that is ``IDLE_S``."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._heard: dict[Member, float] = {}

    def enter(self, member: Member, now_s: float) -> Member | None:
        """Take a place; returns who loses his for it. Raises OverflowError when there is none."""
        leaves = None
        if len(self._heard) >= self.most:
            leaves = min(self._heard, key=self._heard.__getitem__)
            if now_s - self._heard[leaves] < IDLE_S:
                raise OverflowError(f"too many connections: {self.most} are open")
            del self._heard[leaves]
        self._heard[member] = now_s
        return leaves

    def heard(self, member: Member, now_s: float) -> None:
        if member in self._heard:
            self._heard[member] = now_s

    def leave(self, member: Member) -> None:
        self._heard.pop(member, None)


class Budget:
    """So much of each period for work that can be interrupted; what was overdrawn is paid back.

    It is worked off in slices, between which somebody else has his turn. Times are those of the
    processor: what other processes take is nobody's fault here.
    """

    def __init__(self, part: float = math.inf) -> None:
        self._part = part
        self._left_s = 0.0
        self._until_s = self._slice_until_s = math.inf

    def begin(self, period_s: float) -> None:
        """Grant the share of a period to this thread, from now on."""
        self._left_s = min(_SAVED_S, self._left_s) + self._part * period_s
        self._until_s = self._slice_until_s = time.thread_time() + self._left_s

    def slice(self, seconds: float) -> None:
        """Grant so much of what is left, in place of all of it."""
        self._slice_until_s = min(self._until_s, time.thread_time() + seconds)

    @property
    def left_s(self) -> float:
        """Of the slice."""
        return self._slice_until_s - time.thread_time()

    def use(self, seconds: float) -> None:
        """Another thread has worked on this one's behalf."""
        self._until_s -= seconds
        self._slice_until_s -= seconds

    def spent(self) -> bool:
        """The slice is."""
        return time.thread_time() >= self._slice_until_s

    def over(self) -> bool:
        """All of it is spent."""
        return time.thread_time() >= self._until_s

    def end(self) -> None:
        """No work goes on any more in this period."""
        self._left_s = self._until_s - time.thread_time()


class Allowance:
    """What may be begun of some kind of work: so much at once, and else a part of the time.

    What was used leaks away at that rate. While more is left of it than ``at_once_s`` nothing new
    is begun, for ``longest_s`` at most.
    """

    def __init__(self, part: float, at_once_s: float, longest_s: float) -> None:
        self._part, self._at_once_s, self._longest_s = part, at_once_s, longest_s
        self._used_s = 0.0

    def elapse(self, seconds: float) -> None:
        self._used_s = max(0.0, self._used_s - self._part * seconds)

    def use(self, seconds: float) -> None:
        most_s = self._at_once_s + self._part * self._longest_s
        self._used_s = min(most_s, self._used_s + seconds)

    @property
    def wait_s(self) -> float:
        """Before anything may begin."""
        return max(0.0, self._used_s - self._at_once_s) / self._part


class _Cancelled(BaseException):
    """The work is not wanted any more."""


class Slowly(Generic[Result]):
    """Work in slices: a thread that goes on only while ``go_on`` waits for it.

    ``work`` is given a function to call often, which returns at once or after a pause.
    """

    def __init__(self, work: Callable[[Callable[[], None]], Result]) -> None:
        self._work = work
        self._slice_s = self._since_s = self._until_s = 0.0
        self.worked_s = 0.0  # since it was last told to go on
        self._calls = 0
        self._resumed, self._paused = threading.Semaphore(0), threading.Semaphore(0)
        self._cancelled = False
        self._done: list[Result] = []
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="slowly", daemon=True)
        self._thread.start()

    def go_on(self, seconds: float) -> bool:
        """Work for so long, of the processor's time; True when it is done."""
        self._slice_s, self.worked_s = seconds, 0.0
        if seconds <= 0.0:
            return False
        self._resumed.release()
        self._paused.acquire()
        return bool(self._done) or self._error is not None

    def result(self) -> Result:
        """What the finished work gave; raises what it raised."""
        if self._error is not None:
            raise self._error
        return self._done[0]

    def cancel(self) -> None:
        if self._thread.is_alive():
            self._cancelled = True
            self._resumed.release()
            self._thread.join()

    def _run(self) -> None:
        self._wait()
        try:
            if not self._cancelled:
                self._done.append(self._work(self._breathe))
        except _Cancelled:
            return
        except BaseException as error:  # belongs to whoever asks for the result
            self._error = error
        finally:
            self._pause()

    def _pause(self) -> None:
        self.worked_s = time.thread_time() - self._since_s
        self._paused.release()

    def _wait(self) -> None:
        self._resumed.acquire()
        self._since_s = time.thread_time()
        self._until_s = self._since_s + self._slice_s

    def _breathe(self) -> None:
        self._calls += 1
        if self._calls % _LOOK_EACH or time.thread_time() < self._until_s:
            return
        self._pause()
        self._wait()
        if self._cancelled:
            raise _Cancelled
