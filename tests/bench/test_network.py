"""Cost of an update, compiled and in ONNX Runtime, and memory over many updates.

Memory use of the first steps does not count as growth. Fewer steps: STEPS=200000.
"""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from detector.network import RuntimeNetwork, engine_of, run_network
from detector.network_file import packaged_networks, read_network, weights_path
from detector.scores.quantiles import quantile
from tests.unit.detector.network_files import walk

UPDATES = 5_000
WARM_UP, EVERY, STEPS = 20_000, 100_000, int(os.environ.get("STEPS", "1_000_000"))
MOST_KB = 100  # of growth after the first steps; one float kept per step would be 8,000


def microseconds(update: Callable[[int], object], times: int) -> np.ndarray:
    durations = np.empty(times)
    for i in range(times):
        start = time.thread_time_ns()
        update(i)
        durations[i] = (time.thread_time_ns() - start) * 1e-3
    return durations


def median_us(run: Callable[[], object]) -> float:
    microseconds(lambda _: run(), 500)
    return quantile(np.sort(microseconds(lambda _: run(), UPDATES)), 0.5)


@pytest.mark.bench
def test_compiled_networks_against_onnx_runtime_for_three_fingers() -> None:
    ratios = {}
    for name in packaged_networks():
        loaded = read_network(weights_path(name))
        compiled, other = (
            median_us(engine.run) for engine in (engine_of(loaded, 3), RuntimeNetwork(loaded, 3))
        )
        ratios[name] = other / compiled
        print(f"\n{name}: {compiled:.1f} us p50, {other:.1f} in ONNX Runtime", end="")
    assert ratios["tcn"] > 3.0 and min(ratios.values()) > 1.0, ratios


def resident_kb() -> int:
    """Memory of this process from `smaps_rollup`, because `statm` lags behind on several cores."""
    rollup = Path("/proc/self/smaps_rollup").read_text()
    return next(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Rss:"))


def grown_kb(
    update: Callable[[int], object], read_at: Sequence[int], read: Callable[[], int] = resident_kb
) -> list[int]:
    """Growth of memory from before the first step to each number of steps, kB."""
    grown = [0] * len(read_at)  # allocated first: a growing list would need memory itself
    first, done = read(), 0
    for k, until in enumerate(read_at):
        for i in range(done, until):
            update(i)
        done = until
        grown[k] = read() - first
    return grown


def test_memory_is_read_at_the_steps_that_are_asked_for() -> None:
    """With a stub that keeps 3 kB for each of its first ten steps, and 2 kB for every later one."""
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
