"""How long the gripper takes to answer: the latest durations, as they came, and a
transport that fills them."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from drivers.robotiq.exchange import RegisterTransport

KEPT: Final = 4096  # latest durations of each kind


class Durations:
    """A bounded ring of durations in nanoseconds, filled by one thread, read by any."""

    def __init__(self) -> None:
        self._latest: deque[int] = deque(maxlen=KEPT)

    def add(self, duration_ns: int) -> None:
        self._latest.append(duration_ns)

    @property
    def latest_ns(self) -> tuple[int, ...]:
        """Oldest first."""
        return tuple(self._latest.copy())


class TimedTransport:
    """A transport that times another one. A request that fails leaves no duration."""

    def __init__(self, inner: RegisterTransport, clock: Callable[[], int]) -> None:
        """``clock`` gives monotonic nanoseconds."""
        self._inner = inner
        self._clock = clock
        self.writes = Durations()
        self.reads = Durations()
        self.acknowledged_ns: int | None = None  # when the latest write was answered

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None:
        start_ns = self._clock()
        self._inner.write(first_register, registers, now_ns)
        self.acknowledged_ns = self._clock()
        self.writes.add(self.acknowledged_ns - start_ns)

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]:
        start_ns = self._clock()
        registers = self._inner.read(first_register, count, now_ns)
        self.reads.add(self._clock() - start_ns)
        return registers
