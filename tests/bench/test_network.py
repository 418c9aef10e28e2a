"""What an update costs: streaming against the full window, one runtime, one run; memory at rest.

Memory is read on the way: what comes at the start is no growth. Fewer steps: STEPS=200000.
"""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from detector.network import run_network
from detector.network_file import packaged_networks, read_network, weights_path
from detector.scores.quantiles import quantile
from tests.unit.detector.network_files import walk

UPDATES = 5_000
WARM_UP, EVERY, STEPS = 20_000, 100_000, int(os.environ.get("STEPS", "1_000_000"))
MOST_KB = 100  # that memory may grow by after the first steps; a float kept of each is 8,000


def microseconds(update: Callable[[int], object], times: int) -> np.ndarray:
    spent = np.empty(times)
    for i in range(times):
        start = time.thread_time_ns()
        update(i)
        spent[i] = (time.thread_time_ns() - start) * 1e-3
    return spent


@pytest.mark.bench
def test_streaming_against_a_whole_window_for_three_fingers() -> None:
    counts = walk(UPDATES)
    cost = {}
    for name in ("tcn", "gru", "tcn-paper"):
        detector = run_network(read_network(weights_path(name)), 3)
        microseconds(lambda i, d=detector: d.update(counts[i]), 500)  # type: ignore[misc]
        spent = np.sort(microseconds(lambda i, d=detector: d.update(counts[i]), UPDATES))  # type: ignore[misc]
        cost[name] = quantile(spent, 0.5)
        print(f"\n{name}: {cost[name]:.0f} us p50, {quantile(spent, 0.99):.0f} p99 of the "
              "thread's time", end="")  # fmt: skip
    ratio = cost["tcn-paper"] / cost["tcn"]
    print(f"\nthe whole window of tcn-paper takes {ratio:.1f} times an update of the tcn")
    assert ratio > 4.0


def resident_kb() -> int:
    """Of this process, page by page: `statm` is a sum that lags behind on several cores."""
    rollup = Path("/proc/self/smaps_rollup").read_text()
    return next(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Rss:"))


def grown_kb(
    update: Callable[[int], object], read_at: Sequence[int], read: Callable[[], int] = resident_kb
) -> list[int]:
    """What memory grew by from before the first step to each number of steps, all in one go."""
    grown = [0] * len(read_at)  # whole from the start: a list that lengthens takes pages itself
    first, done = read(), 0
    for k, until in enumerate(read_at):
        for i in range(done, until):
            update(i)
        done = until
        grown[k] = read() - first
    return grown


def test_memory_is_read_at_the_steps_that_are_asked_for() -> None:
    """Here of something that keeps 3 kB of its first ten steps, and later 2 of every step."""
    kept = [1000]

    def update(i: int) -> None:
        kept[0] += 3 if i < 10 else 2

    assert grown_kb(update, (10, 11, 20), lambda: kept[0]) == [30, 32, 50]


@pytest.mark.bench
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", packaged_networks())
def test_a_million_steps_take_no_memory_and_do_not_drift(name: str) -> None:
    packaged = read_network(weights_path(name))
    detector = run_network(packaged, 3)
    counts = walk(1000)
    read_at = [WARM_UP, *range(EVERY, STEPS, EVERY), STEPS]
    started, *grown = grown_kb(lambda i: detector.update(counts[i % 1000]), read_at)
    print(f"\n{name}: {started:+d} kB in the first {WARM_UP:,} steps; since then, after so many "
          "thousand steps:", end="")  # fmt: skip
    for steps, kb in zip(read_at[1:], grown, strict=True):
        print(f" {steps // 1000}: {kb - started:+d} kB", end="")
    print()
    assert grown[-1] - started < MOST_KB
    fresh = run_network(packaged, 3)
    for frame in walk(1000):
        old, new = detector.update(frame), fresh.update(frame)
    assert np.abs(old - new).max() < 1e-5
