"""A run exported as a table."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.report.export import as_csv
from scenarios.report.run_record import read_run


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(text.splitlines()))


def numbers(table: list[dict[str, str]], column: str) -> Any:
    return np.array([float(row[column] or "nan") for row in table])


def test_table_has_a_row_per_step_with_the_recorded_numbers(recorded: Path) -> None:
    run, table = read_run(recorded), rows(as_csv(recorded))
    assert "nan" not in as_csv(recorded)
    assert run.truth is not None
    np.testing.assert_allclose(numbers(table, "t_s"), run.t_s, atol=1e-6)
    for i, finger in enumerate("ABC"):
        estimated_n = np.where(np.isnan(run.counts[:, i, 0]), np.nan, run.estimated_n[:, i])
        np.testing.assert_allclose(numbers(table, f"{finger}_estimated_n"), estimated_n, rtol=1e-5)
        known = run.truth.normal_n[:, i]
        np.testing.assert_allclose(numbers(table, f"{finger}_true_n"), known, rtol=1e-5)
        counts = run.counts[:, i, 5]
        np.testing.assert_array_equal(numbers(table, f"taxel_{finger}5_counts"), counts)
    slip_m = numbers(table, "true_slip_m")
    np.testing.assert_allclose(slip_m, run.truth.slip_m, rtol=1e-5, atol=1e-12)
    phases = list(dict.fromkeys(row["phase"] for row in table))
    assert phases == list(dict.fromkeys(change.phase for change in run.phases))
