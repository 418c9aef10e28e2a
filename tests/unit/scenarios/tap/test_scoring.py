"""Each rule of the tap's verdict, with hand-made facts."""

import msgspec
import pytest

from scenarios.tap.scoring import (
    MOVED_M,
    MOVED_RAD,
    Alarm,
    ObjectMotion,
    TapFacts,
    TapOutcome,
    nominal_again_s,
    verdict,
)

MOVED = ObjectMotion(impact_s=9.99, from_s=10.0, until_s=10.02, displacement_m=0.006)
STUCK = ObjectMotion(impact_s=9.99, from_s=None, until_s=None, displacement_m=0.0004)


def facts(
    *alarms: tuple[float, float | None], motion: ObjectMotion | None = MOVED, **more: object
) -> TapFacts:
    plain: dict[str, object] = {
        "motion": motion, "alarms": [Alarm(*a) for a in alarms], "watched_until_s": 13.0,
        "peak_before_n": 10.5, "force_bound_n": 11.0,
    }  # fmt: skip
    return TapFacts(**{**plain, **more})  # type: ignore[arg-type]


def test_registered_in_time_and_nominal_again_is_the_success() -> None:
    assert verdict(facts((10.03, 10.16))) is TapOutcome.REGISTERED


def test_slip_must_be_registered_and_cleared_within_the_time_limits() -> None:
    for at_s, expected in ((10.499, "registered"), (10.501, "late")):
        assert verdict(facts((at_s, at_s + 0.1))) == expected
    for off_s, expected in ((11.01, "registered"), (11.03, "alarm_stayed")):
        assert verdict(facts((10.03, off_s))) == expected


@pytest.mark.parametrize(("again_s", "expected"), [(10.59, "alarm_stayed"), (10.61, "registered")])
def test_status_must_stay_nominal_for_the_stated_time(again_s: float, expected: str) -> None:
    # nominal at 10.1; the next alarm, longer than the limit, begins 0.49 or 0.51 s later
    assert verdict(facts((10.03, 10.1), (again_s, 11.5))) == expected


def test_unstable_status_counts_from_its_last_return_to_nominal() -> None:
    unstable = facts((10.03, 10.1), (10.2, 10.3))
    assert nominal_again_s(unstable, 10.02) == 10.3
    assert verdict(unstable) is TapOutcome.REGISTERED


def test_registration_between_impact_and_gross_slip_counts() -> None:
    assert verdict(facts((9.995, 10.1))) is TapOutcome.REGISTERED


def test_tap_that_moves_less_than_a_millimetre_has_its_own_outcomes() -> None:
    assert verdict(facts(motion=STUCK)) is TapOutcome.UNMOVED_QUIET
    assert verdict(facts((10.0, 10.2), motion=STUCK)) is TapOutcome.UNMOVED_REGISTERED
    just = msgspec.structs.replace(STUCK, displacement_m=0.001)
    assert verdict(facts(motion=just)) is TapOutcome.UNDETECTED


def test_rotation_in_the_hand_counts_as_motion() -> None:
    assert pytest.approx(0.003 / 0.2) == MOVED_M / MOVED_RAD
    replace = msgspec.structs.replace
    for turned, moved in ((0.066, False), (0.067, True), (-0.067, True)):
        assert replace(STUCK, turned_rad=turned).moved() is moved
    turned = replace(STUCK, turned_rad=-0.1)
    assert verdict(facts(motion=turned)) is TapOutcome.UNDETECTED
    assert verdict(facts((10.0, 10.2), motion=turned)) is TapOutcome.REGISTERED


def test_lost_object_is_knocked_out_even_with_registered_slip() -> None:
    lost = msgspec.structs.replace(MOVED, held=False)
    assert verdict(facts((10.03, 10.1), motion=lost)) is TapOutcome.KNOCKED_OUT


def test_trial_without_a_nominal_status_has_no_tap() -> None:
    assert verdict(facts((3.0, None), motion=None)) is TapOutcome.NEVER_NOMINAL


def test_fault_and_excess_force_of_the_hand_have_priority() -> None:
    assert verdict(facts((10.03, 10.1), fault="x")) is TapOutcome.FAULT
    assert verdict(facts((10.03, 10.1), peak_before_n=11.1)) is TapOutcome.OVER_FORCE
    both = facts((10.03, 10.1), fault="x", peak_before_n=11.1)
    assert verdict(both) is TapOutcome.OVER_FORCE


def test_status_observed_for_too_short_is_not_nominal_again() -> None:
    assert nominal_again_s(facts((10.03, 10.1), watched_until_s=10.5), 10.02) is None
