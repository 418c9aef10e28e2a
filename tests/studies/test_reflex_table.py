"""Episodes of bad policies, with the reflex and without it."""

from studies.reflex_table import Task, table, trial


def test_an_episode_of_each_kind_is_one_line_of_the_table() -> None:
    rows = [trial(Task(p, r, "can", 1)) for p in ("opens", "noise") for r in (False, True)]
    assert [row.outcome for row in rows[:2]] == ["on the table", "held"]
    assert all(row.above == 0 and row.commanded_n <= 10.0 for row in rows)
    assert "| opens, with | 1 | 1 | 0 | 0 | 10 |" in table(rows)
