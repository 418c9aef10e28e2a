"""Clocks. Only this module and device threads read a real one; elsewhere time is an argument."""

import time
from collections.abc import Callable
from typing import Protocol

stopwatch_ns = time.perf_counter_ns
VIRTUAL_EPOCH_NS = 946_684_800_000_000_000  # 2000-01-01T00:00:00Z: when virtual time is 0


class Clock(Protocol):
    """Monotonic time in integer nanoseconds. ``virtual``: time does not pass during computation.
    ``unix_ns``: Unix time in nanoseconds at which this clock was 0."""

    @property
    def virtual(self) -> bool: ...

    @property
    def unix_ns(self) -> int: ...

    @property
    def now_ns(self) -> int: ...

    def sleep_until_ns(self, t_ns: int) -> None: ...


class WallClock:
    """The machine's monotonic clock minus ``epoch_ns``."""

    virtual = False

    def __init__(self, epoch_ns: int = 0) -> None:
        self._epoch_ns = epoch_ns
        self.unix_ns = time.time_ns() - self.now_ns

    @property
    def now_ns(self) -> int:
        return time.monotonic_ns() - self._epoch_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        remaining_ns = t_ns - self.now_ns
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)


class VirtualClock:
    """Time that passes only in ``sleep_until_ns``, which advances the simulated world."""

    virtual = True
    unix_ns = VIRTUAL_EPOCH_NS

    def __init__(self, advance_world: Callable[[int], None], start_ns: int = 0) -> None:
        self._advance_world = advance_world
        self.now_ns = start_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        if t_ns > self.now_ns:
            self._advance_world(t_ns)
            self.now_ns = t_ns


class PacedClock(VirtualClock):
    """Virtual time slowed down to wall time, so that a person can watch; equal results."""

    def __init__(self, advance_world: Callable[[int], None], start_ns: int = 0) -> None:
        super().__init__(advance_world, start_ns)
        self._ahead_ns: int | None = None

    def sleep_until_ns(self, t_ns: int) -> None:
        super().sleep_until_ns(t_ns)
        wall_ns = time.monotonic_ns()
        if self._ahead_ns is None:
            self._ahead_ns = wall_ns - t_ns
        early_s = (t_ns + self._ahead_ns - wall_ns) * 1e-9
        if early_s > 0:
            time.sleep(early_s)


class Deadlines:
    """Deadlines one period apart, from ``start_ns`` on. Missed ones are counted in ``missed`` and
    never made up in a burst. A controller calls ``skip_missed`` after waiting, to continue at
    once; a sampler calls it before waiting, to stay in phase."""

    def __init__(self, start_ns: int, period_ns: int) -> None:
        self.missed = 0
        self._period_ns = period_ns
        self.last_ns = start_ns

    def next_ns(self) -> int:
        self.last_ns += self._period_ns
        return self.last_ns

    def skip_missed(self, now_ns: int) -> None:
        """Skip the deadlines between the last one and now."""
        passed = max((now_ns - self.last_ns) // self._period_ns, 0)
        self.missed += passed
        self.last_ns += passed * self._period_ns
