"""How long the gripper takes to answer: rings of durations and a transport that fills them."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from drivers.robotiq.exchange import RegisterTransport

KEPT: Final = 4096  # latest durations of each kind
_EDGES_US: Final = tuple(2**power for power in range(4, 20))  # 16 us to 0.5 s


class Latency(msgspec.Struct, frozen=True):
    """Durations of one kind: all of them counted, quantiles of the latest ``KEPT``, s."""

    count: int
    p50_s: float
    p99_s: float
    most_s: float
    histogram: dict[int, int]  # latest ones by upper edge, us; the last edge takes all longer ones


class Durations:
    """A bounded ring of durations in nanoseconds, filled by one thread, read by any."""

    def __init__(self) -> None:
        self._latest: deque[int] = deque(maxlen=KEPT)
        self._count = 0

    def add(self, duration_ns: int) -> None:
        self._latest.append(duration_ns)
        self._count += 1

    @property
    def latest_ns(self) -> tuple[int, ...]:
        """Oldest first."""
        return tuple(self._latest.copy())

    def summary(self) -> Latency:
        ordered = sorted(self._latest.copy())
        if not ordered:
            return Latency(0, 0.0, 0.0, 0.0, {})
        last = len(ordered) - 1
        p50, p99, most = (ordered[round(last * q)] * 1e-9 for q in (0.5, 0.99, 1.0))
        return Latency(self._count, p50, p99, most, _histogram(ordered))


def _histogram(durations_ns: Sequence[int]) -> dict[int, int]:
    bins = dict.fromkeys(_EDGES_US, 0)
    for duration in durations_ns:
        edge = next((edge for edge in _EDGES_US if duration <= edge * 1000), _EDGES_US[-1])
        bins[edge] += 1
    return bins


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
