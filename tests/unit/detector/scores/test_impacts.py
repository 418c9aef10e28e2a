"""Impacts: what moved an object has to be registered, what did not must not."""

import math

import numpy as np

from detector.decision import RuleSettings
from detector.recordings import Recording
from detector.scores.evaluation import Streamed
from detector.scores.impacts import answers, impact_score, impacts_of
from detector.scores.sweep import best, sweep
from tests.unit.detector.impact_toys import struck

ALARM = RuleSettings(consecutive=1)


def said(recording: Recording, *alarms: int) -> Streamed:
    """Alarms of three samples, from these samples on."""
    p = np.zeros((len(recording.t_s), recording.fingers))
    for first in alarms:
        p[first : first + 3] = 0.9
    return Streamed(recording, p, np.empty(0))


def test_an_impact_lasts_until_the_next_act_and_its_motion_is_found() -> None:
    first, second = impacts_of(struck((2.0, 0.003), (2.3, 0.0)))
    assert (first.struck, first.onset, first.until) == (200, 203, 230)
    assert (second.struck, second.onset, second.until) == (230, 230, 280)
    assert (first.moved_m, second.moved_m) == (0.003, 0.0)


def test_an_impact_is_answered_by_what_begins_before_the_next_one() -> None:
    recording = struck((2.0, 0.003), (4.0, 0.003), (6.0, 0.003))
    registered = np.array([[190, 300], [405, 410], [655, 660]])  # on before; in time; too late
    found = answers(registered, impacts_of(recording), recording.t_s)
    assert np.allclose(found, [math.inf, 20.0, math.inf])


def test_impacts_are_scored_by_how_far_they_moved_what_is_held() -> None:
    moved_m = np.array([0.0, 0.0001, 0.0004, 0.0007, 0.0015, 0.003, 0.005])
    delays_ms = np.array([20.0, math.inf, 30.0, 30.0, 40.0, 120.0, math.inf])
    score = impact_score(moved_m, delays_ms, weak=np.arange(7) == 0)
    assert score is not None and score.delay_ms is not None
    assert (score.moved, score.registered, score.far, score.far_registered) == (3, 2, 2, 0)
    assert (score.unmoved, score.unmoved_registered) == (3, 2)
    assert (score.nearly, score.nearly_registered) == (2, 1)
    assert (score.delay_ms.p50, score.delay_ms.max) == (120.0, math.inf)
    assert impact_score(np.empty(0), np.empty(0), np.empty(0, np.bool_)) is None


def test_an_answer_to_an_impact_is_neither_false_nor_a_slip_and_a_missed_impact_costs() -> None:
    recording = struck((2.0, 0.003), (4.0, 0.0))
    slip = recording.slip.copy()
    slip[700:750] = True
    recording = type(recording)(**{k: getattr(recording, k) for k in recording.__struct_fields__}
                                | {"slip": slip})  # fmt: skip
    (hit,) = sweep([said(recording, 205, 402, 702)], [ALARM])
    (miss,) = sweep([said(recording, 702)], [ALARM])
    assert (hit.false_per_min, hit.recall, hit.false_impacts) == (0.0, 1.0, 1.0)
    assert (miss.recall, miss.false_impacts) == (1.0, 0.0)
    assert np.isclose(hit.mean_delay_ms, (20.0 + 20.0) / 2)
    assert np.isclose(miss.mean_delay_ms, (20.0 + 500.0) / 2)


def test_a_rule_that_answers_impacts_that_move_nothing_is_not_chosen_however_quick() -> None:
    recording = struck(*((2.0 + 0.6 * k, 0.0) for k in range(8)), (7.0, 0.003))
    p = said(recording, 262, 703).probabilities
    p[702] = 0.6  # the bold one is a sample quicker, and answers an impact in nine
    slip = recording.slip.copy()
    slip[800:850], p[800:850] = True, 0.95
    p[262:265] = 0.6
    recording = type(recording)(**{k: getattr(recording, k) for k in recording.__struct_fields__}
                                | {"slip": slip})  # fmt: skip
    bold, careful = (RuleSettings(consecutive=1, threshold=t) for t in (0.5, 0.7))
    points = sweep([Streamed(recording, p, np.empty(0))], [bold, careful])
    assert points[0].mean_delay_ms < points[1].mean_delay_ms
    chosen = best(points, 60.0)
    assert chosen is not None and chosen.rule == careful
