"""Stale frames and unknown rest codes of the fingertips."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.errors import Stale
from scenarios.lab.fingertips import TactileReader

TICK_NS = 10_000_000


def tips(frames: list[int]) -> Any:
    """Driver whose total number of frames after each tick is given."""
    remaining = iter(frames)
    driver = SimpleNamespace(
        statistics=SimpleNamespace(frames=0), latest_raw=np.full((3, 6), 440, np.int16)
    )

    def poll(now_ns: int) -> None:
        driver.statistics.frames = next(remaining)

    driver.poll = poll
    return driver


def test_reader_is_stale_without_frames_for_too_long_but_not_after_few_lost_frames() -> None:
    reader = TactileReader(tips([1, 1, 2, 2, 2, 2, 2, 2, 2]), None, stale_ns=5 * TICK_NS)
    for tick in range(1, 9):
        reader.poll(tick * TICK_NS)
    with pytest.raises(Stale, match="no frame for 60 ms"):
        reader.poll(9 * TICK_NS)


def test_counts_are_relative_to_the_rest_codes_and_unknown_without_them() -> None:
    rest = np.full((3, 6), 450, np.int16)
    assert TactileReader(tips([]), rest, TICK_NS).counts_sum == (-60.0, -60.0, -60.0)
    assert TactileReader(tips([]), None, TICK_NS).counts_sum is None
