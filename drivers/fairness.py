"""A cap on the clients of an emulator. Times are seconds of any clock."""

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
