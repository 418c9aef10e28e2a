"""How soon slip of a lift could be told, and what a detector's rule makes of the same lifts."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import write
from scenarios.studies.detectors.observer import Cases
from scripts.last_draw import FIRST_SEED, Draw
from scripts.lift_bound import (
    TIMES_S,
    Floats,
    Scores,
    all_slips,
    detector_row,
    heard_of,
    interval,
    lifts_in,
    scores_row,
    share,
    soonest_ms,
    surest,
)
from tests.unit.detector.toys import toy

RISING = [0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.9]  # at TIMES_S


def cases(classes: list[int], answers_s: list[float]) -> Cases:
    n = len(classes)
    return Cases(
        counts=np.zeros((n, 100, 3, 6)), before=50, period_s=0.01, lasts=np.full(n, 50),
        classes=np.array(classes), groups=np.arange(n), said={},
        answers_s={"tcn": np.array(answers_s)},
    )  # fmt: skip


def scored(lifts: Floats, rest: Floats, of: int = 1) -> Scores:
    """So many of each, one after the other, belong together."""
    return Scores(lifts, rest, np.arange(len(lifts)) // of, np.arange(len(rest)) // of)


def test_interval_is_wider_where_moments_belong_together() -> None:
    rng = np.random.default_rng(3)
    rest, lifts = (np.repeat(rng.normal(mean, 1.0, 30), 4) for mean in (0.0, 1.0))
    (low, high), (lower, higher) = (interval(scored(lifts, rest, of), 0.05) for of in (1, 4))
    assert higher - lower > 1.3 * (high - low)


@pytest.mark.parametrize(("wanted", "ms"), [(0.1, 25.0), (0.5, 60.0), (0.9, 150.0), (0.95, np.inf)])
def test_time_at_which_a_share_is_told_lies_on_a_line_between_those_asked_about(
    wanted: float, ms: float
) -> None:
    assert soonest_ms(RISING, wanted) == pytest.approx(ms)


def test_share_that_falls_later_was_told_all_the_same() -> None:
    assert soonest_ms([0.6, 0.5, 0.4, 0.4, 0.4, 0.4, 0.4], 0.5) < 1e3 * TIMES_S[0]


def test_lifts_count_that_score_above_all_but_so_much_of_rest() -> None:
    scores = scored(np.array([5.0, 15.0, 18.5, 30.0]), np.arange(20.0))
    assert share(scores, 0.0) == 0.25
    assert share(scores, 0.05) == 0.5
    low, high = interval(scores, 0.05)
    assert low <= 0.5 <= high and (low, high) == interval(scores, 0.05)


def test_row_of_the_observer_has_all_times_and_when_half_and_nine_tenths_are_told() -> None:
    rest = np.zeros(40)
    every = [scored(np.where(np.arange(10) < 10 * p, 1.0, -1.0), rest) for p in RISING]
    idle, *told, half, late = scores_row(every, 0.05)
    assert (idle, len(told), half, late) == ("5", len(TIMES_S), "60", "150")
    assert told[3].startswith("60 [")


def test_detector_is_told_when_by_the_most_that_it_said_since() -> None:
    said = np.tile(np.arange(50.0), (4, 1)) * np.array([[1.0], [2.0], [3.0], [4.0]])
    asked, drawn = (
        msgspec.structs.replace(cases(classes, [np.inf] * 4), said={"tcn": said})
        for classes in ([1, 1, 1, 1], [0, 2, 0, 0])
    )
    drawn = msgspec.structs.replace(drawn, lasts=np.array([50, 50, 3, 50]))
    found = surest(asked, drawn, np.array([7, 7, 8, 8]), "tcn", 0.05)
    assert found.lifts.tolist() == [4.0, 8.0, 12.0, 16.0]
    assert (found.rest.tolist(), found.recordings.tolist()) == ([4.0, 16.0], [0, 3])
    assert found.objects.tolist() == [7, 7, 8, 8]


def test_row_of_a_detector_counts_its_own_answers_and_those_to_moments_of_rest() -> None:
    asked = cases([1, 1, 1, 1], [0.02, 0.04, 0.09, np.inf])
    drawn = cases([0, 0, 0, 0, 2], [0.3, np.inf, np.inf, 0.6, 0.01])
    assert detector_row(asked, drawn, "tcn") == [
        "25", "25", "25", "50", "50", "75", "75", "75", "40", "inf",
    ]  # fmt: skip


def test_lifts_of_the_draw_go_on_slipping_and_detectors_hear_them_from_the_last_reset_on() -> None:
    (slipped,) = all_slips(Draw(FIRST_SEED - 7, 0, 1), "can")  # of no draw
    before, after = slipped.onset, len(slipped.t_s) - slipped.onset
    assert slipped.t_s[before - 1] <= slipped.onset_s < slipped.t_s[before]
    assert before > 50 and after > 100  # half a second before, and nobody ends it
    assert slipped.counts.shape[1:] == (3, 6)
    assert 0 < slipped.reset < before
    (streamed,) = heard_of(["tcn"], [slipped])["tcn"]
    p = streamed.probabilities
    assert len(p) == len(slipped.t_s)
    assert not p[: slipped.reset].any() and p[slipped.reset :].all()


def test_data_without_lifts_that_slip_and_lifts_that_hold_are_refused(tmp_path: Path) -> None:
    finger = toy(0, "test")
    hand = msgspec.structs.replace(finger, counts=np.repeat(finger.counts, 3, axis=1))
    write(tmp_path / "hand.npz", hand)
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(SystemExit, match=r"lifts that slip are needed|none"):
            lifts_in([folder])
