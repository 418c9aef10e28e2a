"""What a real-time priority and a silent garbage collector change, idle and beside busy programs.

Whole lifts on the emulated rig, all variants in one run.
"""

import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from detector.scores.quantiles import Quantiles, quantile
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.trial.result import TimingResult

SEEDS = range(4)
QUICK = ("hand.activation_s=0.5", "controller.hold_s=0.3", "controller.lift_height_m=0.1")
VARIANTS = {
    "neither": ("realtime.priority=0", "realtime.collect_garbage=true"),
    "collector silent": ("realtime.priority=0", "realtime.collect_garbage=false"),
    "priority": ("realtime.priority=20", "realtime.collect_garbage=true"),
    "both (default)": (),
}


def spin() -> None:
    while True:
        pass


@contextmanager
def busy_programs(count: int) -> Iterator[None]:
    context = multiprocessing.get_context("spawn")
    programs = [context.Process(target=spin, daemon=True) for _ in range(count)]
    for program in programs:
        program.start()
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.join()
            program.close()


def timings(assignments: tuple[str, ...]) -> list[TimingResult]:
    results = [
        lift.run(
            load_config("can", "emulated", None, None, QUICK + assignments).for_lift(),
            seed,
            None,
        )
        for seed in SEEDS
    ]
    return [run.result.timing for run in results if run.result is not None]


def show(label: str, unit: str, spreads: list[Quantiles]) -> str:
    p50, p90, p99 = (
        quantile(sorted(getattr(s, name) for s in spreads), 0.5) for name in ("p50", "p90", "p99")
    )
    return f"{label} {p50:.2f} / {p90:.2f} / {p99:.2f} / {max(s.max for s in spreads):.2f} {unit}"


@pytest.mark.bench
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("programs", [0, 2, 4])
def test_lifts_with_and_without(programs: int) -> None:
    print(f"\nbeside {programs} busy programs; p50 / p90 / p99 / max, medians of {len(SEEDS)}")
    with busy_programs(programs):
        for name, assignments in VARIANTS.items():
            seen = timings(assignments)
            decided = [t.frame_to_decision_us for t in seen if t.frame_to_decision_us]
            acknowledged = [t.decision_to_ack_us for t in seen if t.decision_to_ack_us]
            age = [t.frame_age_ms for t in seen if t.frame_age_ms]
            print(
                f"{name:17} {show('decision', 'us', decided)}, "
                f"{show('acknowledged', 'us', acknowledged)}, {show('frame age', 'ms', age)}, "
                f"periods missed {sum(t.missed_periods for t in seen)}, "
                f"frames repeated {sum(t.repeated_frames for t in seen)}, "
                f"the cell's stalls {sum(t.cell_stalls for t in seen)}"
            )
