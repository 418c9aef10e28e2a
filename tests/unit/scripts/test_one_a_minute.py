"""Every detector at one false event a minute: its rule, its row, slips by how far they slid."""

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.scores.evaluation import Streamed
from detector.scores.sweep import SweepPoint, rules
from scripts import one_a_minute
from scripts.one_a_minute import Tuned, accuracies, by_kind, rows, tuned
from tests.unit.detector.blow_toys import struck
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


def test_slips_are_told_by_what_made_them_and_of_blows_by_how_far_they_moved_it() -> None:
    recording = struck((2.0, 0.003), (4.0, 0.0015), (6.0, 0.0))
    assert recording.slip_true is not None
    slips = msgspec.structs.replace(recording, slip=recording.slip_true)
    p = np.full((len(slips.t_s), 1), 0.01)
    p[203:206] = 0.99  # the first alone is heard, at once
    point = SweepPoint(RuleSettings(consecutive=1), 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, None)
    heard = Tuned("tcn", point, True, [Streamed(slips, p, np.empty(0))])
    _, _, near, far = by_kind([heard]).splitlines()
    assert near == "| blow, 1-2 mm | 1 | 0; inf / inf / inf |"
    assert far == "| blow, 2 mm or more | 1 | 1; 0 / 0 / 0 |"


def test_how_often_samples_are_told_right_has_an_interval() -> None:
    sure = [Streamed(s.recording, np.where(s.labels, 0.9, 0.1)[:, None], np.empty(0))
            for s in STREAMS]  # fmt: skip
    assert accuracies({"who": sure}).splitlines()[2] == "| who | 100.0 [100.0, 100.0] | 1.000 |"
