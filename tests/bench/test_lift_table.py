"""Forty lifts of each object with `energy` at a threshold at which it hears a slip at once.

This measures the loop, not a detector.
"""

from collections.abc import Sequence

import pytest

from grasp.settings import names
from scenarios.lift.result import LiftResult
from tests.bench.spread import THREE, slid_mm, slipped, three
from tests.unit.scenarios.conftest import judged

SEEDS = range(40)


def row(name: str, results: Sequence[LiftResult]) -> str:
    held = sum(bool(r.success) for r in results)
    slid = slipped(results)
    late = three(r.detection_latency_ms for r in slid)
    return f"| {name} | {held} of {len(results)} | {late} | {three(slid_mm(slid))} |"


@pytest.mark.bench
def test_forty_lifts_of_each_object() -> None:
    print(f"\nof what slipped; inf: so many never came\n\n| object | held "
          f"| slip registered after onset, ms, {THREE} | slip distance, mm, {THREE} |\n"
          "|---|---|---|---|")  # fmt: skip
    for name in names("objects"):
        print(row(name, [judged(seed=seed, object_name=name) for seed in SEEDS]), flush=True)
