"""What a detector is worth in a lift: reaction latency and slip distance, forty seeds each.

Each detector listens with the packaged rule, once masked after our own closing and once not.
"""

import os
from collections import Counter

import numpy as np
import pytest

from scenarios import lift
from scenarios.config import load_config
from scenarios.result import LiftResult

SEEDS = range(int(os.environ.get("LIFTS", "40")))
DETECTORS = ("energy", "tcn-paper", "tcn", "gru")
MASKS_S = (0.14, 0.0)


def judged(detector: str, mask_s: float, seed: int) -> LiftResult:
    mask = f"slip.mask_after_closing_s={mask_s}"
    result = lift.run(load_config("can", "simulated", detector, None, [mask]), seed, None).result
    assert result is not None
    return result


@pytest.mark.bench
@pytest.mark.timeout(1200)
def test_lifts_of_the_can_with_each_detector_masked_and_not() -> None:
    print("\n| detector | mask, ms | outcomes | reaction after onset, ms (median, worst) "
          "| slip distance, mm (median, worst) |\n|---|---|---|---|---|")  # fmt: skip
    for name in DETECTORS:
        for mask_s in MASKS_S:
            results = [judged(name, mask_s, seed) for seed in SEEDS]
            outcomes = Counter(r.outcome for r in results).most_common()
            reaction = [r.reaction_latency_ms for r in results if r.reaction_latency_ms is not None]
            slip = [1e3 * r.slip_distance_m for r in results if r.slip_distance_m is not None]
            print(f"| {name} | {mask_s * 1e3:.0f} | "
                  f"{', '.join(f'{n} {outcome}' for outcome, n in outcomes)} | "
                  f"{np.median(reaction):.0f}, {max(reaction):.0f} | "
                  f"{np.median(slip):.1f}, {max(slip):.1f} |", flush=True)  # fmt: skip
