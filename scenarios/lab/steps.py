"""A motion of the hand as short steps, each told once the last one is seen: whoever's link freezes
leaves the fingers with no more than one of them to go.

A step is told before the last one ends, so that fingers do not stop in between: a hand may override
its force whenever it starts (`hand.override_s`).
"""

from collections.abc import Callable

from drivers.errors import DeviceFault, SuppressAll
from drivers.interfaces import PERIOD_NS, Counts3, Detection, FingerState, GripperState
from grasp import signals
from grasp.clock import Clock

TRIES = 3
LONG_NS = 1_000_000_000


def insist(action: Callable[[], None], clock: Clock) -> bool:
    """Whether it was done; raises nothing."""
    begun_ns = clock.now_ns
    for _ in range(TRIES):
        with SuppressAll():
            action()
            return True
        if clock.now_ns - begun_ns > LONG_NS:
            break
        with SuppressAll():
            clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
    return False


LEAD_M = 0.004  # that a finger is told to go further than it is seen to be
STEP_S = 5.0  # within which a step is seen to be made; assumed, at least speed it takes 0.2 s
AT_REST = 2  # looks in a row


def lead_counts(m_per_count: float) -> int:
    """The longest step in whole counts, one at least."""
    return max(1, int(LEAD_M / m_per_count + 1e-9))


class Steps:
    """From where the fingers are to where they shall be."""

    def __init__(self, at: Counts3, targets: Counts3, most_counts: int) -> None:
        self.told = at
        self._targets, self._most = targets, most_counts

    def next(self, state: GripperState) -> Counts3 | None:
        """What is to be told now; None: nothing yet, or nothing more. A finger that has met
        something is told to go no further."""
        if not state.fresh:  # it may speak of the step before
            return None
        a, b, c = map(self._ahead, state.fingers, self.told, self._targets)
        if (a, b, c) == self.told:
            return None
        self.told = a, b, c
        return self.told

    def _ahead(self, finger: FingerState, told: int, target: int) -> int:
        here, met = finger.position_counts, finger.detection
        if target > told and met is not Detection.CONTACT_CLOSING:
            return max(told, min(target, here + self._most))
        if target < told and met is not Detection.CONTACT_OPENING:
            return min(told, max(target, here - self._most))
        return told


def walk(
    steps: Steps, clock: Clock, state: Callable[[], GripperState],
    tell: Callable[[Counts3], None], look: Callable[[], bool],
) -> None:  # fmt: skip
    """Tell step after step until the fingers rest and nothing more is to be told. ``look`` lets a
    moment pass, and says whether to go on; where not, it has made the fingers stand.

    Raises DeviceFault where a step is not seen to end in time, Interruption, and what they raise.
    """
    end_ns = clock.now_ns + round(STEP_S * 1e9)
    rested, on = 0, True
    while clock.now_ns < end_ns:
        signals.check()
        if on and (targets := steps.next(state())) is not None:
            tell(targets)
            rested, end_ns = 0, clock.now_ns + round(STEP_S * 1e9)
        on = look() and on
        rested = rested + 1 if state().at_rest else 0
        if rested >= AT_REST:
            return
    raise DeviceFault(f"the fingers did not come to rest within {STEP_S:g} s", "look at the hand")
