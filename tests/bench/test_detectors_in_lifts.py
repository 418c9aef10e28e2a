"""Reaction latency and slip distance of lifts with each detector, forty seeds each.

Each detector runs with its packaged rule, with and without the mask after a closing. Other objects:
OBJECTS=ball,box DETECTORS=gru LIFTS=20.
"""

import os
from collections import Counter
from collections.abc import Sequence
from itertools import product

import pytest

from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from tests.bench.spread import THREE, slid_mm, slipped, three

SEEDS = range(int(os.environ.get("LIFTS", "40")))
OBJECTS = os.environ.get("OBJECTS", "can").split(",")
DETECTORS = os.environ.get("DETECTORS", "energy,tcn-paper,tcn,gru").split(",")
MASKS_S = (0.14, 0.0)


def judged(object_name: str, detector: str, mask_s: float, seed: int) -> LiftResult:
    mask = f"slip.mask_after_closing_s={mask_s}"
    config = load_config(object_name, "simulated", detector, None, [mask]).for_lift()
    result = lift.run(config, seed, None).result
    assert result is not None
    return result


def row(name: str, detector: str, mask_s: float, results: Sequence[LiftResult]) -> str:
    outcomes = Counter(r.outcome for r in results).most_common()
    slid = slipped(results)
    events = sum(p.phase == "compensate" for r in results for p in r.phases)
    return (f"| {name} | {detector} | {mask_s * 1e3:.0f} | "
            f"{', '.join(f'{n} {outcome}' for outcome, n in outcomes)} | "
            f"{three(r.reaction_latency_ms for r in slid)} | {three(slid_mm(slid), 1)} | "
            f"{events} |")  # fmt: skip


@pytest.mark.bench
@pytest.mark.timeout(1200)
def test_lifts_with_each_detector_masked_and_not() -> None:
    print(f"\nlifts with slip only; inf: event missing\n\n| object | detector | mask, ms "
          f"| outcomes | reaction after onset, ms, {THREE} | slip, mm, {THREE} | events |\n"
          "|---|---|---|---|---|---|---|")  # fmt: skip
    for name, detector, mask_s in product(OBJECTS, DETECTORS, MASKS_S):
        results = [judged(name, detector, mask_s, seed) for seed in SEEDS]
        print(row(name, detector, mask_s, results), flush=True)
