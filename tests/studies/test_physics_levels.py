"""Error against processor time: a tiny grid, and what counts as accuracy."""

from pathlib import Path

from studies import physics_stability
from studies.physics_levels import Row, cheapest


def row(curve: str, step_s: float, cost_us: float, error_mm: float) -> Row:
    return Row("lift", curve, step_s, cost_us, error_mm * 1e-3)


def test_accidental_hit_at_one_step_does_not_count() -> None:
    rows = [row("L1", 4e-3, 10.0, 0.01), row("L1", 2e-3, 20.0, 0.4), row("L2", 2e-3, 90.0, 0.05),
            row("LuGre EXP2", 4e-3, 0.1, 0.01)]  # fmt: skip
    assert cheapest(rows, "L", 0.1) == rows[2]
    assert cheapest(rows[:2], "L", 0.1) is None


def test_unstable_integrators_are_marked_and_stable_ones_are_not(tmp_path: Path) -> None:
    found = physics_stability.trial(physics_stability.Task(1.5e5, (5e-3,)))
    failed = {m for m in physics_stability.METHODS if physics_stability.failed([found], m)}
    assert failed == {
        "same law, explicit Euler", "same law, RK4", "LuGre, explicit Euler", "LuGre, RK4",
        "regularised Coulomb, explicit",
    }  # fmt: skip
    assert "| LuGre, RK4 | 100 |" in physics_stability.table([found])
