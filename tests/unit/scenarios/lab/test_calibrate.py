"""Calibrations with a person who mistypes, or a scale that says nothing; no devices."""

from typing import Any, cast

import pytest

from drivers.errors import UsageError
from scenarios.lab import calibrate
from scenarios.lab.calibrate import (
    Presser,
    check_force,
    newtons,
)

COUNTS_PER_NEWTON = 200.0


class Person:
    """Types those lines, one a question; keeps what was said."""

    def __init__(self, *lines: str) -> None:
        self.said: list[str] = []
        self._lines = iter(lines)

    def say(self, text: str) -> None:
        self.said.append(text)

    def poll(self) -> str | None:
        return next(self._lines)


def weighed(
    monkeypatch: pytest.MonkeyPatch, loads_n: list[float], *lines: str
) -> tuple[list[float], list[str]]:
    """Readings of a pad under those loads in newtons, of which that is typed, and what was said."""
    person, felt = Person(*lines), iter(loads_n)
    monkeypatch.setattr(calibrate, "pad_counts", lambda *_: (COUNTS_PER_NEWTON * next(felt), False))
    nothing = cast(Any, None)
    points = calibrate.weigh(nothing, nothing, "A", 15.0, person, lambda text: None)
    return [point.force_n for point in points], person.said


def test_zero_of_a_scale_is_no_reading_and_costs_none_of_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forces = [0.5, 1.0, 2.0, 3.0, 4.0]
    taken, said = weighed(monkeypatch, forces, "0 g", *(f"{n} N" for n in forces), "")
    assert taken == forces
    assert "0 N is no load: load the pad, then type what the scale says" in said


def test_reading_that_the_others_contradict_is_left_out_and_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forces = [0.5, 1.0, 2.0, 3.0, 4.0, 5.0]
    typed = ("0.5 N", "1 N", "2 N", "9 N", "4 N", "5 N", "")
    taken, said = weighed(monkeypatch, forces, *typed)
    assert taken == [0.5, 1.0, 2.0, 4.0, 5.0]
    assert "9.00 N contradicts the others: it is left out" in said


class Finger:
    """That always meets the scale."""

    counts = 100

    def idle(self) -> None: ...

    def to(self, counts: int) -> bool:
        return True


def presses(*lines: str, count: int = 4) -> tuple[list[float], list[str]]:
    """Readings, and what was asked."""
    person = Person(*lines)
    return calibrate.pressed(cast(Presser, Finger()), count, 60.0, person), person.said


def test_press_that_was_mistyped_is_made_again() -> None:
    forces, _ = presses("10.5 N", "5.2 N", "11.5 N", "12 N", "11 N")
    assert forces == [10.5, 11.5, 12.0, 11.0]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("1.2 N", "1.2 kg"), ("12 g", "12 N"), ("1.25 g", "1.25 kg"), ("50 N", "5 N")],
)
def test_weights_that_are_all_typed_in_the_wrong_unit_are_asked_for_again(
    wrong: str, right: str
) -> None:
    """Ten of them contradict one another nowhere: the manual's force is what tells."""
    forces, said = presses(*([wrong, right] * 4))
    assert forces == [pytest.approx(newtons(right))] * 4
    assert sum("is far from the 15 N that the manual says of byte 0" in line for line in said) == 4


def test_hand_that_may_press_too_hard_is_refused_with_what_to_type() -> None:
    with pytest.raises(UsageError) as byte_0:
        check_force(14.0)
    assert byte_0.value.remedy == "--up-to 15"
    check_force(15.0)
