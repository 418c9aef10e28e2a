"""Blows that moved nothing, told by when they were answered and by how far the fingertips stand."""

import msgspec
import numpy as np
import pytest

from scripts.idle_blows import Idle, by_course, foretold, of_recordings, table
from tests.unit.detector.blow_toys import struck


def idle(shift: float, soon: bool, late: bool = False) -> Idle:
    return Idle(0.1, shift, {"tcn": (soon, soon or late, False)})


KNOWN = [idle(1.0, False), idle(2.0, False), idle(3.0, True), idle(4.0, True)]


def test_only_blows_that_moved_nothing_are_looked_at() -> None:
    recording = struck((2.0, 0.003), (4.0, 0.0), (6.0, 0.0007))
    (only,) = of_recordings([recording], ["energy"])
    assert only.moved_mm == 0.0
    assert set(only.answered) == {"energy"}


def test_how_far_fingertips_stand_off_is_measured_across_the_blow() -> None:
    recording = struck((4.0, 0.0))
    counts = np.zeros_like(recording.counts)
    counts[402:] = 7  # all that follows the blow
    recording = type(recording)(**{
        **{f: getattr(recording, f) for f in recording.__struct_fields__}, "counts": counts,
    })  # fmt: skip
    (only,) = of_recordings([recording], ["energy"])
    assert only.shift_counts == 7.0


def test_what_validation_would_foretell_is_its_shares_in_the_classes_of_the_others() -> None:
    assert foretold([idle(3.5, False)] * 5, KNOWN, "tcn", [1.5, 2.5, 3.5]) == 1.0
    assert foretold([idle(0.0, True)] * 5, KNOWN, "tcn", [1.5, 2.5, 3.5]) == 0.0


def test_a_tap_answered_later_than_a_recording_watches_is_told_apart() -> None:
    every = {"validation": KNOWN, "the mallet's": [idle(1.0, False, late=True), idle(9.0, True)]}
    last = table(every, ["tcn"]).splitlines()[3]
    assert "1 (50.0 %" in last
    assert "2 (100.0 %" in last


def test_a_blow_is_told_by_its_kind_and_by_how_far_the_contact_slid_to_and_fro() -> None:
    recording = struck((2.0, 0.0), (4.0, 0.0))
    speed = np.zeros(len(recording.t_s), np.float32)
    speed[205:215], speed[215:225] = 0.05, -0.05  # there and back, after the first
    still, slid = (
        list(of_recordings([r], ["energy"]))
        for r in (recording, msgspec.structs.replace(recording, contact_speed_mps=speed))
    )
    assert {i.kind for i in slid} == {a.kind for a in recording.metadata.acts}  # type: ignore[union-attr]
    assert [i.slid_mm for i in slid] == pytest.approx([10.0, 0.0])
    assert np.isnan([i.slid_mm for i in still]).all()
    told = by_course({"validation": slid, "the mallet's": still}, ["energy"])
    assert "| slid 1-inf mm | 1 | 10.00 / 10.00 | 0 |" in told
    assert "| slid 0-0.3 mm | 1 | 0.00 / 0.00 | 0 |" in told
