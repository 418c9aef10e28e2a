"""What fingertips felt some time ago is not taken for what they feel."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.errors import Stale
from scenarios.lab.fingertips import Touch

TICK_NS = 10_000_000


def tips(frames: list[int]) -> Any:
    """A driver whose number of frames is given, tick by tick."""
    left = iter(frames)
    driver = SimpleNamespace(
        statistics=SimpleNamespace(frames=0), latest_raw=np.full((3, 6), 440, np.int16)
    )

    def poll(now_ns: int) -> None:
        driver.statistics.frames = next(left)

    driver.poll = poll
    return driver


def test_fingertips_that_fall_silent_are_stale_and_a_few_lost_frames_are_not() -> None:
    touch = Touch(tips([1, 1, 2, 2, 2, 2, 2, 2, 2]), None, stale_ns=5 * TICK_NS)
    for tick in range(1, 9):
        touch.poll(tick * TICK_NS)
    with pytest.raises(Stale, match="no frame for 60 ms"):
        touch.poll(9 * TICK_NS)


def test_counts_are_below_the_rest_and_unknown_without_one() -> None:
    rest = np.full((3, 6), 450, np.int16)
    assert Touch(tips([]), rest, TICK_NS).counts_sum == (-60.0, -60.0, -60.0)
    assert Touch(tips([]), None, TICK_NS).counts_sum is None
