"""A gripper's core under its thread, on a clock that stands until it is told to go on."""

import threading
from collections.abc import Callable
from typing import Any

from drivers.errors import Refused
from drivers.robotiq.link import ThreadedGripper

MS = 1_000_000
NEVER_S = 600.0
FOR_EVER_S = 3600.0  # for what is to come by itself
BEGIN_NS = 10**12


class Cell:
    """A core, its transport's stopwatch and the clock of both: nothing passes by itself."""

    least_force_n = 10.0
    m_per_count = 0.00077
    mode = 0

    def __init__(self) -> None:
        self.now_ns = BEGIN_NS
        self.acknowledged_ns = 0
        self.state: Any = None
        self.polled_ns: list[int] = []
        self.verbs: list[tuple[object, ...]] = []
        self.acts: list[Callable[[], None]] = []  # one a poll
        self.refuses = False
        self.writes_from_ns = 1 << 62
        self._polled = threading.Semaphore(0)

    def clock(self) -> int:
        return self.now_ns

    def poll(self, now_ns: int) -> None:
        self.polled_ns.append(now_ns)
        self._polled.release()
        if self.acts:
            self.acts.pop(0)()
        if now_ns >= self.writes_from_ns:
            self.acknowledges()

    def __getattr__(self, name: str) -> Any:
        def act(*asked: object) -> str:
            self.verbs.append((name, *asked))
            if self.refuses:
                raise Refused("not so", "otherwise")
            return f"applied {name}"

        return act

    def passes(self, ns: int) -> None:
        self.now_ns += ns

    def acknowledges(self) -> None:
        """Whatever was written, 3 ms after it was begun."""
        self.now_ns += 3 * MS
        self.acknowledged_ns = self.now_ns

    def wait(self) -> None:
        until(lambda: self._polled.acquire(timeout=0.005))


Made = Callable[..., tuple[Cell, ThreadedGripper]]


def settled(gripper: ThreadedGripper, polls: int) -> None:
    """After so many exchanges, with what follows from them."""
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
    """How many threads there are that poll a gripper."""
    return [thread.name for thread in threading.enumerate()].count("gripper")


def idle(cell: Cell) -> None:
    """A poll that takes no time and writes nothing."""
