"""The same seeds on the emulated and the simulated rig: phases, slip distance, latencies."""

import numpy as np
import pytest

from detector.scores.quantiles import quantile
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift

SEEDS = range(25)
OBJECTS = ("box", "can")
QUICK = ("hand.activation_s=0.5", "controller.hold_s=0.3", "controller.lift_height_m=0.1")
MM_PER_MS = 0.1  # the arm's speed


@pytest.mark.bench
@pytest.mark.timeout(1800)
def test_emulated_lifts_equal_simulated_ones_except_for_latency() -> None:
    rest_mm, later_ms, acknowledged_us, decided_us, same, stalls = [], [], [], [], 0, 0
    for name in OBJECTS:
        for seed in SEEDS:
            wired, virtual = (
                lift.run(load_config(name, rig, None, None, QUICK).for_lift(), seed, None).result
                for rig in ("emulated", "simulated")
            )
            assert wired is not None and virtual is not None
            same += [p.phase for p in wired.phases] == [p.phase for p in virtual.phases]
            stalls += wired.timing.cell_stalls
            if wired.reaction_latency_ms is None or virtual.reaction_latency_ms is None:
                print(name, seed, wired.outcome, wired.phases[-1].cause)
                continue
            later_ms.append(wired.reaction_latency_ms - virtual.reaction_latency_ms)
            more_mm = 1e3 * ((wired.slip_distance_m or 0) - (virtual.slip_distance_m or 0))
            rest_mm.append(more_mm - MM_PER_MS * later_ms[-1])
            if wired.timing.decision_to_ack_us and wired.timing.frame_to_decision_us:
                acknowledged_us.append(wired.timing.decision_to_ack_us)
                decided_us.append(wired.timing.frame_to_decision_us)
    total = len(OBJECTS) * len(SEEDS)
    print(f"\nsame phases in {same} of {total}; {stalls} stalls of the cell over 50 ms")
    p50, p90, p99 = (quantile(sorted(later_ms), share) for share in (0.5, 0.9, 0.99))
    print(f"reaction later by p50 {p50:.1f}, p90 {p90:.1f}, p99 {p99:.1f} ms ("
          f"{np.min(later_ms):.0f} to {np.max(later_ms):.0f}); slip not explained by that: "
          f"at most {np.abs(rest_mm).max():.2f} mm")  # fmt: skip
    for text, spreads in (("frame to decision", decided_us),
                          ("decision to acknowledged write", acknowledged_us)):  # fmt: skip
        p50, p90, p99, worst = (max(getattr(s, n) for s in spreads) if n == "max" else
                                quantile(sorted(getattr(s, n) for s in spreads), 0.5)
                                for n in ("p50", "p90", "p99", "max"))  # fmt: skip
        print(f"{text}: p50 {p50:.0f}, p90 {p90:.0f}, p99 {p99:.0f}, max {worst:.0f} us")
