import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from grasp.settings import file_of
from scenarios.acquire.datasets.plan import first_of_each, load_dataset_config, plan
from scenarios.studies.detectors.observer import (
    BLOW_TITLES,
    Cases,
    blow_moments,
    cases,
    features,
    hits,
    lift_moments,
    loudest,
    point,
    told,
)
from tests.unit.detector.blow_toys import struck
from tests.unit.detector.toys import toy


def case(classes, said, answers=None, lasts=50):
    n = len(classes)
    return Cases(
        counts=np.zeros((n, 100, 3, 6)), before=50, period_s=0.01, lasts=np.full(n, lasts),
        classes=np.array(classes), groups=np.arange(n) % 7, said={"it": np.array(said, float)},
        answers_s={"it": np.array(answers if answers is not None else np.full(n, np.inf))},
    )  # fmt: skip


def lift(grip, onset, speed_mps, seed=0):
    """A hand that grips at a sample and whose object slips from another on, if at all."""
    n = 900
    counts = np.random.default_rng(seed).integers(-1, 2, (n, 3, 6)).astype(np.int16)
    counts[grip:800] -= 60
    slip = np.zeros(n, bool)
    if onset is not None:
        slip[onset : onset + 80] = True
    metadata = msgspec.structs.replace(toy(0, "test").metadata, acts=())
    speed = np.where(slip, speed_mps, 0.0).astype(np.float32)
    return Recording(
        np.arange(n) * 0.01, counts, slip, slip, "lift", metadata, contact_speed_mps=speed
    )


def test_a_blow_is_of_the_class_that_it_moved_what_is_held_by():
    moments = blow_moments([struck((3.0, 0.0), (4.5, 0.0007)), struck((3.0, 0.0015), (4.5, 0.004))])
    assert [(m.recording, m.kind) for m in moments] == [(0, 0), (0, 1), (1, 2), (1, 3)]


def test_lifts_that_hold_are_looked_at_as_long_after_the_grip_as_others_slip():
    made = [lift(100, 160, 0.01), lift(150, 230, 0.1), lift(200, None, 0.0)]
    moments = lift_moments(made)
    assert [(m.recording, m.sample, m.kind) for m in moments[:2]] == [(0, 160, 1), (1, 230, 3)]
    assert {m.kind for m in moments[2:]} == {0} and {m.recording for m in moments[2:]} == {2}
    assert {m.sample for m in moments[2:]} <= {200 + 60, 200 + 80}


def test_what_is_known_so_late_does_not_depend_on_what_comes_later():
    hand = struck((3.0, 0.003))
    later = hand.counts.copy()
    later[305:] += 100  # five samples after the blow
    other = msgspec.structs.replace(hand, counts=later)
    one, two = (cases([r], blow_moments([r]), {}) for r in (hand, other))
    early = [features(c, 0.05) for c in (one, two)]
    late = [features(c, 0.06) for c in (one, two)]
    assert (early[0] == early[1]).all() and (late[0] != late[1]).any()


def test_a_shift_that_stays_is_seen_in_the_features():
    hand = struck((3.0, 0.003))
    moved = hand.counts.copy()
    moved[300:, 1, 2] -= 50
    other = msgspec.structs.replace(hand, counts=moved)
    one, two = (features(cases([r], blow_moments([r]), {}), 0.1) for r in (hand, other))
    assert np.abs(one - two).max() > 1.0


def test_hits_are_counted_above_all_but_a_twentieth_of_what_did_not_move():
    score = np.concatenate([np.arange(100.0), np.array([94.5, 93.0, 200.0, 201.0])])
    moved = np.arange(104) >= 100
    assert hits(score, moved) == pytest.approx(0.75)


def test_of_cases_that_were_over_nothing_is_told():
    said = [[0.0] * 50, [3.0] * 50, [-1.0] * 50]
    c = case([0, 3, 0], said)
    c = msgspec.structs.replace(c, lasts=np.array([50, 50, 5]))
    assert np.isnan(loudest(c, "it", 0.1)).tolist() == [False, False, True]
    found = told(c, loudest(c, "it", 0.1), 3, 0.1, BLOW_TITLES)
    assert (found.auc, found.n, found.idle) == (1.0, 1, 1)


def test_a_detector_is_scored_by_the_answers_of_its_own_rule_in_time():
    c = case([0, 0, 3, 3, 3], np.zeros((5, 50)), [0.3, np.inf, 0.05, 0.2, np.inf])
    own = point(c, "it", 3, 0.1, BLOW_TITLES)
    assert (own.idle, own.hits) == (0.5, pytest.approx(1 / 3))


def test_a_share_of_the_recordings_is_the_first_of_each_cause_so_a_larger_one_holds_it():
    jobs = plan(load_dataset_config(file_of("datasets", "observer")))
    few, more = (first_of_each(jobs, share) for share in (0.1, 0.2))
    assert {job.path for job in few} < {job.path for job in more}
    causes = [job.metadata.cause for job in few]
    assert (causes.count("grasped_blow"), causes.count("grasped_slip")) == (42, 35)


def test_the_observer_hears_networks_and_not_a_threshold_on_what_it_hears_anyway():
    c = case([0, 3], np.zeros((2, 50)))
    energy = msgspec.structs.replace(c, said=c.said | {"energy": np.ones((2, 50))})
    assert np.array_equal(features(energy, 0.1), features(c, 0.1))
    network = msgspec.structs.replace(c, said=c.said | {"gru": np.ones((2, 50))})
    assert features(network, 0.1).shape[1] == features(c, 0.1).shape[1] + 2
