"""Causes: what could bring an object's classes to the paper's, and that a study goes on."""

from pathlib import Path

import pytest

from scenarios.campaign.run import Progress
from scenarios.campaign.spec import Task, combinations, trials
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Finished, Row
from scenarios.rigs.workers import Workers
from scenarios.studies.table4 import cause
from scenarios.studies.table4.calibrate import Calibration, Candidate, TradeOff
from scenarios.studies.table4.cause import Cause, Range, cause_of, explain, moved_lift, specs
from tests.unit.scenarios.conftest import config

HERE = Workers(0)


def result(best: Candidate, detector: str = "energy", lifts: int = 2) -> Calibration:
    return Calibration(
        detector=detector, profile="paper", repetitions=lifts, coarse=True, speed_mps=0.25,
        best=[best], log_likelihood=0.0, best_possible=0.0, profiles=[],
        trade_offs=[TradeOff("ball", "object.grip_height_m", [], True)],
    )  # fmt: skip


BALL = Candidate("ball", 0.25, 0.0, (2, 0), -9.0, 0.001)


def task(name: str, seed: int, *words: str) -> Task:
    return Task(
        number=seed, scenario="lift", repetition=seed, seed=seed, swept={},
        config=config(*words, object_name=name), recordings="none",
    )  # fmt: skip


def moved(name: str, *words: str) -> list[Row]:
    return [moved_lift(task(name, seed, *words)).row for seed in (0, 1)]


def ranges_of(found: Cause) -> dict[str, Range]:
    return {each.cause: each for each in found.ranges}


def test_a_full_run_that_fails_where_its_copy_holds_has_failed_by_an_alarm() -> None:
    lost = Candidate("box", 0.1, None, (0, 0, 2), -9.0, 0.0)
    found = ranges_of(cause_of(lost, [(0, 0, 2)], moved("box"), moved("box")))
    alarms = found["detection: alarms"]
    assert (alarms.low[0], alarms.high[0]) == (0.0, 1.0)
    assert alarms.reaches and not found["geometry"].reaches


def test_a_ball_is_lost_by_slow_detection_or_reaction() -> None:
    rows = moved("ball", "controller.lift_speed_mps=0.25")
    found = ranges_of(cause_of(BALL, [(2, 0)], rows, rows))
    assert (found["reaction"].low, found["reaction"].high) == ([0.0, 0.0], [1.0, 1.0])
    assert not found["geometry"].reaches


def test_a_cause_that_never_gives_the_papers_far_class_is_none() -> None:
    """The paper's cardboard: 9 within 6 cm, 8 within 12, 3 lost; held as often, but never far."""
    held = Candidate("cardboard", 0.4, None, (17, 0, 3), -9.0, 0.0)
    grid, rows = [(17, 0, 3), (5, 0, 15)], moved("cardboard")
    assert not ranges_of(cause_of(held, grid, rows, rows))["geometry"].reaches
    assert ranges_of(cause_of(held, [*grid, (2, 8, 10)], rows, rows))["geometry"].reaches


def test_signal_is_moved_over_quiet_and_loud_hands_on_smooth_and_rough_surfaces() -> None:
    _, signal = specs(result(BALL), "ball")
    places = combinations(signal)
    assert {place.config.fingertip.holding_share for place in places} == {0.1, 1.0}
    assert len({place.config.object.texture_rms_m for place in places}) == 2
    assert len(list(trials(signal, places))) == 8


def test_an_interrupted_study_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies, _ = specs(result(BALL), "ball")
    ran: list[int] = []

    def work(trial: Task) -> Finished:
        if len(ran) == 1:
            ran.append(-1)
            raise KeyboardInterrupt
        ran.append(trial.number)
        return moved_lift(trial)

    monkeypatch.setattr(cause, "moved_lift", work)
    monkeypatch.setattr(cause, "run_trial", work)
    monkeypatch.setattr(cause, "counts_over_grid", lambda folder, name: [(2, 0)])
    said: list[Progress] = []
    with pytest.raises(KeyboardInterrupt):
        explain(result(BALL), tmp_path, HERE, said.append)
    assert (said[-1].done, said[-1].total) == (1, 2)
    (found,) = explain(result(BALL), tmp_path, HERE, said.append)
    assert ran[:3] == [0, -1, 1]  # the first is not run again
    with CampaignStore.open(tmp_path / f"{copies.name}.sqlite") as store:
        assert store.finished() == {0, 1}
    count = len(ran)
    assert explain(result(BALL), tmp_path, HERE, said.append) == [found]
    assert len(ran) == count  # nor is anything, once all is there
