"""Calibration on the lift column: finds what made the rows, and says what they cannot tell."""

from collections.abc import Callable

import msgspec
import pytest

from scenarios.campaign.paper import LONG, TRIALS
from scenarios.campaign.spec import combinations
from scenarios.campaign.worker import Row
from scenarios.studies.table4.calibrate import (
    LENGTHS_M,
    SEED,
    SPEED,
    SPEEDS_MPS,
    TABLE_IV,
    assignments,
    fit,
    specs,
    trades,
)
from tests.unit.scenarios.conftest import config

TRUE_MPS = 0.2
TRUE_M = {"ball": -0.008, "foam": 0.038, "football": 0.08}
Rates = Callable[[str, float, float | None], tuple[int, int]]


def rows_of(rates: Rates) -> list[Row]:
    """Twenty lifts at each place of the grids, so many near and far as the function says."""
    rows: list[Row] = []
    for name in TABLE_IV:
        key, values = LENGTHS_M.get(name, ("", (None,)))
        for speed in SPEEDS_MPS:
            for value in values:
                swept = {SPEED: speed} | ({key: value} if value is not None else {})
                near, far = rates(name, speed, value)
                rows += [row(name, swept, i, near, far) for i in range(TRIALS)]
    return rows


def row(name: str, swept: dict[str, float], i: int, near: int, far: int) -> Row:
    held = "held_within_6cm" if i < near else "held_within_12cm"
    success = i < near + far
    return Row(
        trial=0, scenario="lift", object=name, profile="paper", detector="energy",
        swept=msgspec.json.encode(swept).decode(), repetition=i, seed=i, status="done",
        success=success, outcome=held if success and name in LONG else str(success),
        config_hash="", detector_hash="",
    )  # fmt: skip


def as_in_the_paper_at_the_true_place(
    name: str, speed: float, value: float | None
) -> tuple[int, int]:
    cell = TABLE_IV[name]
    right = speed == TRUE_MPS and value == TRUE_M.get(name)
    return (cell.near, cell.far) if right else (10, 0)


def test_the_place_that_gives_the_papers_figures_is_found() -> None:
    found = fit(rows_of(as_in_the_paper_at_the_true_place), "paper", TRIALS)
    assert found.speed_mps == TRUE_MPS
    assert {c.object: c.length_m for c in found.best if c.length_m is not None} == TRUE_M
    assert found.best_possible - found.log_likelihood < 6
    assert ("ball", "object.grip_height_m=-0.008") in assignments(found)
    speed = next(p for p in found.profiles if p.setting == SPEED)
    assert (speed.best, speed.plausible, speed.at_border) == (TRUE_MPS, [TRUE_MPS], False)


def test_what_changes_nothing_is_called_flat() -> None:
    found = fit(rows_of(lambda name, speed, value: (12, 0)), "paper", TRIALS)
    assert all(p.plausible == p.values for p in found.profiles)
    assert all(trade.everything for trade in found.trade_offs)


def test_a_pair_that_stands_in_for_one_another_trades_off() -> None:
    def product(name: str, speed: float, value: float | None) -> tuple[int, int]:
        same = value is not None and LENGTHS_M[name][1].index(value) == SPEEDS_MPS.index(speed)
        return (TABLE_IV[name].near if same else 1, 0)

    found = fit(rows_of(product), "paper", TRIALS)
    (ball,) = (trade for trade in found.trade_offs if trade.object == "ball")
    assert trades(ball)
    assert len(ball.pairs) == len(SPEEDS_MPS) and not ball.everything


def test_it_runs_on_lifts_alone_on_seeds_of_its_own_and_never_on_the_tap() -> None:
    every = specs("energy", "paper", 5)
    assert {s.scenarios for s in every} == {("lift",)}
    assert {s.seeds for s in every} == {(SEED,)}
    places = [place for spec in every for place in combinations(spec)]
    assert len(places) == 60
    assert {place.config.profile for place in places} == {"paper"}


def test_the_arm_accelerates_in_proportion_to_the_speed_that_is_tried() -> None:
    places = [place for spec in specs("energy", "paper", 1) for place in combinations(spec)]
    for p in places:
        arm = p.config.controller
        assert arm.lift_speed_mps == p.swept[SPEED]
        assert arm.lift_acceleration_mps2 == pytest.approx(5 * p.swept[SPEED])
    found = fit(rows_of(as_in_the_paper_at_the_true_place), "paper", TRIALS)
    assert ("", "controller.lift_acceleration_mps2=1") in assignments(found)


@pytest.mark.parametrize("name", list(LENGTHS_M))
def test_every_length_that_is_tried_is_allowed(name: str) -> None:
    key, values = LENGTHS_M[name]
    for value in values:
        config(f"{key}={value}", object_name=name)


@pytest.mark.parametrize("lifts, coarse", [(5, True), (19, True), (20, False)])
def test_calibration_on_fewer_than_twenty_lifts_a_place_says_that_it_is_coarse(
    lifts: int, coarse: bool
) -> None:
    assert fit(rows_of(as_in_the_paper_at_the_true_place), "paper", lifts).coarse is coarse
