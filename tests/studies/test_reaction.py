"""Reactions on copies of a lift: a later one slips more, and a copy agrees with the full run."""

from pathlib import Path

import pytest

from grasp.commands import CloseFast
from grasp.guard import THUMB_ALONE
from grasp.slip_response.close import CLOSED_COUNTS
from studies import runner
from studies.lift_start import at_lift
from studies.reaction import STUDY, Reaction, cliff, find_onset, react
from tests.unit.scenarios.conftest import config

CLOSE = CloseFast(10.0, THUMB_ALONE, CLOSED_COUNTS, 0.11)


def test_later_reaction_slips_more_until_the_ball_is_lost_and_the_start_is_unchanged() -> None:
    settings = config(object_name="ball")
    start = at_lift(settings, 1)
    onset_ns = find_onset(start)
    assert onset_ns is not None
    early, late, lost, again = (
        react(settings, start, onset_ns + round(s * 1e9), CLOSE) for s in (0.0, 0.1, 0.6, 0.0)
    )
    assert early.slip_mm is not None and late.slip_mm is not None
    assert early.slip_mm + 5.0 < late.slip_mm
    assert not lost.held
    assert again == early


def test_cliff_is_the_steepest_drop_of_success() -> None:
    held, lost = Reaction(10.0, 50.0), Reaction(None, None)
    assert cliff({50.0: [held], 100.0: [lost]}) == "100% at 50 ms, 0% at 100 ms"
    assert cliff({50.0: [held], 100.0: [held]}) is None


def test_a_small_study_leaves_table_and_chart_and_its_copies_agree(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    words = "--objects can --seeds 1 --detector energy --latencies 100 --speeds 0.11 --check 1"
    assert (
        runner.main("reaction", STUDY, [*words.split(), "--out", str(tmp_path), "--jobs", "1"]) == 0
    )
    out = capsys.readouterr().out
    assert "1 of 1 copies have the full run's verdict" in out
    assert (tmp_path / "chart.svg").read_text().startswith("<?xml")
