"""A gripper core under its thread, on a clock that a test advances."""

import threading
from collections.abc import Callable
from typing import Any

from drivers.errors import Refused
from drivers.robotiq.link import ThreadedGripper

MS = 1_000_000
NEVER_S = 600.0
FOR_EVER_S = 3600.0  # timeout of waits that end by themselves
BEGIN_NS = 10**12


class Cell:
    """Driver core, its transport and their clock, which only a test advances."""

    least_force_n = 10.0
    m_per_count = 0.00077
    mode = 0

    def __init__(self) -> None:
        self.now_ns = BEGIN_NS
        self.acknowledged_ns = 0
        self.state: Any = None
        self.polled_ns: list[int] = []
        self.verbs: list[tuple[object, ...]] = []
        self.actions: list[Callable[[], None]] = []  # one a poll
        self.refuses = False
        self.writes_from_ns = 1 << 62
        self._polled = threading.Semaphore(0)

    def clock(self) -> int:
        return self.now_ns

    def poll(self, now_ns: int) -> None:
        self.polled_ns.append(now_ns)
        self._polled.release()
        if self.actions:
            self.actions.pop(0)()
        if now_ns >= self.writes_from_ns:
            self.acknowledges()

    def __getattr__(self, name: str) -> Any:
        def verb(*arguments: object) -> str:
            self.verbs.append((name, *arguments))
            if self.refuses:
                raise Refused("not so", "otherwise")
            return f"applied {name}"

        return verb

    def passes(self, ns: int) -> None:
        self.now_ns += ns

    def acknowledges(self) -> None:
        """Acknowledge the write, 3 ms after it began."""
        self.now_ns += 3 * MS
        self.acknowledged_ns = self.now_ns

    def wait(self) -> None:
        until(lambda: self._polled.acquire(timeout=0.005))


Made = Callable[..., tuple[Cell, ThreadedGripper]]


def wait_for_polls(gripper: ThreadedGripper, polls: int) -> None:
    """Wait until so many exchanges are complete."""
    until(lambda: gripper.polls >= polls)


def until(true: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(2000):
        if true():
            return
        assert polling(), "the thread has ended"
        pause.wait(0.005)
    raise AssertionError("never")


def polling() -> int:
    """Number of threads that poll a gripper."""
    return [thread.name for thread in threading.enumerate()].count("gripper")


def no_write(cell: Cell) -> None:
    """A poll that takes no time and writes nothing."""
