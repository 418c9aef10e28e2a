"""Metrics of samples and events, compared with values counted by hand."""

import itertools
import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.recordings import Metadata, Recording
from detector.scores.evaluation import (
    Streamed,
    evaluate_recording,
    evaluate_streams,
)
from detector.scores.events import (
    EventOutcomes,
    event_figures,
    false_rate,
    recall,
    score_events,
    slips_of,
    true_events,
)
from detector.scores.figures import Figure, samples_of
from detector.scores.metrics import (
    auc,
    calibration_error,
    confusion,
)
from drivers.errors import BadFile


def flags(*runs: int) -> NDArray[np.bool_]:
    """Runs of static, slip, static ... of these lengths."""
    return np.repeat(np.arange(len(runs)) % 2 == 1, runs)


def times(n: int) -> NDArray[np.float64]:
    return np.arange(n) * 0.01


def outcomes_of(slip: NDArray[np.bool_], events: list[list[int]], **more: object) -> EventOutcomes:
    registered = np.array(events, np.intp).reshape(-1, 2)
    found = slips_of(slip, times(len(slip)), **more)  # type: ignore[arg-type]
    return score_events(registered, found)


def near(*values: float) -> object:
    return pytest.approx(values)


class Scripted:
    """A detector with scripted probabilities."""

    name = "scripted"
    threshold = 0.5

    def __init__(self, *fingers: NDArray[np.float64]) -> None:
        self._script = np.stack(fingers, axis=1)

    def reset(self) -> None:
        self._at = 0

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        self._at += 1
        return self._script[self._at - 1]


def recording(slip: NDArray[np.bool_], fingers: int = 1) -> Recording:
    counts = np.zeros((len(slip), fingers, 6), np.int16)
    return Recording(times(len(slip)), counts, slip, None, "by hand")


# --- samples


def test_confusion_matrix_has_textbook_metrics() -> None:
    labels = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 1], bool)
    predictions = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1, 0], bool)
    c = confusion(predictions, labels)
    assert (c.static_static, c.static_slip, c.slip_static, c.slip_slip) == (4, 2, 1, 3)
    assert c.accuracy == 0.7
    assert c.balanced_accuracy == pytest.approx((4 / 6 + 3 / 4) / 2)
    assert c.slip_f1 == pytest.approx(2 * 0.6 * 0.75 / (0.6 + 0.75))
    static_f1 = 2 * 0.8 * (4 / 6) / (0.8 + 4 / 6)
    assert c.weighted_f1 == pytest.approx(0.6 * static_f1 + 0.4 * c.slip_f1)


@given(st.lists(st.tuples(st.sampled_from([0.0, 0.1, 0.5, 0.7, 1.0]), st.booleans()), min_size=2))
def test_auc_is_the_share_of_correctly_ordered_pairs(pairs: list[tuple[float, bool]]) -> None:
    slip = [p for p, label in pairs if label]
    static = [p for p, label in pairs if not label]
    won = [(a > b) + 0.5 * (a == b) for a, b in itertools.product(slip, static)]
    found = auc(np.array([p for p, _ in pairs]), np.array([label for _, label in pairs]))
    assert found == (pytest.approx(sum(won) / len(won)) if won else None)


def test_bootstrap_resamples_whole_strokes_and_is_reproducible() -> None:
    labels = flags(50, 50, 50, 50, 50, 50)
    p = labels.astype(float)
    p[250:] = 0.0  # one stroke of three is missed
    area = samples_of([(p, labels)]).auc()
    assert area == Figure(pytest.approx(5 / 6), 0.5, 1.0)
    assert samples_of([(p, labels)]).auc() == area
    assert samples_of([(p[:150], labels[:150])]).auc() == Figure(1.0), "one stroke: no interval"


def test_calibration_error_is_the_difference_of_probability_and_frequency() -> None:
    labels = np.array([0, 0, 1, 1], bool)
    assert calibration_error(labels.astype(float), labels) == 0.0
    assert calibration_error(np.array([0.25, 0.25, 0.95, 0.95]), labels) == pytest.approx(0.15)
    assert calibration_error(np.array([1.0, 1.0, 0.0, 0.0]), labels) == 1.0
    assert calibration_error(np.full(4, 0.5), labels) == 0.0


# --- events


def test_short_static_gaps_do_not_split_a_slip() -> None:
    slip = flags(5, 10, 3, 10, 12, 4)
    assert true_events(slip, times(len(slip)), 0.0).tolist() == [[5, 15], [18, 28], [40, 44]]
    assert true_events(slip, times(len(slip)), 0.1).tolist() == [[5, 28], [40, 44]]
    assert true_events(slip, times(len(slip)), 1.0).tolist() == [[5, 44]]
    assert true_events(flags(5), times(5), 0.1).shape == (0, 2)


