"""The lift as a closed loop over the device models, with every outcome."""

from pathlib import Path

import pytest

from grasp.control.states import State
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from tests.unit.scenarios.conftest import (
    Staged,
    config,
    in_phase,
    judged,
    phases_without_feel,
)
from tests.unit.scenarios.lift.device_faults import interrupt


def test_slip_of_a_weakly_grasped_can_is_detected_and_compensated(plain_lift: LiftResult) -> None:
    r = plain_lift
    assert r.success
    assert r.outcome == "held_within_6cm"
    phases = phases_without_feel(r)
    pauses = phases.count("compensate")
    assert 0 < pauses < 4
    assert phases == [
        "approach.shape", "grasp.tare", "grasp.brace", "grasp.close", "grasp.settle",
        "grasp.baseline", "lift", *("compensate", "lift") * pauses, "hold", "lower.descend",
        "release.open", "release.retreat", "done.set_down",
    ]  # fmt: skip
    assert r.slip_onset_s is not None
    assert r.first_detection_s is not None
    assert r.slip_registered_s is not None
    assert r.slip_onset_s < r.first_detection_s < r.slip_registered_s
    assert r.slip_distance_m is not None
    assert 0.0002 < r.slip_distance_m < 0.06
    following = zip(r.phases, r.phases[1:], strict=False)
    compensate_s = sum(b.t_s - a.t_s for a, b in following if a.phase == "compensate")
    assert 0.9 * compensate_s < r.paused_s < compensate_s  # without the braking of the arm


@pytest.mark.parametrize("name", ["box", "cardboard", "ball", "football", "foam"])
def test_default_controller_holds_every_object(name: str) -> None:
    assert judged(object_name=name).success


@pytest.mark.parametrize("seed", range(2))
def test_true_peak_of_the_reference_hand_stays_within_a_newton_of_the_limit(seed: int) -> None:
    r = judged(seed=seed)
    assert r.peak_force_n is not None
    assert 9.5 < max(r.peak_force_n.values()) < 10.5
    assert r.commanded_force_n <= 10.0


def test_can_is_dropped_with_a_detector_that_misses_slip() -> None:
    r = judged("energy.threshold_counts=400")
    assert r.slip_registered_s is None
    assert r.outcome == "dropped"


def test_lift_without_slip_is_no_success() -> None:
    r = judged("object.mass_kg=0.1", "object.added_mass_kg=0", "object.grip_counts=[57,56,56]")
    assert r.outcome == "never_slipped"
    assert not r.success


def test_detector_with_an_immediate_alarm_is_a_false_start() -> None:
    r = judged("energy.threshold_counts=0.3")
    assert r.outcome == "false_start"
    assert r.slip_registered_s is not None


def test_object_too_heavy_for_the_limit_is_lowered_with_outcome_limit_reached() -> None:
    r = judged("object.mass_kg=2.5")
    assert r.outcome == "limit_reached"
    assert "lower.descend" in [p.phase for p in r.phases]
    assert r.peak_force_n is not None
    assert max(r.peak_force_n.values()) < 11.0


ONE_CLOSING = 'controller.closing="constant"'


def test_start_up_override_exceeds_the_limit_in_one_closing_but_not_in_two_stages() -> None:
    override = ("hand.override_s=0.1", "hand.override_n=30")
    assert judged(*override, ONE_CLOSING).outcome == "over_force"
    staged = judged(*override)
    assert staged.success and staged.peak_force_n is not None
    assert max(staged.peak_force_n.values()) < 11.0


def test_set_down_leaves_the_object_on_the_table_where_it_was() -> None:
    staged = Staged()
    staged.run(in_phase(State.SET_DOWN), interrupt)
    truth = staged.rig.truth()
    assert truth is not None
    assert truth.height_m == 0.0
    assert not truth.touched


def test_equal_seeds_leave_byte_identical_recordings_and_other_seeds_do_not(tmp_path: Path) -> None:
    data = []
    for seed in (0, 0, 1):
        result = lift.run(config(), seed, tmp_path).result
        assert result is not None
        assert result.recording is not None
        data.append(Path(result.recording).read_bytes())
    assert data[0] == data[1]
    assert data[0] != data[2]
