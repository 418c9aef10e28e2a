"""Random lifts, and the rates and intervals made of them."""

import pytest

from studies import drop_rate
from studies.drop_rate import Row, Task, clopper_pearson, sampled, table


def row(outcome: str, least_n: float, peak_n: float = 9.0, set_down: bool = False) -> Row:
    return Row(seed=0, object="can", set_down=set_down, outcome=outcome, cause="contact lost",
               least_n=least_n, slip_mm=None, peak_n=peak_n, limit_n=10.0,
               bound_n=11.0, texture_um=50.0, tip_kg=0.2)  # fmt: skip


@pytest.mark.parametrize(
    ("hits", "of", "low", "high"), [(0, 20_000, 0.0, 1.8443e-4), (5, 100, 0.01643, 0.11283),
                                    (3, 3, 0.29240, 1.0)],
)  # fmt: skip
def test_interval_is_that_of_published_tables(hits: int, of: int, low: float, high: float) -> None:
    assert clopper_pearson(hits, of) == pytest.approx((low, high), abs=5e-5, rel=1e-3)


def test_a_lift_follows_from_its_seed_and_one_in_ten_sets_the_object_down() -> None:
    assert sampled(Task(7)) == sampled(Task(7)) != sampled(Task(17))
    assert [s for s in range(30) if not sampled(Task(s)).controller.keep] == [0, 10, 20]


def test_drops_that_the_force_limit_could_hold_are_counted_by_cause() -> None:
    rows = [row("dropped", 4.0), row("dropped", 12.0), row("held", 4.0, peak_n=11.5)]
    text = table(rows)
    assert "| dropped, of all | 2 | 3 |" in text and "| dropped, of holdable | 1 | 2 |" in text
    assert "| slid out, of holdable and smooth (texture below 0.1 mm rms) | 1 | 2 |" in text
    assert "| the same, tip mass up to the assumed one | 0 | 0 |" in text
    assert "| true force above limit plus overshoot | 1 | 3 |" in text
    assert "| dropped | contact lost | 1 |" in text


def test_a_lift_of_the_study_runs() -> None:
    found = drop_rate.trial(Task(3))
    assert found.peak_n <= found.bound_n and not found.set_down
