"""Whether a fault is under way, and for how long it has been."""

from typing import Generic, TypeVar

import msgspec

from tests.nightly.faults.cases import RECOVERS_NS, Fault

T = TypeVar("T")
_FOR_EVER = 1 << 62
BLINK_NS = 80_000_000  # a blinking link is gone for so long, and there for so long
BEHIND_NS = 100_000_000  # what is late or slow
FLICKER_NS = 40_000_000  # what flickers says one thing for so long, and then the other


class Struck(msgspec.Struct):
    """One fault from when it struck on."""

    fault: Fault
    since_ns: int
    recovers: bool
    times: int = 0  # commands that it took so far
    took_ns: int = -1  # the last of them

    def on(self, now_ns: int) -> bool:
        """Of a state, a link, the detector: under way at this time."""
        end_ns = self.since_ns + RECOVERS_NS if self.recovers else _FOR_EVER
        return self.since_ns <= now_ns < end_ns

    def flickers(self, now_ns: int) -> bool:
        """Of what does: whether it says the wrong thing at this time."""
        return (now_ns - self.since_ns) // FLICKER_NS % 2 == 0

    def gone(self, now_ns: int) -> bool:
        """Of a link: nothing passes at this time."""
        if not self.on(now_ns) or self.fault.kind == "slow":
            return False
        blink = (now_ns - self.since_ns) // BLINK_NS % 2 == 0
        return self.fault.kind == "cut" or blink

    def takes(self, what: str, now_ns: int) -> bool:
        """Of commands: this one too. One that recovers takes the next alone."""
        if self.fault.what != what or now_ns < self.since_ns or (self.recovers and self.times):
            return False
        self.times += 1
        self.took_ns = now_ns
        return True


class Past(Generic[T]):
    """What was said lately, to be said again later."""

    def __init__(self) -> None:
        self._said: list[tuple[int, T]] = []

    def add(self, now_ns: int, value: T) -> None:
        self._said.append((now_ns, value))
        while len(self._said) > 1 and self._said[1][0] <= now_ns - BEHIND_NS:
            self._said.pop(0)

    def behind(self) -> T:
        """What was said ``BEHIND_NS`` before the last, or the oldest there is."""
        return self._said[0][1]
