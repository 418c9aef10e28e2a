"""A motion of the hand as short steps, each sent once the last one is seen: a link that freezes
leaves the fingers no more than one step to go.

A step is sent before the last one ends, so that fingers do not stop in between: a hand may override
its force whenever it starts (`hand.override_s`).
"""

from collections.abc import Callable

from drivers.errors import DeviceFault, SuppressAll
from drivers.interfaces import PERIOD_NS, Counts3, Detection, FingerState, GripperState
from grasp import signals
from grasp.clock import Clock

LEAD_M = 0.004  # a finger is sent at most so far beyond where it is seen to be
STEP_S = 5.0  # within which a step is seen to end; assumed, at least speed it takes 0.2 s
AT_REST = 2  # looks in a row
TRIES, TRY_FOR_NS = 3, 1_000_000_000


def retry(action: Callable[[], None], clock: Clock) -> bool:
    """Whether it was done within a few tries; raises nothing."""
    begun_ns = clock.now_ns
    for _ in range(TRIES):
        with SuppressAll():
            action()
            return True
        if clock.now_ns - begun_ns > TRY_FOR_NS:
            break
        with SuppressAll():
            clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
    return False


def lead_counts(m_per_count: float) -> int:
    """The longest step in whole counts, one at least."""
    return max(1, int(LEAD_M / m_per_count + 1e-9))


class Steps:
    """From where the fingers are to where they shall be."""

    def __init__(self, at: Counts3, targets: Counts3, most_counts: int) -> None:
        self._sent = at
        self._targets, self._most = targets, most_counts

    def next(self, state: GripperState) -> Counts3 | None:
        """What to send now; None: nothing yet, or nothing more. A finger that has met something is
        sent no further."""
        if not state.fresh:  # it may still describe the step before
            return None
        a, b, c = map(self._ahead, state.fingers, self._sent, self._targets)
        if (a, b, c) == self._sent:
            return None
        self._sent = a, b, c
        return self._sent

    def _ahead(self, finger: FingerState, sent: int, target: int) -> int:
        here, met = finger.position_counts, finger.detection
        if target > sent and met is not Detection.CONTACT_CLOSING:
            return max(sent, min(target, here + self._most))
        if target < sent and met is not Detection.CONTACT_OPENING:
            return min(sent, max(target, here - self._most))
        return sent


def until_rest(
    clock: Clock, state: Callable[[], GripperState], look: Callable[[], bool],
    step: Callable[[], bool] = lambda: False, within_s: float = STEP_S,
) -> None:  # fmt: skip
    """Send step after step until the fingers rest. ``step`` sends the next one, if there is one to
    send; ``look`` lets a moment pass and returns whether to go on (where not, it has made the
    fingers stop).

    Raises DeviceFault where a step is not seen to end in time, Interruption, and what they raise.
    """
    end_ns = clock.now_ns + round(within_s * 1e9)
    rested, on = 0, True
    while clock.now_ns < end_ns:
        signals.check()
        if on and step():
            rested, end_ns = 0, clock.now_ns + round(within_s * 1e9)
        on = look() and on
        rested = rested + 1 if state().at_rest else 0
        if rested >= AT_REST:
            return
    raise DeviceFault(f"the fingers did not come to rest within {within_s:g} s", "look at the hand")
