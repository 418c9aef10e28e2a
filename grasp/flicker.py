"""A device that says one thing and then another, again and again."""

WITHIN_NS = 1_000_000_000
MOST_FLIPS = 8  # in that time; what is told to move once begins, ends and may settle


class Flicker:
    """Changes in what something says of its motion that was told nothing new meanwhile."""

    def __init__(self) -> None:
        self._flips_ns: list[int] = []
        self._said: int | None = None

    def told(self) -> None:
        """It may move for another reason from now on."""
        self._flips_ns.clear()

    def take(self, t_ns: int, says: int) -> bool:
        """Whether it has changed more often than anything that moves does."""
        if self._said is not None and says != self._said:
            self._flips_ns.append(t_ns)
        self._said = says
        while self._flips_ns and t_ns - self._flips_ns[0] > WITHIN_NS:
            self._flips_ns.pop(0)
        return len(self._flips_ns) > MOST_FLIPS
