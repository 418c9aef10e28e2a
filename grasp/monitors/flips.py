"""A device that reports one thing of its motion and then another, without a new command."""

WITHIN_NS = 1_000_000_000
MOST = 8  # in that time; what is commanded once begins, ends and may settle


class Flips:
    """Changes of a report since the last command."""

    def __init__(self) -> None:
        self._at_ns: list[int] = []
        self._report: object = None

    def clear(self) -> None:
        """What is reported may change for another reason from now on."""
        self._at_ns.clear()

    def update(self, t_ns: int, report: object) -> None:
        """What is reported now."""
        if self._report is not None and report != self._report:
            self._at_ns.append(t_ns)
        self._report = report
        self._at_ns = [at_ns for at_ns in self._at_ns if t_ns - at_ns <= WITHIN_NS]

    @property
    def too_many(self) -> bool:
        return len(self._at_ns) > MOST
