"""Whole counts that hold an object too weakly: what is found, and that it holds in the lift."""

import json
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from scenarios.lift import lift
from scenarios.studies.grip_search import (
    GripCriteria,
    criteria,
    lifts_that_slip,
    present_grip,
    search,
    with_counts,
)
from tests.unit.grasp.cli.test_cli import call, run_json
from tests.unit.scenarios.conftest import config

OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")


@pytest.mark.parametrize("name", OBJECTS)
def test_every_object_is_held_and_sure_to_slip_at_its_own_positions(name: str) -> None:
    grip = present_grip(config(object_name=name), GripCriteria())
    assert grip.meets(GripCriteria()), grip
    assert grip.thumb_n[0] >= 0.5
    assert grip.thumb_n[2] <= 3.0
    assert grip.carried < 0.95


@pytest.mark.parametrize("name", OBJECTS)
def test_search_finds_positions_for_every_object(name: str) -> None:
    grips = search(config(object_name=name), GripCriteria())
    assert grips[0].meets(GripCriteria())
    assert [g.sure for g in grips] == sorted((g.sure for g in grips), reverse=True)


@pytest.mark.parametrize("name", ["can", "foam"])
def test_forces_of_the_search_are_those_of_the_lift(name: str) -> None:
    c = config("controller.reactions=false", object_name=name)
    grip = present_grip(c, GripCriteria(draws=500))
    for seed in range(3):
        result = lift.run(c, seed, None).result
        assert result is not None and result.peak_force_n is not None
        peak_n = result.peak_force_n["A"]
        assert grip.thumb_n[0] - 0.05 < peak_n < grip.thumb_n[2] + 0.35  # the stop at a count


def test_lifts_without_reaction_slip_at_what_was_found_and_not_at_a_firm_grip() -> None:
    c = config("object.mass_kg=0.15", "object.added_mass_kg=0")
    assert lifts_that_slip(config(), range(2)) == 2
    assert lifts_that_slip(with_counts(c, (57, 56, 56)), range(2)) == 0


def test_light_object_has_no_such_positions_and_the_search_says_which_rule_fails() -> None:
    c = config("object.mass_kg=0.1", "object.added_mass_kg=0")
    best = search(c, GripCriteria())[0]
    assert not best.meets(GripCriteria())
    grip = present_grip(c, GripCriteria())
    assert grip.fails["holds"] == 1.0
    assert grip.fails["loose"] == grip.fails["firm"] == 0.0


def test_each_rule_fails_by_itself() -> None:
    c = config()
    assert present_grip(c, GripCriteria(least_n=2.9)).fails["loose"] == 1.0
    assert present_grip(c, GripCriteria(most_n=1.0)).fails["firm"] == 1.0
    assert present_grip(c, GripCriteria(finger_n=3.0)).fails["finger"] == 1.0
    assert present_grip(c, GripCriteria(slip_margin=0.9)).fails["holds"] == 1.0


def test_impossible_criteria_are_refused() -> None:
    with pytest.raises(ConfigError, match="draws"):
        criteria(draws=0)


def test_command_prints_a_table_and_writes_what_it_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "grip.toml"
    code, out, _ = call(
        "grip-search", "--object", "can", "--verify", "1", "--write", str(file), capsys=capsys
    )
    assert code == 0
    assert "thumb, N" in out
    assert "1 of 1 simulated lifts" in out
    assert "grip_counts = [55, 55, 55]" in file.read_text()
    code, answer = run_json(
        capsys, "grip-search", "--object", "can", "--verify", "0", "--config", str(file)
    )
    assert code == 0
    assert answer["found"] is True
    assert answer["present"]["counts"] == [55, 55, 55]
    assert json.dumps(answer)


def test_nothing_found_exits_with_1(capsys: pytest.CaptureFixture[str]) -> None:
    code, answer = run_json(
        capsys, "grip-search", "--object", "can", "--verify", "0", "--set",
        "object.mass_kg=0.1", "--set", "object.added_mass_kg=0",
    )  # fmt: skip
    assert code == 1
    assert answer["found"] is False
