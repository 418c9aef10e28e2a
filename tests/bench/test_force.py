"""What inertia, start-up override, speed and cap mode do to the true peak force, as a table."""

import pytest

from tests.unit.scenarios.conftest import judged

CASES = [
    ("reference hand (0.1 kg at the tip, clamp, no override)", ()),
    ("tip mass 0.05 kg", ("hand.tip_mass_kg=0.05",)),
    ("tip mass 0.2 kg", ("hand.tip_mass_kg=0.2",)),
    ("tip mass 0.5 kg", ("hand.tip_mass_kg=0.5",)),
    ("tip mass 1 kg", ("hand.tip_mass_kg=1.0",)),
    ("reference hand at full speed (guard.overshoot_n=2)", ("guard.overshoot_n=2",)),
    ("reference hand at its slowest (guard.overshoot_n=0.35)", ("guard.overshoot_n=0.35",)),
    ("start-up override 30 N for 0.1 s", ("hand.override_s=0.1", "hand.override_n=30")),
    (
        "same, travel_bound",
        ("hand.override_s=0.1", "hand.override_n=30", "guard.travel_bound=true"),
    ),
    ("no current clamp", ("hand.current_clamp=false",)),
    ("no current clamp, travel_bound", ("hand.current_clamp=false", "guard.travel_bound=true")),
    ("each_motor", ("guard.cap_mode=each_motor",)),
]
SEEDS = range(5)


@pytest.mark.bench
def test_true_peak_force_of_the_thumb() -> None:
    print("\n| hand | peak at the thumb, N | settled, N | commanded, N | slip, mm | outcome |")
    print("|---|---|---|---|---|---|")
    for label, assignments in CASES:
        results = [judged(*assignments, seed=seed) for seed in SEEDS]
        peak = max(r.peak_force_n["A"] for r in results if r.peak_force_n)
        settled = max(r.settled_force_n["A"] for r in results if r.settled_force_n)
        commanded = max(r.commanded_force_n for r in results)
        slip = sorted(r.slip_distance_m or 0.0 for r in results)[len(results) // 2] * 1e3
        outcomes = ", ".join(sorted({r.outcome for r in results}))
        print(
            f"| {label} | {peak:.1f} | {settled:.1f} | {commanded:.1f} | {slip:.1f} | {outcomes} |"
        )
        assert commanded <= 10.0
