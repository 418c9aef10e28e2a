"""Scores of impacts: those that moved the object, and those that did not."""

import math

import numpy as np

from detector.decision import RuleSettings
from detector.recordings import Recording
from detector.scores.evaluation import Streamed
from detector.scores.impacts import impact_delays, impact_score, impacts_of
from detector.scores.sweep import best, sweep
from tests.unit.detector.impact_recordings import impact_recording

ALARM = RuleSettings(consecutive=1)


def streamed(recording: Recording, *alarms: int) -> Streamed:
    """Detector output with alarms of three samples, which start at these samples."""
    p = np.zeros((len(recording.t_s), recording.fingers))
    for first in alarms:
        p[first : first + 3] = 0.9
    return Streamed(recording, p, np.empty(0))


def test_impact_ends_at_the_next_disturbance_and_its_onset_is_the_first_motion() -> None:
    first, second = impacts_of(impact_recording((2.0, 0.003), (2.3, 0.0)))
    assert (first.start, first.onset, first.end) == (200, 203, 230)
    assert (second.start, second.onset, second.end) == (230, 230, 280)
    assert (first.moved_m, second.moved_m) == (0.003, 0.0)


def test_event_that_starts_in_the_time_of_an_impact_detects_it() -> None:
    recording = impact_recording((2.0, 0.003), (4.0, 0.003), (6.0, 0.003))
    registered = np.array([[190, 300], [405, 410], [655, 660]])  # started before; in time; too late
    found = impact_delays(registered, impacts_of(recording), recording.t_s)
    assert np.allclose(found, [math.inf, 20.0, math.inf])


def test_impacts_are_scored_by_lasting_displacement() -> None:
    moved_m = np.array([0.0, 0.0001, 0.0004, 0.0007, 0.0015, 0.003, 0.005])
    delays_ms = np.array([20.0, math.inf, 30.0, 30.0, 40.0, 120.0, math.inf])
    score = impact_score(moved_m, delays_ms, weak=np.arange(7) == 0)
    assert score is not None and score.delay_ms is not None
    assert (score.moved, score.registered, score.far, score.far_registered) == (3, 2, 2, 0)
    assert (score.unmoved, score.unmoved_registered) == (3, 2)
    assert (score.unmoved_strong, score.unmoved_strong_registered) == (2, 1)
    assert (score.delay_ms.p50, score.delay_ms.max) == (120.0, math.inf)
    assert impact_score(np.empty(0), np.empty(0), np.empty(0, np.bool_)) is None


def test_event_of_an_impact_is_neither_false_nor_a_slip_and_a_miss_adds_delay() -> None:
    recording = impact_recording((2.0, 0.003), (4.0, 0.0))
    slip = recording.slip.copy()
    slip[700:750] = True
    recording = type(recording)(**{k: getattr(recording, k) for k in recording.__struct_fields__}
                                | {"slip": slip})  # fmt: skip
    (hit,) = sweep([streamed(recording, 205, 402, 702)], [ALARM])
    (miss,) = sweep([streamed(recording, 702)], [ALARM])
    assert (hit.false_per_min, hit.recall, hit.false_impacts) == (0.0, 1.0, 1.0)
    assert (miss.recall, miss.false_impacts) == (1.0, 0.0)
    assert np.isclose(hit.mean_delay_ms, (20.0 + 20.0) / 2)
    assert np.isclose(miss.mean_delay_ms, (20.0 + 500.0) / 2)


def test_fast_rule_that_registers_impacts_without_motion_is_not_chosen() -> None:
    recording = impact_recording(*((2.0 + 0.6 * k, 0.0) for k in range(8)), (7.0, 0.003))
    p = streamed(recording, 262, 703).probabilities
    p[702] = 0.6  # the bold rule is one sample faster and registers one impact in nine
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
