"""Of what makes a device stand: it is asked for again, whatever is raised."""

from collections.abc import Callable

from drivers.errors import SuppressBugs
from drivers.interfaces import PERIOD_NS
from grasp.clock import Clock

TRIES = 3


def insist(action: Callable[[], None], clock: Clock) -> bool:
    """Whether it was done; raises nothing but what Ctrl-C does."""
    for _ in range(TRIES):
        with SuppressBugs():
            action()
            return True
        with SuppressBugs():
            clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
    return False
