"""Every detector at one false event a minute: its rule, its row, slips by how far they slid."""

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.scores.evaluation import Streamed
from detector.scores.sweep import rules
from scripts import one_a_minute
from scripts.one_a_minute import accuracies, by_way, rows, tuned
from tests.unit.detector.scores.test_sweep import noisy

TRIED = list(rules(RuleSettings()))[::7]
STREAMS = [noisy(seed) for seed in range(3)]


def test_the_rule_keeps_to_the_budget_on_what_it_was_tuned_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(one_a_minute, "BUDGET", 20.0)
    found = tuned("tcn", TRIED, STREAMS, STREAMS)
    assert found.kept
    assert found.point.false_per_min <= 20.0


def test_what_no_rule_keeps_within_the_budget_has_a_row_that_says_so() -> None:
    now_and_then = np.arange(len(STREAMS[0].labels)) % 20 == 0
    always = [
        msgspec.structs.replace(s, probabilities=np.where(now_and_then, 0.9995, 0.0005)[:, None])
        for s in STREAMS
    ]
    found = tuned("psd", list(rules(RuleSettings()))[:28], always, always)
    assert not found.kept
    assert "**over the budget**" in rows([found]).splitlines()[2]


def test_a_row_is_of_the_recordings_that_the_rule_was_not_tuned_by() -> None:
    found = tuned("tcn", TRIED, STREAMS[:2], STREAMS[2:])
    line = rows([found]).splitlines()[2]
    assert line.startswith("| `tcn` |")
    assert line.count("|") == rows([found]).splitlines()[0].count("|")


def test_slips_are_counted_by_how_far_they_slid() -> None:
    slid = [
        msgspec.structs.replace(
            s, recording=msgspec.structs.replace(
                s.recording, contact_speed_mps=np.where(s.labels, 0.004, 0.0).astype(np.float32)
            )
        )
        for s in STREAMS
    ]  # fmt: skip
    found = tuned("tcn", TRIED, STREAMS, slid)
    cells = by_way([found]).splitlines()[2].split(" | ")[1:]
    assert [c.split(" of ")[1].strip(" |") for c in cells] == ["0", "0", "0", "9", "0"]


def test_how_often_samples_are_told_right_has_an_interval() -> None:
    sure = [Streamed(s.recording, np.where(s.labels, 0.9, 0.1)[:, None], np.empty(0))
            for s in STREAMS]  # fmt: skip
    assert accuracies({"who": sure}).splitlines()[2] == "| who | 100.0 [100.0, 100.0] | 1.000 |"
