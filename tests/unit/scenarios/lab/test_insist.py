"""What makes a device stand is asked for again, whatever is raised."""

from asyncio import CancelledError

import pytest

from drivers.errors import LinkLost
from grasp.clock import VirtualClock
from scenarios.lab.steps import TRIES, insist


@pytest.mark.parametrize(
    "bug", [LinkLost("gone", "look"), ValueError(), SystemExit(0), CancelledError()]
)
def test_what_fails_once_is_asked_for_again(bug: BaseException) -> None:
    asked: list[int] = []
    clock = VirtualClock(lambda t_ns: None)

    def fails_once() -> None:
        asked.append(clock.now_ns)
        if len(asked) == 1:
            raise bug

    assert insist(fails_once, clock)
    assert len(asked) == 2 and asked[1] > asked[0]


def test_what_fails_for_ever_is_given_up() -> None:
    asked: list[int] = []

    def fails() -> None:
        asked.append(1)
        raise ZeroDivisionError

    assert not insist(fails, VirtualClock(lambda t_ns: None))
    assert len(asked) == TRIES
