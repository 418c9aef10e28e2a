"""Of what makes a device stand: it is asked for again, whatever is raised.

Not where it has taken long to fail: who stands by is told without delay.
"""

from collections.abc import Callable

from drivers.errors import SuppressAll
from drivers.interfaces import PERIOD_NS
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
