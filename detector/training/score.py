"""What is said of a network at one validation, and which of two is kept. Needs no torch."""

import msgspec


class Score(msgspec.Struct, frozen=True):
    """Of one validation; ``delay_ms`` is the least mean delay within a budget of false events
    (`scores.sweep.best`), a mean over half to four times the budget asked for, since one alone
    hangs on single events. Where no rule keeps to one of them, all is missed."""

    delay_ms: float
    loss: float
    accuracy: float

    def better_than(self, other: "Score | None") -> bool:
        """Quicker, misses counted; where that is equal, likelier. Better than none."""
        return other is None or (self.delay_ms, self.loss) < (other.delay_ms, other.loss)
