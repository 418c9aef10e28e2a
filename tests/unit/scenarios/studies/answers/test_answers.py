"""The study of answers: what each lift says, and what they amount to."""

import json
from pathlib import Path

import msgspec
import pytest

from grasp.cli.main import main
from scenarios.rigs.workers import Workers
from scenarios.studies.answers.study import (
    BASE,
    POLICIES,
    SCENES,
    Answered,
    configured,
    lifts,
)
from scenarios.studies.answers.summary import summarize

NAMES = [policy.name for policy in POLICIES]
LONE = Workers(0)


def answered(policy: str, scene: str = BASE.name, seed: int = 9000) -> Answered:
    policies = [p for p in POLICIES if p.name == policy]
    scenes = [s for s in SCENES if s.name == scene]
    (found,) = lifts(("can",), (seed,), policies, scenes, "gru", LONE)
    return found


@pytest.fixture(scope="module")
def easy() -> dict[str, Answered]:
    return {name: answered(name) for name in NAMES}


def test_arm_that_stops_saves_slip_at_the_same_force(easy: dict[str, Answered]) -> None:
    stops, goes_on = easy["stop_and_jump"], easy["jump"]
    assert stops.held and goes_on.held
    assert stops.slip_mm is not None and goes_on.slip_mm is not None
    assert stops.slip_mm < 0.6 * goes_on.slip_mm
    assert stops.force_n == pytest.approx(goes_on.force_n, abs=0.1)
    assert stops.paused_s > 0.0 == goes_on.paused_s


def test_steps_find_a_force_near_the_least_and_a_margin_adds_to_it(
    easy: dict[str, Answered],
) -> None:
    forces = [easy[f"stop_and_step, margin {n}"].force_n for n in (0, 1, 2)]
    least_n = easy["stop_and_jump"].least_n
    assert least_n < forces[0] < 1.5 * least_n
    assert forces == sorted(forces)
    assert forces[1] - forces[0] == pytest.approx(forces[2] - forces[1], abs=0.3)
    assert forces[2] < easy["stop_and_jump"].force_n


def test_oracle_hears_slip_before_any_detector(easy: dict[str, Answered]) -> None:
    heard, oracle = easy["jump, one speed"].slip_mm, easy["jump, one speed, oracle"].slip_mm
    assert heard is not None and oracle is not None
    assert oracle < heard


def test_scenes_are_harder_by_what_they_say() -> None:
    plain = configured("can", BASE, POLICIES[0], "gru")
    slippery = next(s for s in SCENES if s.friction < 1.0)
    harder = configured("can", slippery, POLICIES[0], "gru")
    assert harder.object.friction_kinetic == pytest.approx(0.7 * plain.object.friction_kinetic)
    assert harder.object.total_kg == pytest.approx(1.5 * plain.object.total_kg)
    assert harder.controller.lift_speed_mps == 0.25


def test_wet_patch_in_the_air_lets_slip_what_was_held_by_the_least_force() -> None:
    wet = answered("stop_and_step, margin 0", "friction -50% from 10 cm on")
    assert not wet.held or (wet.air_slip_mm or 0.0) + (wet.slip_mm or 0.0) > 15.0
    assert wet.least_n == pytest.approx(2 * answered("jump").least_n)


def test_lost_object_has_slipped_for_ever_and_adds_nothing_to_force() -> None:
    held = answered("jump")
    lost = msgspec.structs.replace(held, seed=9001, held=False, slip_mm=None, air_slip_mm=None)
    (cell,) = summarize("gru", "simulated", (9000, 9001), ("can",), (held, lost)).cells
    assert (cell.held, cell.trials) == (1, 2)
    assert cell.slip_mm is not None and cell.slip_mm.p90 == float("inf")
    assert cell.over_least is not None and cell.over_least.count == 1


def test_chart_leaves_a_picture_and_every_lift(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "answers.svg"
    words = "--objects can --seeds 1 --first-seed 9000 --detector gru --jobs 1 --scenes easy"
    few = ["--policies", "jump", "stop_and_jump"]
    assert main(["chart", "answers", *words.split(), *few, "--out", str(out)]) == 0
    assert "stop_and_jump" in capsys.readouterr().out
    assert out.read_text().startswith("<?xml")
    assert len(json.loads(out.with_suffix(".json").read_text())["lifts"]) == 2


def test_unknown_answer_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chart", "answers", "--policies", "pray"]) == 2
    assert "stop_and_jump" in capsys.readouterr().err