def test_detected_slip_has_a_delay_and_a_release_delay() -> None:
    m = outcomes_of(flags(100, 50, 100), [[104, 155]])
    assert (m.delays_ms, m.releases_ms) == (near(40.0), near(50.0))
    assert (m.missed, m.good, m.false) == (0, 1, 0)
    figures = event_figures([m])
    for name, value in (("slips", 1), ("recall", 1.0), ("precision", 1.0), ("false_per_min", 0.0)):
        assert figures[name] == Figure(value), name


def test_missed_slip_has_an_infinite_delay() -> None:
    m = outcomes_of(flags(100, 50, 100, 30, 100), [[102, 160]])
    assert (recall([m]), m.missed) == (0.5, 1)
    assert (m.delays_ms, m.releases_ms) == (near(20.0, math.inf), near(100.0))


def test_event_that_starts_in_static_time_is_false_and_counts_per_static_minute() -> None:
    m = outcomes_of(flags(3000, 50, 2950), [[500, 520], [3010, 3040], [4000, 4003]])
    assert (m.false, event_figures([m])["precision"].value) == (2, pytest.approx(1 / 3))
    assert false_rate([m]) == pytest.approx(2 / (59.5 / 60))


def test_event_that_started_before_a_slip_does_not_detect_it() -> None:
    m = outcomes_of(flags(100, 50, 100, 50, 100), [[10, 400]])
    assert (m.missed, m.false, m.good, len(m.releases_ms)) == (2, 1, 0, 0)


def test_event_may_start_20_ms_before_the_label() -> None:
    early = outcomes_of(flags(100, 50, 100), [[98, 150]])
    assert (early.missed, early.false, early.delays_ms) == (0, 0, near(-20.0))
    assert outcomes_of(flags(100, 50, 100), [[97, 150]]).false == 1


def test_second_event_in_a_slip_is_not_false_and_its_end_is_the_release() -> None:
    m = outcomes_of(flags(100, 50, 100), [[105, 120], [130, 148]])
    assert (m.good, m.false) == (2, 0)
    assert (m.delays_ms, m.releases_ms) == (near(50.0), near(-20.0))


def test_slips_and_false_events_before_the_first_sample_are_not_counted() -> None:
    slip = flags(20, 50, 100, 50, 100)
    m = outcomes_of(slip, [[5, 10], [60, 75], [175, 220]], first_sample=50)
    assert (m.good, m.false, m.delays_ms) == (1, 0, near(50.0))
    assert outcomes_of(slip, [], first_sample=170).missed == 1
    assert outcomes_of(slip, [], first_sample=171).missed == 0


def test_slip_at_the_end_of_the_data_ends_with_the_last_sample() -> None:
    assert outcomes_of(flags(50, 50), []).delays_ms == near(math.inf)
    caught = outcomes_of(flags(50, 50), [[60, 100]])
    assert caught.releases_ms == near(0.0)


def test_with_a_speed_delays_are_given_in_mm_too() -> None:
    slip = flags(100, 50, 100, 50, 100)
    m = outcomes_of(slip, [[105, 150], [249, 300]], speed_mps=np.where(slip, 0.05, 0.0))
    assert m.delays_mm == near(2.5, 0.0)
    assert outcomes_of(slip, []).delays_mm is None


def creeping(slip: NDArray[np.bool_], samples: int, gap: int = 0) -> NDArray[np.float64]:
    """Speed with creep before the first rise of the label, and a gap of rest in it."""
    speed = np.where(slip, 0.01, 0.0)
    onset = int(slip.argmax())
    speed[onset - samples : onset] = 1e-3
    speed[onset - gap - 1 : onset - 1] = 0.0
    return speed


def test_event_during_creep_before_the_label_is_early_and_not_false() -> None:
    for begins, hit in [(92, True), (91, False), (97, True)]:
        slip = flags(100, 30, 70)
        m = outcomes_of(slip, [[begins, 120]], speed_mps=creeping(slip, 8))
        assert (m.missed, m.false) == ((0, 0) if hit else (1, 1)), (begins, hit)


def test_late_event_of_one_slip_is_not_an_early_event_of_the_next() -> None:
    """The contact creeps between the slips, as for a dragged object."""
    slip = flags(100, 11, 24, 65)
    creeps = np.full(200, 2e-3)
    late, early = (outcomes_of(slip, [[begins, 140]], speed_mps=creeps) for begins in (112, 122))
    assert (late.missed, late.false) == (2, 1)
    assert (early.missed, early.false) == (1, 0)


