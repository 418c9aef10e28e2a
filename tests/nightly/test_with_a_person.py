"""Lifts and taps on the hardware rig, pointed at an emulated cell, with a person who puts the
object in place, strikes it, and types what moved."""

import json
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign.store import CampaignStore
from tests.wire.lab import (
    CONFIRMED,
    HARDWARE,
    PATIENCE_S,
    Done,
    Lab,
    emulate,
    grasp,
    sets,
    started,
    until,
)

TAP = ("tap.watch_s=1.6", "tap.wait_s=0")


class Bench(Lab):
    """A lab with its own cell, whose store and runs are in a folder."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        super().__init__(endpoints, folder)
        self.out, self.folder = folder / "lifts.sqlite", folder
        self.prompts: list[str] = []
        self.wake()

    def run(self, verb: str, answer: Callable[[str], str | None], *words: str) -> Done:
        kept = ("--runs", str(self.folder / "runs"))

        def person(question: str) -> str | None:
            self.prompts.append(question)
            if "Put the object" in question:
                self.ask("place")
                return ""
            return answer(question)

        return self.grasp("run", verb, *HARDWARE, *CONFIRMED, *kept, *words, *sets(), answer=person)

    @property
    def rows(self) -> list[Any]:
        with CampaignStore.open(self.out) as store:
            return store.rows()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with emulate() as endpoints:
        made = Bench(endpoints, tmp_path)
        yield made
        made.cell.close()


def test_lifts_leave_the_rows_of_a_campaign(bench: Bench) -> None:
    slips = iter(["12", "70,5", "l"])
    done = bench.run("lift", lambda question: next(slips), "--trials", "3", "--json", "--out",
                     str(bench.out))  # fmt: skip
    lifts = json.loads(done.out)["lifts"]
    assert done.code == 1, done.err  # the last one was lost
    outcomes = ["held_within_6cm", "held_within_12cm", "dropped"]
    assert [result["outcome"] for result in lifts] == outcomes
    slipped = [pytest.approx(0.012), pytest.approx(0.0705), None]
    assert [result["slip_distance_m"] for result in lifts] == slipped
    assert all(grasp("replay", result["recording"], "--check").code == 0 for result in lifts)
    assert [row.outcome for row in bench.rows] == outcomes
    assert all(row.status == "done" and row.recording for row in bench.rows)
    shown = grasp("runs", str(bench.out)).out
    assert "n 3" in shown and "1 dropped" in shown


def test_trial_that_a_device_ended_is_run_again_when_gone_on_with(bench: Bench) -> None:
    words = ("--trials", "3", "--out", str(bench.out))
    slips = iter(["12"])

    def unplugs(question: str) -> str | None:
        if (typed := next(slips, None)) is None:
            bench.ask("fault", name="unplug")
        return typed

    done = bench.run("lift", unplugs, *words)
    assert done.code == 3, done.err
    assert "--resume" in done.err and "`grasp release --rig hardware" in done.err
    assert [(row.trial, row.status) for row in bench.rows] == [(0, "done"), (1, "error")]
    bench.ask("fault", name="replug")
    bench.done("release", *HARDWARE)
    away = bench.run("lift", lambda question: "", *words, "--resume")
    assert away.code == 4 and "mm from where the first trial began" in away.err
    until(lambda: not bench.ask("home")["away_m"])
    slips = iter(["13", "14"])
    done = bench.run("lift", lambda question: next(slips), *words, "--resume")
    assert done.code == 0, done.err
    assert [(row.trial, row.status) for row in bench.rows] == [(n, "done") for n in range(3)]
    assert [row.slip_distance_m for row in bench.rows] == [
        pytest.approx(mm * 1e-3) for mm in (12, 13, 14)
    ]


@pytest.mark.parametrize("typed", ["6.5", "0"])
def test_person_strikes_measures_and_types(typed: str, bench: Bench) -> None:
    def strikes(question: str) -> str:
        if "Tap the object" in question:
            bench.ask("tap", impulse_n_s=0.25, duration_s=0.008)
        return typed if "tape mark moved" in question else ""

    done = bench.run("tap", strikes, "--trials", "1", "--json", *sets(TAP))
    (tap,) = json.loads(done.out)["taps"]
    moved = typed != "0"
    assert tap["moved"] is moved
    assert tap["displacement_m"] == pytest.approx(float(typed) * 1e-3)
    assert tap["outcome"] == ("registered" if moved else "unmoved_registered")
    assert done.code == 0
    assert len(bench.prompts) == 3


def test_two_taps_on_the_emulated_rig_move_the_object_and_are_felt(tmp_path: Path) -> None:
    done = grasp("run", "tap", "--trials", "2", "--rig", "emulated", "--runs", str(tmp_path),
                 "--json", *sets(), *sets(TAP))  # fmt: skip
    series = json.loads(done.out)
    assert [tap["direction"] for tap in series["taps"]] == ["top", "side"]
    for tap in series["taps"]:
        assert tap["moved"] is True
        assert tap["struck_s"] < tap["slip_onset_s"] < tap["slip_registered_s"]
        assert 9.0 < tap["grip_force_n"]["A"] < 11.0 and tap["commanded_force_n"] <= 10.0
        assert grasp("replay", tap["recording"], "--check").code == 0


@pytest.fixture
def soft(tmp_path: Path) -> Iterator[Bench]:
    with emulate("--object", "foam") as endpoints:
        made = Bench(endpoints, tmp_path)
        yield made
        made.cell.close()


def test_first_lift_closes_in_free_air_then_lifts(soft: Bench) -> None:
    """Something in free air ends it before the arm moves."""
    bench = soft
    for does, code in ((["place"], 4), (["take", "place"], 0)):
        bench.reset()
        bench.wake()
        left = iter(does)

        def person(question: str, left: Iterator[str] = left) -> str:
            bench.ask(next(left))
            return ""

        done = bench.grasp("run", "lift", "--first", *HARDWARE, *CONFIRMED, "--runs",
                           str(bench.folder / "runs"), *sets(), answer=person)  # fmt: skip
        assert done.code == code, done
        assert ("Step 2" in done.err) is (code == 0)
    assert "no finger told more than 10 N" in done.err


def test_activation_is_stopped_by_ctrl_c_and_the_hand_is_inactive_then(tmp_path: Path) -> None:
    with emulate("--set", "hand.activation_s=10") as endpoints:
        lab = Lab(endpoints, tmp_path)
        with lab.started("gripper", "activate", "--empty", *CONFIRMED) as run:
            until(lambda: max(lab.places) > 20)
            run.send_signal(signal.SIGINT)
            _, said = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 130, said
        assert "the fingers stand; the hand is not active any more" in said
        assert not lab.hand.active and lab.ask("motion")["fingers_mps"] == 0.0
        lab.cell.close()


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_devices_that_freeze_or_go_are_all_named_and_cost_no_result(
    number: signal.Signals, tmp_path: Path
) -> None:
    with started("emulate", *sets()) as cell:
        assert cell.stdout is not None
        lab = Lab(json.loads(cell.stdout.readline()), tmp_path)
        lab.wake()
        words = ("run", "lift", *HARDWARE, *CONFIRMED, "--runs", str(tmp_path / "runs"))
        with lab.started(*words, *sets()) as run:
            assert run.stdout is not None
            assert any("lift" in line.split() for line in run.stdout)
            cell.send_signal(number)
            _, said = run.communicate(timeout=PATIENCE_S)
        lab.cell.close()
    assert run.returncode in (3, 4), said
    (path,) = (tmp_path / "runs").glob("*/result.json")
    result = json.loads(path.read_text())
    assert result["outcome"] == "fault"
    assert "when last heard" in result["end"]["arm"]
    assert "cannot be told anything and holds by itself" in result["end"]["hand"]
