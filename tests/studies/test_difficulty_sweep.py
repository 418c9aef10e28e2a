"""Harder lifts: bounds by statics, and where success falls below a level."""

from pathlib import Path

import pytest

from scenarios.campaign.config import load_config
from studies import runner
from studies.difficulty_sweep import AXES, STUDY, Row, fall, table


def test_value_changes_one_axis_only_and_values_get_harder() -> None:
    for axis in AXES:
        plain = load_config("can", "simulated", "energy")
        moved = [
            load_config("can", "simulated", "energy", None, AXES[axis].moved(plain, value))
            for value in AXES[axis].values
        ]
        assert [AXES[axis].here(c) for c in moved] == pytest.approx(AXES[axis].values), axis
        for name, other in AXES.items():
            assert name == axis or other.here(moved[0]) == pytest.approx(other.here(plain)), axis
        shares = [AXES[axis].share(plain, value) for value in AXES[axis].values]
        assert (
            shares == sorted(shares) and AXES[axis].share(plain, AXES[axis].bound(plain)) == 1.0
        ), axis


def trials(rates: dict[float, float], n: int = 40) -> tuple[list[float], list[bool]]:
    hard = [x for x in rates for _ in range(n)]
    return hard, [i < round(rate * n) for rate in rates.values() for i in range(n)]


def test_a_fall_is_between_the_last_rate_above_the_level_and_the_first_below() -> None:
    hard, held = trials({0.0: 1.0, 1.0: 1.0, 2.0: 0.6, 3.0: 0.0})
    assert fall(hard, held, 0.95)[0] == pytest.approx(1.0 + 0.05 / 0.4)
    at, low, high = fall(hard, held, 0.5)
    assert at == pytest.approx(2.0 + 0.1 / 0.6)
    assert low is not None and high is not None and low <= at <= high
    assert fall(*trials({0.0: 1.0, 1.0: 1.0}, n=20), 0.5) == (None, None, None)
    assert fall(*trials({0.5: 0.2, 1.0: 0.0}), 0.95)[0] == 0.5


def test_lifts_that_never_slip_are_counted_separately() -> None:
    rows = [Row("counts", {"mass": (0.6, 0.4)}, "", "held", True)] * 9
    rows += [Row("counts", {"mass": (0.6, 0.4)}, "", "never_slipped", False)]
    rows += [Row("counts", {"mass": (1.6, 1.1)}, "mass", "dropped", False)] * 10
    lines = table(rows).splitlines()
    assert "| mass | counts | 0.6 | 0.40-0.40 | 100 (70-100) | 9 |  | 1 |" in lines
    assert "| mass | counts | 1.6 | 1.10-1.10 | 0 (0-28) | 10 | 10 dropped | 0 |" in lines


@pytest.mark.slow
def test_a_small_sweep_leaves_table_and_chart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    words = "--objects can --seeds 1 --detector gru --jobs 1 --axes taxels"
    assert runner.main("x", STUDY, [*words.split(), "--out", str(tmp_path)]) == 0
    assert (
        "| taxels | counts | 0.84 | 0.84-0.84 | 0 (0-79) | 1 | 1 fault | 0 |"
        in capsys.readouterr().out
    )
    assert (tmp_path / "chart.svg").read_text().startswith("<?xml")
