"""What is typed into `grasp emulate` becomes requests to its cell."""

import os
import threading
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from grasp.cli import emulate_words
from grasp.cli.emulate_words import Words, look
from scenarios.campaign.config import load_config

TRUTH = {
    "normal_n": [0.0, 0.0, 0.0], "height_m": 0.05, "slip_distance_m": 0.003, "across_m": 0.004,
    "turn_rad": 0.0,
}  # fmt: skip


class Cell:
    """Takes requests; a name that it does not know is an error of its own."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.homeward: list[dict[str, Any]] = []  # replies on the way home

    def obey(self, request: dict[str, Any]) -> dict[str, Any]:
        self.asked.append(request)
        if request["verb"] == "fault" and request["name"] == "dance":
            raise ValueError("unknown fault 'dance'")
        if request["verb"] == "fault" and request["name"] == "unplug":
            return {"told": "unplug: off the bus"}
        if request["verb"] == "press":
            msgspec.convert(request["taxel"], int)
        if request["verb"] == "home":
            return self.homeward.pop(0) if self.homeward else {"away_m": 0.0}
        return {"truth": TRUTH}


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Where to write what is typed."""
    reading, writing = os.pipe()
    monkeypatch.setattr(emulate_words, "STDIN", reading)
    yield writing
    os.close(reading)


def said(
    typed: int,
    lines: str,
    capsys: pytest.CaptureFixture[str],
    *homeward: dict[str, Any],
    settings: tuple[str, ...] = (),
) -> tuple[Cell, list[str]]:
    cell = Cell()
    config = load_config("can", "emulated", "energy", None, settings).for_tap()
    cell.homeward = list(homeward)
    words = Words(config, 0)
    words.listen(cell)  # type: ignore[arg-type]
    os.write(typed, lines.encode())
    os.close(typed)  # the end of the input ends the listening, and nothing else
    answers: list[str] = []
    while len(answers) < len(lines.split("\n")) - 1:
        time.sleep(0.005)
        answers += capsys.readouterr().err.splitlines()
    return cell, [line.removeprefix("cell: ") for line in answers]


def test_words_of_a_person_are_requests(typed: int, capsys: pytest.CaptureFixture[str]) -> None:
    lines = "place\nhome\nlook\ntap side\nfault gripper_delay seconds=0.2 times=3\n"
    cell, answers = said(typed, lines, capsys)
    verbs = [request["verb"] for request in cell.asked]
    assert verbs == ["place", "home", "truth", "tap", "fault"]
    assert cell.asked[3]["direction"] == "side" and cell.asked[3]["impulse_n_s"] > 0.0
    assert cell.asked[4] == {"verb": "fault", "name": "gripper_delay", "seconds": 0.2, "times": 3}
    assert answers[2] == "the object is not touched, 50 mm above the table, 5.0 mm from its mark"
    assert answers.count("done") == 4


def test_scales_and_taking_the_object_away_are_words_too(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    cell, answers = said(typed, "take\nscale\n", capsys)
    assert [request["verb"] for request in cell.asked] == ["take", "truth"]
    assert answers[1].startswith("pressed with A 0.00 N, B 0.00 N, C ")


def test_press_on_a_pad_is_done_once_it_is_let_go(
    typed: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(emulate_words, "PRESS_S", 0.2)
    start_s = time.monotonic()
    cell, answers = said(typed, "press b 3\npress A 0 4.5\n", capsys)
    assert time.monotonic() - start_s >= 2 * 0.2
    pressed = {"verb": "press", "seconds": 0.2}
    assert cell.asked == [
        {**pressed, "finger": "B", "taxel": 3},
        {**pressed, "finger": "A", "taxel": 0, "newtons": 4.5},
    ]
    assert answers == ["done", "done"]


def test_rotation_in_the_hand_is_seen_where_there_is_any() -> None:
    assert look({**TRUTH, "turn_rad": -0.1}).endswith("5.0 mm from its mark, turned 5.7 deg")
    assert "turned" not in look(TRUTH)


def test_what_is_not_known_is_told_with_what_is(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = "dance\ntap below\nplace it\nfault dance\npress A pad\nplace\n"
    cell, answers = said(typed, lines, capsys)
    assert "'dance' is not known" in answers[0]
    assert "Expected `int`" in answers[4]
    assert all("place | take | home | look | scale | tap" in answer for answer in answers[:5])
    assert answers[5] == "done"
    assert [request["verb"] for request in cell.asked] == ["fault", "press", "place"]


def test_faults_are_told_on_demand_and_what_one_does_is_answered(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = "fault unplug\nfault help\n"
    cell, answers = said(typed, lines, capsys)
    assert answers[:2] == ["done: unplug: off the bus", "faults:"]
    assert any(line.startswith("remote_control on=true (true or false): ") for line in answers)
    assert [request["verb"] for request in cell.asked] == ["fault"]


def test_arm_that_is_stopped_on_its_way_home_does_not_end_the_listening(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    away, stopped = {"away_m": 0.1}, {"error": "the arm is stopped"}
    _, answers = said(typed, "home\nhome\nlook\n", capsys, away, stopped, stopped)
    assert answers[:2] == ["the arm is stopped"] * 2 and "the object" in answers[2]


def test_direction_that_is_none_is_quoted(typed: int, capsys: pytest.CaptureFixture[str]) -> None:
    _, answers = said(typed, "tap upwards\n", capsys)
    assert answers[0].startswith("'tap upwards' is not known: ")


def test_nobody_is_listened_to_where_nobody_can_type(monkeypatch: pytest.MonkeyPatch) -> None:
    with open(os.devnull) as nothing:
        monkeypatch.setattr(emulate_words, "STDIN", nothing.fileno())
        words = Words(load_config("can", "emulated", "energy").for_tap(), 0)
        words.listen(Cell())  # type: ignore[arg-type]
    assert "words" not in [thread.name for thread in threading.enumerate()]


def test_object_that_no_blow_leaves_in_the_hand_can_be_placed_and_is_not_tapped(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    slippery = ("object.friction_static=0.25", "object.friction_kinetic=0.2")
    cell, answers = said(typed, "tap\nplace\n", capsys, settings=slippery)
    assert "no blow on the top moves can" in answers[0]
    assert [request["verb"] for request in cell.asked] == ["place"]