# --- the whole evaluation


def test_evaluation_of_a_scripted_detector_is_as_counted_by_hand() -> None:
    slip = flags(110, 40, 60)
    p = flags(113, 40, 57).astype(float)
    ticks = itertools.count(0, 5_000)

    class SlowToStart(Scripted):
        def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
            nonlocal ticks
            if not hasattr(self, "started"):  # as where code is compiled
                self.started, ticks = True, itertools.count(10**9, 5_000)
            return super().update(counts)

    detector = SlowToStart(p, np.zeros(210))
    e = evaluate_recording(
        detector, RuleSettings(), recording(slip, 2), clock_ns=lambda: next(ticks)
    )
    assert (e.detector, e.data, e["samples"]) == ("scripted", "by hand", 110)
    assert e["accuracy"] == pytest.approx(104 / 110)
    assert (e["slips"], e["missed"], e["false_alarms"]) == (1, 0, 0)
    assert e["delay_p50_ms"] == pytest.approx(40.0)  # 3 samples late, registered by the 2nd
    assert e["release_p50_ms"] == pytest.approx(50.0)  # 3 samples late, released by the 3rd
    assert (e["update_p50_us"], e["update_p99_us"]) == (5.0, 5.0)
    assert (e["threshold"], e.figures["auc"].low) == (0.5, None)


# --- several recordings


def metadata(cause: str) -> Metadata:
    return Metadata(
        set="disturbances" if cause else "slide", split="test", surface="planar", motion="none",
        speed_mps=0.0, spin_radps=0.0, direction="", seed=0, cause=cause,
    )  # fmt: skip


def streamed(slip: NDArray[np.bool_], p: NDArray[np.bool_], cause: str = "") -> Streamed:
    made = msgspec.structs.replace(recording(slip), metadata=metadata(cause))
    return Streamed(made, p.astype(float)[:, None], np.empty(0))


def test_metrics_pool_recordings_and_list_false_events_by_cause() -> None:
    caught = streamed(flags(300, 50, 250), flags(305, 45, 250))
    shaken = streamed(flags(600), flags(200, 10, 100, 10, 280), "tightening")
    e = evaluate_streams(Scripted(np.zeros(1)), RuleSettings(), [caught, shaken], "both")
    assert (e["recordings"], e["samples"]) == (2, 1000)
    assert (e["slips"], e["missed"], e["false_alarms"]) == (1, 0, 2)
    assert e["delay_p50_ms"] == pytest.approx(60.0)
    # one finger each: a hand of three has three times the false alarms
    rate = e.figures["false_per_min"]
    assert rate.value == pytest.approx(3 * 2 / (9.5 / 60))
    assert (rate.low, rate.high) == (0.0, pytest.approx(3 * 2 / (5.0 / 60)))
    assert e["false_per_min, slide"] == 0.0
    assert e["false_per_min, tightening"] == pytest.approx(3 * 2 / (5.0 / 60))


def test_another_label_can_be_scored_and_is_refused_if_it_is_missing() -> None:
    slip, slip_true = flags(200, 50, 50), flags(220, 30, 50)
    made = msgspec.structs.replace(recording(slip), slip_true=slip_true)
    results = [
        evaluate_streams(
            Scripted(np.zeros(1)), RuleSettings(), [Streamed(made, p, np.empty(0), label)], "x"
        )
        for label in ("slip", "slip_true")
        for p in [slip_true.astype(float)[:, None]]
    ]
    assert [e["accuracy"] for e in results] == [pytest.approx(180 / 200), 1.0]
    with pytest.raises(BadFile, match="by hand: has no slip_true"):
        Streamed(recording(slip), np.zeros((300, 1)), np.empty(0), "slip_true").labels  # noqa: B018


def test_detection_of_pad_shear_before_sliding_is_early_and_not_false() -> None:
    slip, slip_true = flags(200, 50, 50), flags(210, 40, 50)
    made = msgspec.structs.replace(recording(slip), slip_true=slip_true)
    output = flags(203, 47, 50).astype(float)[:, None]
    sheet = evaluate_streams(
        Scripted(np.zeros(1)),
        RuleSettings(),
        [Streamed(made, output, np.empty(0), "slip_true")],
        "x",
    )
    assert (sheet["missed"], sheet["false_alarms"]) == (0, 0)
    assert sheet["delay_p50_ms"] == pytest.approx(-60.0)
