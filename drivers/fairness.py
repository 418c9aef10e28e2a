"""Caps on what clients may take of an emulator: so many at a time, so much time for programs.

Times are seconds of any clock.
"""

import math
import time
from collections.abc import Hashable
from typing import Generic, TypeVar

Member = TypeVar("Member", bound=Hashable)

IDLE_S = 5.0  # who has asked nothing for so long makes room where all places are taken


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
    """So much processor time for interruptible work in each period."""

    def __init__(self, part: float = math.inf) -> None:
        self.part = part
        self._until_s = math.inf

    def begin(self, period_s: float) -> None:
        """Grant the share of a period to this thread, from now on."""
        self._until_s = time.thread_time() + self.part * period_s

    def spent(self) -> bool:
        return time.thread_time() >= self._until_s
