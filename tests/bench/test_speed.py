"""Speed of the simulated rig relative to real time, and a profile by package."""

import cProfile
import pstats
import time
from pathlib import Path

import pytest

from scenarios.lift.lift import lift
from tests.unit.scenarios.conftest import by_default

LIFTS = 10


def seconds_a_lift(runs: Path | None) -> tuple[float, float]:
    """Wall and virtual duration of one lift, from the controller's start to its end, s."""
    virtual = 0.0
    start = time.perf_counter()
    for seed in range(LIFTS):
        result = lift.run(by_default(), seed, runs).result
        assert result is not None
        virtual += result.phases[-1].t_s - result.phases[0].t_s
    return (time.perf_counter() - start) / LIFTS, virtual / LIFTS


@pytest.mark.bench
def test_multiple_of_real_time_with_and_without_a_recording(tmp_path: Path) -> None:
    lift.run(by_default(), 0, None)
    bare, virtual = seconds_a_lift(None)
    recorded, _ = seconds_a_lift(tmp_path)
    print(f"\na lift of {virtual:.1f} s takes {bare * 1e3:.0f} ms: {virtual / bare:.0f} x real")
    print(f"recorded {recorded * 1e3:.0f} ms: {virtual / recorded:.0f} x", end="")
    print(f", {recorded / bare:.2f} times the unrecorded")
    profile = cProfile.Profile()
    profile.enable()
    lift.run(by_default(), 0, tmp_path)
    profile.disable()
    packages: dict[str, float] = {}
    entries = pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    for (file, _, _), (_, _, own_s, _, _) in entries:
        parts = Path(file).parts
        name = next((p for p in ("drivers", "detector", "grasp", "scenarios", "mcap", "numpy",
                                 "transitions") if p in parts), "other")  # fmt: skip
        packages[name] = packages.get(name, 0.0) + own_s
    total = sum(packages.values())
    shares = sorted(packages.items(), key=lambda item: -item[1])
    print("time by package: " + ", ".join(f"{name} {s / total:.0%}" for name, s in shares))
