"""Error against processor time: what counts as accuracy."""

from studies.physics_levels import Row, cheapest


def row(curve: str, step_s: float, cost_us: float, error_mm: float) -> Row:
    return Row("lift", curve, step_s, cost_us, error_mm * 1e-3)


def test_accidental_hit_at_one_step_does_not_count() -> None:
    rows = [row("L1", 4e-3, 10.0, 0.01), row("L1", 2e-3, 20.0, 0.4), row("L3", 2e-3, 90.0, 0.05)]
    assert cheapest(rows, "L", 0.1) == rows[2]
    assert cheapest(rows[:2], "L", 0.1) is None
