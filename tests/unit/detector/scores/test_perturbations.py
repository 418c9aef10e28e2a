import msgspec
import numpy as np
import pytest

from detector.blows import blows_of
from detector.recordings import read, write
from detector.scores.perturbations import PERTURBATIONS, RAIL_COUNTS, at_rate, perturbed
from tests.unit.detector.blow_toys import struck
from tests.unit.detector.toys import toy

HAND = struck((3.0, 0.003), (6.0, 0.0))


def changes(kind, amount, recording=HAND):
    return perturbed(recording, kind, amount).counts.astype(float) - recording.counts


def test_a_perturbed_recording_keeps_times_labels_and_acts_and_can_be_written(tmp_path):
    for kind in PERTURBATIONS:
        changed = perturbed(HAND, kind, 1.5)
        write(tmp_path / "changed.npz", changed)
        again = read(tmp_path / "changed.npz")
        assert (again.counts == changed.counts).all(), kind
        assert (changed.t_s == HAND.t_s).all() and (changed.slip == HAND.slip).all(), kind
        assert changed.metadata == HAND.metadata, kind


def test_equal_seeds_give_equal_recordings_and_the_original_stays_as_it_was():
    for kind in PERTURBATIONS:
        before = HAND.counts.copy()
        one, other = (perturbed(HAND, kind, 1.5, seed=3).counts for _ in range(2))
        assert (one == other).all() and (HAND.counts == before).all(), kind


def test_gain_scales_counts_and_leaves_a_taxel_at_its_rail():
    counts = np.array([[[-100, 50, -300, -480, 0, 3]]], np.int16)
    one = msgspec.structs.replace(toy(1, "test"), counts=counts)
    assert perturbed(one, "gain", 2.0).counts.tolist() == [[[-200, 100, RAIL_COUNTS, -480, 0, 6]]]
    assert perturbed(one, "gain", 0.5).counts[0, 0, :3].tolist() == [-50, 25, -150]


def test_a_lost_sample_repeats_the_one_before_at_every_finger():
    changed = perturbed(HAND, "lost", 0.1).counts
    repeats = (changed[1:] == changed[:-1]).all(axis=(1, 2))
    assert repeats.mean() == pytest.approx(0.1, abs=0.03)
    assert (changed[1:][~repeats] == HAND.counts[1:][~repeats]).all()


def test_temperature_steps_move_all_taxels_alike_and_back_again():
    moved = changes("temperature", 10.0)
    assert np.ptp(moved, axis=(1, 2)).max() == 0
    assert moved[0].max() == 0 and moved[350].max() == 16 and moved[790].max() == 0


def test_drift_takes_each_taxel_its_own_way():
    moved = changes("drift", 60.0)
    assert np.abs(moved[-1]).tolist() == np.full((3, 6), 9.0).tolist()  # in 9 s
    assert {-9.0, 9.0} == set(moved[-1].ravel())


def test_one_finger_alone_has_the_broken_taxel_and_it_is_the_one_pressed_most():
    for kind in ["dead", "stuck", "swapped"]:
        touched = np.argwhere(changes(kind, 1.0).any(axis=0))
        assert set(touched[:, 0]) == {0}, kind
        assert HAND.counts[:, 0].mean(axis=0).argmin() in touched[:, 1], kind


def test_a_dead_taxel_reads_rest_and_a_stuck_one_never_changes():
    worst = HAND.counts[:, 0].mean(axis=0).argmin()
    assert not perturbed(HAND, "dead", 1.0).counts[:, 0, worst].any()
    assert np.ptp(perturbed(HAND, "stuck", 1.0).counts[:, 0, worst]) == 0


def test_at_another_rate_blows_and_slips_come_when_they_came():
    for hertz in [90.0, 110.0]:
        slow = at_rate(HAND, hertz)
        assert len(slow.t_s) == pytest.approx(len(HAND.t_s) * hertz / 100, abs=2), hertz
        was = [HAND.t_s[b.struck] for b in blows_of(HAND)]
        assert [slow.t_s[b.struck] for b in blows_of(slow)] == pytest.approx(was, abs=0.012), hertz
        assert slow.slip_true.mean() == pytest.approx(HAND.slip_true.mean(), abs=0.002), hertz
        assert np.abs(slow.counts[500] - HAND.counts[round(500 * 100 / hertz)]).max() < 30, hertz
