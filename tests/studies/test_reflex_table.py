"""Episodes of bad policies, with the reflex and without it."""

from pathlib import Path

import pytest

from studies import reflex_table, runner


def test_an_episode_of_each_kind_is_one_line_of_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--objects can --seeds 1 --first-seed 1 --noise-seeds 1 --jobs 1 --out", str(tmp_path))
    assert runner.main("reflex_table", reflex_table.STUDY, " ".join(words).split()) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + 2 * len(reflex_table.STEPS)
    for policy in ("frozen", "early", "opens"):
        (line,) = (line for line in lines if line.startswith(f"| {policy}, with |"))
        assert line.startswith(f"| {policy}, with | 1 | 1 | 0 | 0 | 0 | 10 |")
