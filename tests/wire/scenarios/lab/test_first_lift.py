"""`grasp run lift --first` at an emulated lab, and the log of `-v`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign.config import load_config
from scenarios.lab.ready import gently
from scenarios.lift import lift
from scenarios.rigs.cell_control import ControlClient
from tests.wire.scenarios.lab.person import played
from tests.wire.scenarios.lab.terminal import grasp
from tests.wire.scenarios.test_rigs import emulate, lab_file


class Lab:
    """A lab with a foam sleeve, its hand active."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        self.folder = folder
        self.file = lab_file(folder / "lab.toml", endpoints)
        self.cell = ControlClient(endpoints["control"]["host"], endpoints["control"]["port"])
        done = grasp("gripper", "activate", "--empty", "--confirm-motion", "--config", self.config)
        assert done.returncode == 0, done.stderr

    @property
    def config(self) -> str:
        return str(self.file)

    def first(self, answers: list[str]) -> tuple[int, str, str]:
        """``answers``: what is done before each Enter; q: what is typed instead."""
        left = iter(answers)

        def person(question: str) -> str:
            done = next(left)
            if done != "q":
                self.cell.ask(done)
            return "q" if done == "q" else ""

        return played(
            person, "run", "lift", "--first", "-v", "--confirm-motion", "--rig", "hardware",
            "--config", self.config, "--runs", str(self.folder / "runs"),
        )  # fmt: skip


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with emulate("--object", "foam") as endpoints:
        found = Lab(endpoints, tmp_path_factory.mktemp("lab"))
        yield found
        found.cell.close()


def test_something_in_free_air_ends_it_before_the_arm_moves(lab: Lab) -> None:
    code, out, said = lab.first(["place"])
    assert code == 4, out
    assert "in free air, fingers at" in said
    assert "Step 2" not in said


def test_first_lift_closes_in_free_air_then_lifts_something_soft(lab: Lab) -> None:
    code, out, said = lab.first(["take", "place"])
    assert code == 0, said
    for trouble in ("protective stop:", "emergency stop:", "loss of remote control"):
        assert trouble in out
    assert "nothing was met, 0.0 N felt, as it should be" in out
    assert "200 mm at 50 mm/s, no finger told more than 10 N" in said
    assert "SUCCESS" in out
    assert "next: the same without --first" in out
    (log,) = (lab.folder / "runs").glob("*-lift-foam.log")
    told = log.read_text()
    assert " phase lift" in told
    assert "arm to (" in told
    assert told.splitlines()[-1].endswith(": held")
    assert told[:2] == "20"  # the wall clock's year
    assert str(log) in said


def test_who_has_had_enough_moves_nothing(lab: Lab) -> None:
    before = lab.cell.ask("truth")["truth"]["peak_n"]
    code, _, said = lab.first(["q"])
    assert code == 2
    assert "ended by hand: nothing more was moved" in said
    assert lab.cell.ask("truth")["truth"]["peak_n"] == before


@pytest.mark.parametrize(("least_n", "limit_n", "told_n"), [
    (10.0, 20.0, 10.0),  # the paper's hand
    (6.0, 10.0, 6.0),  # one that a calibration has found weaker
])  # fmt: skip
def test_first_lift_is_half_as_fast_and_no_stronger_than_the_hand_s_least(
    least_n: float, limit_n: float, told_n: float, tmp_path: Path
) -> None:
    hand = tmp_path / "hand.toml"
    hand.write_text(f'[calibration]\nsource = "as measured"\nleast_force_n = {least_n}\n')
    config = load_config(
        "foam", "simulated", None, None,
        (f"guard.force_limit_n={limit_n}", "controller.answer_stop_mps2=4",
         f"gripper.calibration='{hand}'", f"hand.least_force_n={least_n}"),
    ).for_lift()  # fmt: skip
    slow = gently(config)
    assert slow.controller.lift_speed_mps == config.controller.lift_speed_mps / 2
    assert slow.controller.answer_stop_mps2 == 1.0
    assert (slow.guard.force_limit_n, slow.controller.grip_force_n) == (told_n, told_n)
    assert gently(slow).controller.approach_speed_mps >= 0.022
    lifted = lift.run(slow, 0, None).result
    assert lifted is not None and lifted.success
    assert max(lifted.peak_force_n.values()) < told_n + 1.0  # type: ignore[union-attr]


def test_first_lift_is_of_a_lab_alone(tmp_path: Path) -> None:
    done = grasp("run", "lift", "--first", "--rig", "simulated", "--runs", str(tmp_path))
    assert done.returncode == 2
    assert "by a person on the rig hardware" in done.stderr
