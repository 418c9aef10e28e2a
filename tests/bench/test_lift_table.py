"""The table of the README: forty lifts of each object with the default controller."""

import numpy as np
import pytest

from detector.scores.quantiles import quantile
from grasp.settings import names
from tests.unit.scenarios.conftest import judged

SEEDS = range(40)


@pytest.mark.bench
def test_forty_lifts_of_each_object() -> None:
    print("\n| object | held | slip registered after onset, ms (median, worst) "
          "| slip distance, mm (median, worst) |")  # fmt: skip
    print("|---|---|---|---|")
    for name in names("objects"):
        results = [judged(seed=seed, object_name=name) for seed in SEEDS]
        held = sum(r.success for r in results)
        latency = np.array([r.detection_latency_ms for r in results if r.detection_latency_ms])
        slip = np.array([r.slip_distance_m for r in results if r.slip_distance_m]) * 1e3
        counts = f"{held} of {len(results)}"
        print(f"| {name} | {counts} | {quantile(np.sort(latency), 0.5):.0f}, {latency.max():.0f} "
              f"| {quantile(np.sort(slip), 0.5):.0f}, {slip.max():.0f} |")  # fmt: skip
