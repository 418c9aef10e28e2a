"""Positions that hold an object too weakly: those of the packaged objects are such."""

from pathlib import Path

import pytest

from drivers.errors import UsageError
from grasp.settings import names
from studies import runner
from studies.grip_search import STUDY, Criteria, present, search
from tests.unit.scenarios.conftest import config

OBJECTS = (*runner.PAPER_OBJECTS, *names("objects/unseen"))


def test_every_packaged_object_is_held_and_slips_at_its_configured_positions() -> None:
    for name in OBJECTS:
        grip = present(config(object_name=name), Criteria())
        assert grip.meets(Criteria()), grip


def test_each_criterion_fails_by_itself_and_a_light_object_has_no_such_positions() -> None:
    assert present(config(), Criteria(least_n=2.9)).fails["loose"] == 1.0
    assert present(config(), Criteria(most_n=1.0)).fails["firm"] == 1.0
    assert present(config(), Criteria(finger_n=3.0)).fails["finger"] == 1.0
    light = config("object.mass_kg=0.1", "object.added_mass_kg=0")
    assert not search(light, Criteria(samples=50))[0].meets(Criteria())


def test_a_search_finds_the_positions_of_the_can_and_lifts_with_them_slip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--objects", "can", "--verify", "1", "--jobs", "1", "--out", str(tmp_path)]
    assert runner.main("x", STUDY, words) == 0
    out = capsys.readouterr().out
    assert "| can | 1 | 55 55 55 |" in out
    assert "1 of 1 lifts with the best slipped; the criteria are met" in out
    with pytest.raises(UsageError, match="not below"):
        runner.main("x", STUDY, [*words, "--least", "5", "--most", "1"])
