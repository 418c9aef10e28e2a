"""The study of answers: what each lift says, and what they amount to."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.interfaces import PERIOD_NS
from grasp.cli import exits
from grasp.cli.answers import _row
from grasp.cli.main import main
from grasp.clock import VirtualClock
from scenarios.rigs.workers import Workers
from scenarios.studies.answers.study import (
    BASE,
    POLICIES,
    SCENES,
    Answered,
    FalseAlarms,
    configured,
    lifts,
)
from scenarios.studies.answers.summary import summarize

NAMES = [policy.name for policy in POLICIES]
LONE = Workers(0)


class Quiet:
    """A detector of which one word is known."""

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        return np.full(3, 0.25)


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


def test_false_alarms_come_at_the_rate_stated_and_cost_time() -> None:
    seeds = range(9000, 9006)
    scene = next(s for s in SCENES if s.alarms == 12.0)
    policies = [p for p in POLICIES if p.name == "stop_and_jump"]
    plain, alarmed = (
        list(lifts(("can",), seeds, policies, (s,), "gru", LONE)) for s in (BASE, scene)
    )
    assert sum(a.alarms for a in plain) == 0
    heard = sum(a.alarms for a in alarmed)
    assert heard == pytest.approx(12.0 / 60.0 * sum(a.seconds for a in alarmed), rel=0.5)
    assert sum(a.seconds for a in alarmed) > sum(a.seconds for a in plain)
    assert all(a.held for a in alarmed)


def test_false_alarm_is_said_for_as_long_as_it_lasts_and_the_detector_is_heard_beside_it() -> None:
    clock = VirtualClock(lambda now_ns: None)
    detector = FalseAlarms(Quiet(), clock, a_minute=60.0, seed=1)
    said = []
    for _ in range(6000):
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        said.append(detector.update(np.zeros((3, 5), np.int16)))
    assert set(np.unique(said)) == {0.25, 1.0}
    begun = detector.between(0, clock.now_ns)
    assert begun == pytest.approx(60, abs=25)
    assert 5 * begun < (np.array(said)[:, 0] == 1.0).sum() <= 10 * begun


def test_what_the_user_sets_lies_beneath_scene_and_answer() -> None:
    own = ("controller.answer_stop_mps2=1", "controller.answer=jump", "object.mass_kg=0.2")
    slippery = next(s for s in SCENES if s.friction < 1.0)
    policy = next(p for p in POLICIES if p.name == "stop_and_jump")
    made = configured("can", slippery, policy, "gru", assignments=own)
    assert made.controller.answer_stop_mps2 == 1.0
    assert made.controller.answer == "stop_and_jump"
    assert made.object.mass_kg == pytest.approx(0.3)


def test_what_one_answer_alone_reads_may_be_set_where_that_is_drawn() -> None:
    steps = next(p for p in POLICIES if p.name == "stop_and_step, margin 0")
    made = configured("can", BASE, steps, "gru", assignments=("controller.step_n=2",))
    assert made.controller.step_n == 2.0


def test_lost_object_has_slipped_for_ever_and_adds_nothing_to_force() -> None:
    held = answered("jump")
    lost = msgspec.structs.replace(
        held, seed=9001, held=False, ended="lost", slip_mm=None, air_slip_mm=None
    )
    (cell,) = summarize("gru", "simulated", (9000, 9001), ("can",), (held, lost)).cells
    assert (cell.held, cell.trials, cell.lost) == (1, 2, 1)
    assert cell.slip_mm is not None and cell.slip_mm.p90 == float("inf")
    assert cell.over_least is not None and cell.over_least.count == 1


def test_chart_tells_names_of_answers_apart_that_have_commas(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["chart", "answers", "--policies", "jump,", "one", "speed"]) == exits.USAGE
    assert "one of: 'jump, one speed', 'jump', 'stop_and_jump'," in capsys.readouterr().err


def test_slip_of_nothing_has_no_sign() -> None:
    lift = msgspec.structs.replace(answered("jump"), air_slip_mm=-1e-4)
    (cell,) = summarize("gru", "simulated", (9000,), ("can",), (lift,)).cells
    assert "-0.0" not in _row(cell)


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


def test_chart_of_false_alarms_says_how_many_were_heard(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "alarms.svg"
    words = "--objects can --seeds 1 --first-seed 9009 --detector gru --jobs 1 --scenes alarms"
    told = ["--policies", "stop_and_jump", "--set", "controller.hold_s=3.0"]
    assert main(["chart", "answers", *words.split(), *told, "--out", str(out)]) == 0
    assert "12 false alarms a minute" in capsys.readouterr().out
    rows = {a["scene"]: a for a in json.loads(out.with_suffix(".json").read_text())["lifts"]}
    assert rows["12 false alarms a minute"]["alarms"] > 0 == rows[BASE.name]["alarms"]
    assert rows[BASE.name]["seconds"] > 5.0


def test_unknown_answer_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chart", "answers", "--policies", "pray"]) == 2
    assert "stop_and_jump" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("policy", "word"),
    [("jump", "controller.answer=stop_and_jump"),
     ("stop_and_step, margin 2", "controller.margin_steps=5")],
)  # fmt: skip
def test_chart_refuses_a_setting_that_a_policy_would_overwrite(
    policy: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--objects", "can", "--scenes", "easy", "--policies", policy, "--set", word]
    out = str(tmp_path / "answers.svg")
    assert main(["chart", "answers", "--seeds", "1", *asked, "--out", out]) == exits.USAGE
    assert f"is set by the policy {policy!r}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
