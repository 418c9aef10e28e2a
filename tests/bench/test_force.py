"""True peak force for different hands and errors of the contact estimate, as tables."""

from collections.abc import Sequence

import pytest

from detector.scores.quantiles import quantiles
from drivers.interfaces import Vector3
from grasp.control.guard import ForceGuard
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from scenarios.world.objects import GraspObject

CASES = [
    ("reference hand (0.1 kg at the tip, clamp, no override)", ()),
    ("tip mass 0.05 kg", ("hand.tip_mass_kg=0.05",)),
    ("tip mass 0.2 kg", ("hand.tip_mass_kg=0.2",)),
    ("tip mass 0.5 kg", ("hand.tip_mass_kg=0.5",)),
    ("tip mass 1 kg", ("hand.tip_mass_kg=1.0",)),
    ("guard.overshoot_n=2", ("guard.overshoot_n=2",)),
    ("guard.overshoot_n=0.35", ("guard.overshoot_n=0.35",)),
    ("start-up override 30 N for 0.1 s", ("hand.override_s=0.1", "hand.override_n=30")),
    (
        "same, stiffness stated",
        ("hand.override_s=0.1", "hand.override_n=30", "object.contact_stiffness_npm=2500"),
    ),
    ("no current clamp", ("hand.current_clamp=false",)),
    (
        "no current clamp, stiffness stated",
        ("hand.current_clamp=false", "object.contact_stiffness_npm=2500"),
    ),
    ("each_motor", ("guard.limit_mode=each_motor",)),
]
OBJECTS = ("can", "box", "cardboard", "ball", "football", "foam")
SEEDS = range(5)
FEWER = range(3)
STAGES = ("constant", "two_stage")
STATED_SHARES = {
    "can": (0.77, 1.0, 1.3), "foam": (0.77, 1.0, 1.3, 3.0), "football": (0.77, 1.0, 1.3),
}  # fmt: skip


def lifts(object_name: str, *settings: str, seeds: Sequence[int] = FEWER) -> list[LiftResult]:
    """Results of lifts with the default detector, in which only the hand responds."""
    settings = ('controller.slip_response="close"', *settings)
    config = load_config(object_name, "simulated", None, None, settings).for_lift()
    results = [lift.run(config, seed, None).result for seed in seeds]
    return [r for r in results if r is not None]


def closed(closing: str, settings: Sequence[str]) -> list[LiftResult]:
    return lifts("can", f'controller.closing="{closing}"', *settings, seeds=SEEDS)


def peak_n(results: list[LiftResult]) -> float:
    return max(r.peak_force_n["A"] for r in results if r.peak_force_n)


def slip_mm(results: list[LiftResult]) -> str:
    """Median and maximum, which equals p90 and p99 of so few lifts (by nearest rank)."""
    slid = sorted((r.slip_distance_m or 0.0) * 1e3 for r in results)
    return f"{slid[len(slid) // 2]:.1f}, {slid[-1]:.1f}"


def stiffness_npm(body: GraspObject) -> float:
    """Stiffness of walls, pads and linkages of the simulated hand in series, N/m."""
    return 1 / (1.5 * (1 / 5000.0 + 1 / 15000.0 + 1 / body.wall_stiffness_npm))


@pytest.mark.bench
@pytest.mark.timeout(3600)
def test_true_peak_force_of_the_thumb() -> None:
    print("\n| hand | one closing: peak, N | slip, mm: p50, p90 = p99 | two stages: peak, N "
          "| settled, N | slip, mm: p50, p90 = p99 | outcome |")  # fmt: skip
    print("|---|---|---|---|---|---|---|")
    for label, assignments in CASES:
        one, two = (closed(c, assignments) for c in STAGES)
        settled = max(r.settled_force_n["A"] for r in two if r.settled_force_n)
        outcomes = ", ".join(sorted({r.outcome for r in two}))
        print(
            f"| {label} | {peak_n(one):.1f} | {slip_mm(one)} | {peak_n(two):.1f} | "
            f"{settled:.1f} | {slip_mm(two)} | {outcomes} |"
        )
        assert max(r.commanded_force_n for r in (*one, *two)) <= 10.0


@pytest.mark.bench
@pytest.mark.timeout(3600)
def test_true_peak_force_with_errors_of_the_contact_estimate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Force measured 1 N too low, correct, 1 N too high, from first contact on."""
    estimated_n = ForceGuard.estimated_n

    def off_by(error_n: float) -> None:
        def shifted(self: ForceGuard, sums: Vector3) -> Vector3:
            thumb_n, b_n, c_n = estimated_n(self, sums)
            return (max(0.0, thumb_n + error_n) if thumb_n > 0.3 else thumb_n), b_n, c_n

        monkeypatch.setattr(ForceGuard, "estimated_n", shifted)

    print("\n| object, stiffness stated of true | force 1 N too low: peak, N | right: peak, N | "
          "without clamp, N | slip, mm: p50, p90 = p99 | 1 N too high: peak, N | "
          "slip, mm: p50, p90 = p99 |")  # fmt: skip
    print("|---|---|---|---|---|---|---|")
    for name, shares in STATED_SHARES.items():
        true_npm = stiffness_npm(load_config(name, "simulated", None, None, ()).for_lift().object)
        for share in shares:
            stated = f"object.contact_stiffness_npm={share * true_npm}"
            off_by(-1.0)
            low = lifts(name, stated)
            off_by(0.0)
            right, free = lifts(name, stated), lifts(name, stated, "hand.current_clamp=false")
            off_by(1.0)
            high = lifts(name, stated)
            print(
                f"| {name}, {share:g} | {peak_n(low):.1f} | {peak_n(right):.1f} | "
                f"{peak_n(free):.1f} | {slip_mm(right)} | {peak_n(high):.1f} | "
                f"{slip_mm(high)} |"
            )


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_slip_of_every_object_in_one_closing_and_in_two_stages() -> None:
    print("\n| object | one closing: peak, N | slip, mm, p50 / p90 / p99 | two stages: peak, N | "
          "slip, mm, p50 / p90 / p99 |")  # fmt: skip
    print("|---|---|---|---|---|")
    for name in OBJECTS:
        cells = []
        for closing in STAGES:
            found = lifts(name, f'controller.closing="{closing}"', seeds=range(9000, 9020))
            q = quantiles((r.slip_distance_m or 0.0) * 1e3 for r in found)
            assert q is not None
            cells.append(f"{peak_n(found):.1f} | {q.p50:.1f} / {q.p90:.1f} / {q.p99:.1f}")
        print(f"| {name} | {' | '.join(cells)} |")
