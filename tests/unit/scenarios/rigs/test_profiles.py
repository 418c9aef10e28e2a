"""Profiles set detector, decision rule and slip response together."""

from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from tests.unit.scenarios.conftest import phases_without_feel


def paper(*assignments: str) -> LiftConfig:
    return load_config("can", "simulated", "energy", None, assignments, "paper").for_lift()


def test_thumb_bears_twice_the_limit_in_each_motor_mode_without_a_force_violation() -> None:
    result = lift.run(paper(), 0, None).result
    assert result is not None and result.peak_force_n is not None
    assert 18.0 < result.peak_force_n["A"] < 24.0
    assert result.commanded_force_n <= 10.0
    assert (result.force_limit_n, result.limit_mode) == (10.0, "each_motor")
    assert result.outcome != "over_force"


def test_paper_profile_continues_at_the_force_limit() -> None:
    """Its loop closes once and holds; a persistent alarm is reported but does not end the lift."""
    result = lift.run(paper("energy.threshold_counts=0.3"), 0, None).result
    assert result is not None
    assert result.outcome not in ("limit_reached", "alarm_stayed")
    assert phases_without_feel(result)[-4:] == [
        "lower.descend", "release.open", "release.retreat", "done.set_down",
    ]  # fmt: skip
    assert result.alarm_stayed
