"""What an update costs: streaming against the full window, one runtime, one run; memory at rest."""

import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from detector.interface import SlipDetector
from detector.network import run_network
from detector.network_file import packaged_networks, read_network, weights_path
from detector.scores.quantiles import quantile
from tests.unit.detector.networks import walk, write_network

UPDATES, MILLION = 5_000, 1_000_000


def microseconds(update: Callable[[int], object], times: int) -> np.ndarray:
    spent = np.empty(times)
    for i in range(times):
        start = time.thread_time_ns()
        update(i)
        spent[i] = (time.thread_time_ns() - start) * 1e-3
    return spent


@pytest.mark.bench
def test_streaming_against_the_full_window_for_three_fingers(tmp_path: Path) -> None:
    counts = walk(UPDATES)
    cost = {}
    for name, mode in (("tcn", "stream"), ("tcn", "window"), ("gru", "stream"),
                       ("tcn-paper", "window")):  # fmt: skip
        detector = run_network(read_network(write_network(tmp_path, name, mode)), 3)  # type: ignore[arg-type]
        microseconds(lambda i, d=detector: d.update(counts[i]), 500)  # type: ignore[misc]
        spent = microseconds(lambda i, d=detector: d.update(counts[i]), UPDATES)  # type: ignore[misc]
        cost[name, mode] = quantile(np.sort(spent), 0.5)
        p50, p99 = (quantile(np.sort(spent), share) for share in (0.5, 0.99))
        print(f"\n{name} {mode}: {p50:.0f} us p50, {p99:.0f} p99 of the thread's time", end="")
    ratio = cost["tcn", "window"] / cost["tcn", "stream"]
    rest = ", ".join(
        f"{cost[name, mode] / cost['tcn', 'stream']:.1f} times by {name}"
        for name, mode in (("gru", "stream"), ("tcn-paper", "window"))
    )
    print(f"\nwindow / stream: {ratio:.1f} times; an update of the tcn takes {rest}")
    assert ratio > 4.0


def resident_kb(detector: SlipDetector, updates: int) -> int:
    counts = walk(1000)
    for i in range(updates):
        detector.update(counts[i % 1000])
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024


@pytest.mark.bench
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", packaged_networks())
def test_a_million_steps_take_no_memory_and_do_not_drift(name: str) -> None:
    packaged = read_network(weights_path(name))
    detector = run_network(packaged, 3)
    before = resident_kb(detector, 20_000)
    after = resident_kb(detector, MILLION)
    print(f"\n{name}: {after - before:+d} kB over a million steps")
    assert after - before < 1000
    fresh = run_network(packaged, 3)
    for frame in walk(1000):
        old, new = detector.update(frame), fresh.update(frame)
    assert np.abs(old - new).max() < 1e-5
