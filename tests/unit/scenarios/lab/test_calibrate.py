"""Calibrations with an operator who mistypes readings, without devices."""

import tomllib
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from drivers.errors import UsageError
from scenarios.campaign.config import load_config
from scenarios.lab import calibrate
from scenarios.lab.calibrate import (
    Presser,
    check_force,
    parse_newtons,
)

COUNTS_PER_NEWTON = 200.0


class ScriptedOperator:
    """Types one line per question and records the messages."""

    def __init__(self, *lines: str) -> None:
        self.messages: list[str] = []
        self.typed = ""
        self._lines = iter(lines)

    def say(self, text: str) -> None:
        self.messages.append(text)

    def poll(self) -> str | None:
        self.typed = next(self._lines)
        return self.typed


def readings(
    monkeypatch: pytest.MonkeyPatch, loads_n: list[float], *lines: str
) -> tuple[list[float], list[str]]:
    """Accepted readings of a pad under these loads, N, for these typed lines; and the messages."""
    operator, loads = ScriptedOperator(*lines), iter(loads_n)
    monkeypatch.setattr(
        calibrate, "pad_counts", lambda *_: (COUNTS_PER_NEWTON * next(loads), False)
    )
    unused = cast(Any, None)
    accepted = calibrate.weight_readings(unused, unused, "A", 15.0, operator, lambda text: None)
    return [reading.force_n for reading in accepted], operator.messages


def test_zero_reading_is_refused_and_the_others_are_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forces = [0.5, 1.0, 2.0, 3.0, 4.0]
    accepted, messages = readings(monkeypatch, forces, "0 g", *(f"{n} N" for n in forces), "")
    assert accepted == forces
    assert "0 N is not a load: load the pad, then type the scale's reading" in messages


def test_a_load_on_another_fingertip_is_named() -> None:
    counts = np.zeros((3, 6), np.int16)
    counts[2] = -50
    reader = SimpleNamespace(counts=counts, rest=np.full((3, 6), 500), ticks=lambda *_: range(2))
    none = cast(Any, None)
    with pytest.raises(UsageError, match="fingertip C is pressed, not B"):
        calibrate.pad_counts(cast(Any, reader), none, "B")
    assert calibrate.pad_counts(cast(Any, reader), none, "C") == (300.0, False)


def test_reading_that_contradicts_the_others_is_dropped_and_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forces = [0.5, 1.0, 2.0, 3.0, 4.0, 5.0]
    typed = ("0.5 N", "1 N", "2 N", "9 N", "4 N", "5 N", "")
    accepted, messages = readings(monkeypatch, forces, *typed)
    assert accepted == [0.5, 1.0, 2.0, 4.0, 5.0]
    assert "9.00 N contradicts the others: dropped" in messages


LOADS_N = (0.5, 1.0, 1.5, 2.0, 2.5)
LOADED = (*(f"{n} N" for n in LOADS_N), "")  # typed lines of one finger
PER_NEWTON = {"A": 150.0, "B": 160.0, "C": 200.0}


def calibrated(
    monkeypatch: pytest.MonkeyPatch, fingers: str, *lines: str
) -> tuple[dict[str, Any], list[str]]:
    """Settings in the file for these typed lines on pads that read truly, and the messages."""
    operator = ScriptedOperator(*lines)
    monkeypatch.setattr(calibrate, "open_fingertips", lambda *_, **__: nullcontext())
    monkeypatch.setattr(
        calibrate, "pad_counts",
        lambda reader, clock, finger: (PER_NEWTON[finger] * parse_newtons(operator.typed), False),
    )  # fmt: skip
    text = calibrate.calibrate_force(
        load_config("can", "simulated"), fingers, 10.0, operator, lambda text: None, "by hand"
    )
    return tomllib.loads(text), operator.messages


def test_file_of_all_fingers_has_the_counts_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = calibrated(monkeypatch, "ABC", *LOADED * 3)
    assert found["guard"]["counts_per_newton"] == [150.0, 160.0, 200.0]
    source = found["source"]["counts_per_newton"]
    assert "finger B, 5 readings of 0.50 to 2.50 N, 158.4 to 161.6 (95 %)" in source
    assert source.endswith("; by hand")
    alone, _ = calibrated(monkeypatch, "B", *LOADED)
    assert alone["guard"]["counts_per_newton"] == 160.0


def test_finger_with_too_few_readings_starts_again_and_the_others_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, messages = calibrated(monkeypatch, "ABC", *LOADED, "1 N", "", *LOADED * 2)
    assert found["guard"]["counts_per_newton"] == [150.0, 160.0, 200.0]
    assert any("Finger B starts again" in line for line in messages)


class FingerOnScale:
    """Finger that always makes contact with the scale."""

    counts = 100

    def wait_and_poll(self) -> None: ...

    def move_to(self, counts: int) -> bool:
        return True


def presses(*lines: str, count: int = 4) -> tuple[list[float], list[str]]:
    """Readings of the presses, and the messages."""
    operator, presser = ScriptedOperator(*lines), cast(Presser, FingerOnScale())
    return calibrate.press_readings(presser, count, 60.0, operator), operator.messages


def test_press_with_a_mistyped_reading_is_repeated() -> None:
    forces, _ = presses("10.5 N", "5.2 N", "11.5 N", "12 N", "11 N")
    assert forces == [10.5, 11.5, 12.0, 11.0]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("1.2 N", "1.2 kg"), ("12 g", "12 N"), ("1.25 g", "1.25 kg"), ("50 N", "5 N")],
)
def test_readings_in_a_wrong_unit_are_asked_for_again(wrong: str, right: str) -> None:
    """They do not contradict one another, but the manual's force."""
    forces, messages = presses(*([wrong, right] * 4))
    assert forces == [pytest.approx(parse_newtons(right))] * 4
    assert sum("is far from the manual's 15 N of byte 0" in line for line in messages) == 4


def test_hand_stronger_than_allowed_is_refused_with_the_option_to_set() -> None:
    with pytest.raises(UsageError) as byte_0:
        check_force(14.0)
    assert byte_0.value.remedy == "--up-to 15"
    check_force(15.0)
