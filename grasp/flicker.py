"""A device that says again and again that it moves and that it stands."""

WITHIN_NS = 1_000_000_000
MOST_FLIPS = 8  # in that time; what is told to move once begins, ends and may settle


class Flicker:
    """Changes between motion and rest of something that was told nothing new meanwhile."""

    def __init__(self) -> None:
        self._flips_ns: list[int] = []
        self._moved: bool | None = None

    def told(self) -> None:
        """It may move for another reason from now on."""
        self._flips_ns.clear()

    def take(self, t_ns: int, moves: bool) -> bool:
        """Whether it has changed more often than anything that moves does."""
        if self._moved is not None and moves is not self._moved:
            self._flips_ns.append(t_ns)
        self._moved = moves
        while self._flips_ns and t_ns - self._flips_ns[0] > WITHIN_NS:
            self._flips_ns.pop(0)
        return len(self._flips_ns) > MOST_FLIPS
