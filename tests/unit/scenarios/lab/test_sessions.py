"""Calibrations with a person who mistypes, or a scale that says nothing; no devices."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from drivers.errors import UsageError
from scenarios.campaign.config import load_config
from scenarios.lab import sessions
from scenarios.lab.fit import Line, check_places, law_of, of_byte
from scenarios.lab.scale import (
    Presser,
    check_force,
    force_file,
    hand_file,
    newtons,
    reading,
)
from scenarios.lab.sessions import Weighing

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


@pytest.fixture
def weigh(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Weighing, Person]]:
    """A pad under those loads in newtons, and what is typed of them."""

    def weighing(loads_n: list[float], *lines: str) -> tuple[Weighing, Person]:
        person, felt = Person(*lines), iter(loads_n)
        monkeypatch.setattr(
            sessions, "pad_counts", lambda *_: (COUNTS_PER_NEWTON * next(felt), False)
        )
        nothing = cast(Any, None)
        return Weighing(nothing, nothing, "A", 15.0, person, lambda text: None), person

    return weighing


def taken(weighing: Weighing) -> list[float]:
    while weighing.ask("what does it say?"):
        pass
    return [point.force_n for point in weighing.points]


def test_zero_of_a_scale_is_no_reading_and_costs_none_of_the_others(
    weigh: Callable[..., tuple[Weighing, Person]],
) -> None:
    forces = [0.5, 1.0, 2.0, 3.0, 4.0]
    weighing, person = weigh(forces, "0 g", *(f"{n} N" for n in forces), "")
    assert taken(weighing) == forces
    assert "0 N is no load: Enter alone, if that is what the scale says" in person.said
    assert weighing.fit().slope == pytest.approx(COUNTS_PER_NEWTON)


def test_load_that_the_named_pad_does_not_feel_is_told_at_once(
    weigh: Callable[..., tuple[Weighing, Person]],
) -> None:
    weighing, person = weigh([0.0, 2.0], "2 N", "2 N", "")
    assert taken(weighing) == [2.0]
    assert "fingertip A feels nothing of 2.00 N: load its pad" in person.said


def test_correction_that_is_mistyped_too_is_asked_for_again(
    weigh: Callable[..., tuple[Weighing, Person]],
) -> None:
    forces = [1.0, 2.0, 3.0, 4.0, 5.0]
    typed = ["1 N", "2 N", "13 N", "4 N", "5 N"]
    weighing, person = weigh(forces, *typed, "3", "99 N", "0 N", "3 N", "")
    assert taken(weighing) == forces
    assert "'3' is no reading: a number and its unit: N, g or kg" in person.said
    assert "99.00 N is more than --up-to 15: less" in person.said


def test_reading_that_was_typed_rightly_and_contradicts_the_others_is_asked_about_once_a_reading(
    weigh: Callable[..., tuple[Weighing, Person]],
) -> None:
    """The pad erred, not the person: it is left out in the end, or no file is written."""
    loads = [1.0, 2.0, 1.5, 4.0, 5.0, 6.0]  # of the third, 3 N
    typed = ["1 N", "2 N", "3 N", "4 N", "5 N", "3 N", "6 N", "x", ""]
    weighing, person = weigh(loads, *typed)
    assert taken(weighing) == [1.0, 2.0, 4.0, 5.0, 6.0]
    asked = [text for text in person.said if "contradicts the others" in text]
    assert [text.startswith("reading 3, 3.00 N") for text in asked] == [True, True]


def test_round_of_presses_ends_by_its_own_readings_and_no_other_round_s(
    weigh: Callable[..., tuple[Weighing, Person]],
) -> None:
    weighing, person = weigh([4.0, 8.0, 12.0, 1.0], "4 N", "8 N", "12 N", "1 N")
    weighing.round = 1
    for _ in range(3):
        assert weighing.ask("what does it say?")
    assert weighing.room_n <= 0.0  # and after even steps nobody is asked whether that is so
    weighing.round = 2
    assert weighing.room_n == 15.0
    assert weighing.ask("what does it say?")
    assert weighing.room_n == 13.0
    assert not any("ends this round" in text for text in person.said)


class Finger:
    """That always meets the scale."""

    counts = 100

    def idle(self) -> None: ...

    def to(self, counts: int, byte: int = 0) -> bool:
        return True


REASONS: dict[int, str] = {}  # of the presses below, and what was asked
SAID: list[str] = []


@pytest.fixture(autouse=True)
def _nothing_said() -> None:
    REASONS.clear()
    SAID.clear()


def presses(*lines: str, count: int = 4) -> list[float]:
    person = Person(*lines)
    forces = sessions.pressed(cast(Presser, Finger()), 0, count, 60.0, person, REASONS)
    SAID[:] = person.said
    return forces


def test_press_that_was_mistyped_is_corrected() -> None:
    assert presses("10.5 N", "5.2 N", "11.5 N", "12 N", "11 N") == [10.5, 11.0, 11.5, 12.0]


def test_press_that_contradicts_the_others_though_typed_rightly_ends_it() -> None:
    with pytest.raises(UsageError, match=r"press 4, 15.00 N, contradicts the others .*, twice"):
        presses("10 N", "10 N", "10 N", "15 N", "15 N")


class Ruled(Finger):
    """In free air, where it is told to be."""

    def to(self, counts: int, byte: int = 0) -> bool:
        self.counts = counts
        return False


@pytest.mark.parametrize(
    "typed", ["nan", "NaN mm", "inf", "1e400", "-inf", "", "20 cm", "1_0", "٣", "9999"]
)
def test_place_that_is_none_is_asked_for_again_at_once(typed: str) -> None:
    person = Person("", "120", typed, "108 mm", "96,5", "85.5", "-73")
    places = (10, 25, 40, 55, 70)
    asked = [f"At {counts} counts: where is the fingertip, in mm?" for counts in places]
    with pytest.raises(UsageError, match="contradicts"):  # -73 was mistyped
        sessions.travelled(cast(Presser, Ruled()), places, person)
    told = f"{typed!r} is no place on a ruler: a number of millimetres, 2000 at most"
    assert person.said[1:] == [*asked[:2], told, *asked[1:]]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("1.2 N", "1.2 kg"), ("12 g", "12 N"), ("1.25 g", "1.25 kg"), ("50 N", "5 N")],
)
def test_weights_that_are_all_typed_in_the_wrong_unit_are_asked_for_again(
    wrong: str, right: str
) -> None:
    """Ten of them contradict one another nowhere: the manual's force is what tells."""
    forces = presses(*([wrong, right] * 4))
    assert forces == [pytest.approx(newtons(right))] * 4
    assert sum("is far from the 15 N that the manual says of byte 0" in said for said in SAID) == 4
    assert not REASONS


def test_a_hand_that_is_far_from_the_manual_is_believed_for_a_reason_that_is_kept() -> None:
    lines = [
        "2 N",
        "yes",
        "",
        "2 N",
        "0 N",
        "99 N",
        "fingertips of soft foam",
        "2.1 N",
        "2 N",
        "2 N",
    ]
    forces = presses(*lines)
    assert forces == [2.0, 2.1, 2.0, 2.0]
    assert REASONS == {0: "fingertips of soft foam"}
    known = [of_byte(0, [2.0] * 10)]
    text = hand_file("A", known, law_of(known), None, REASONS)
    assert "byte 0 is far from the manual's: fingertips of soft foam" in text
    assert tomllib.loads(text)["calibration"]["source"].endswith(": fingertips of soft foam")


def test_scale_that_says_nothing_is_asked_again() -> None:
    person = Person("0 N", "16 N", "10 N")
    assert reading(person, "what?", lambda: None, 15.0) == 10.0
    assert person.said[1] == "0.00 N is no press: typed rightly?"
    assert person.said[3] == "16.00 N is more than --up-to 15: typed rightly?"


def test_byte_that_may_press_too_hard_is_refused_with_what_to_type() -> None:
    with pytest.raises(UsageError) as byte_0:
        check_force(14.0)
    assert byte_0.value.remedy == "--up-to 15"  # there is no lower byte
    with pytest.raises(UsageError) as stronger:
        check_force(20.0, (0, 40))
    assert stronger.value.remedy == "--up-to 22.1, or a lower byte"
    check_force(22.1, (0, 40))


def test_spread_that_is_too_good_to_be_believed_is_told_beside_what_was_taken() -> None:
    forces = [9.9, 9.91, 9.92, 9.93, 9.94] * 2
    text = hand_file("A", (known := [of_byte(0, forces)]), law_of(known), None, {})
    assert "9.92 N, spread 0.01, taken as 0.10, 95 % below 10.48" in text
    wide = [9.0, 10.0] * 5
    text = hand_file("A", (known := [of_byte(0, wide)]), law_of(known), None, {})
    assert "9.50 N, spread 0.53, 95 % below" in text


@pytest.mark.parametrize("places", [(10, 30, 50, 70), (10, 30, 50, 70, 70), range(10, 35)])
def test_places_that_tell_no_travel_are_refused_before_any_is_read(places: list[int]) -> None:
    with pytest.raises(UsageError, match="too few") as refused:
        check_places(places)
    assert refused.value.remedy == "5 or more, over 26 counts (20 mm) or more"
    check_places([10, 30, 20, 15, 36])


def hand_of(newtons: float, travel: object = None) -> str:
    known = [of_byte(0, [newtons] * 10)]
    return hand_file("A", known, law_of(known), cast(Line, travel), {})


MM = SimpleNamespace(slope=0.08, interval=(0.08, 0.08), worst=0.0, points=5)


@pytest.mark.parametrize(
    "make",
    [
        lambda: hand_of(0.2),
        lambda: hand_of(31.0),
        lambda: hand_of(12.0, MM),
        lambda: force_file("A", Line(2e5, (2e5, 2e5), 0.0, 0.001, 0.01, 5, 4)),
    ],
    ids=["too weak", "too strong", "ruler read in centimetres", "kilograms typed as grams"],
)
def test_calibration_that_no_run_would_take_is_not_written(make: Callable[[], str]) -> None:
    with pytest.raises(UsageError, match="no hand is like that"):
        make()


def test_force_file_once_loaded_says_how_its_counts_were_come_by_and_when(tmp_path: Path) -> None:
    out = tmp_path / "force.toml"
    line = Line(201.8, (200.3, 203.3), 0.04, 0.64, 2.63, 15, 3)
    out.write_text(force_file("A", line, note='the "new" pads'))
    loaded = load_config("can", "simulated", "energy", [out])
    assert loaded.guard.counts_per_newton == 201.8
    (told,) = loaded.source.in_words()
    assert told.startswith("counts a newton by: scale under finger A, 20")
    assert '15 readings, 0.64 to 2.63 N, 200.3 to 203.3 (95 %); the "new" pads' in told
    assumed = load_config("can", "simulated", "energy", [])
    assert assumed.source.in_words() == []
    replaced = msgspec.structs.replace(loaded, source=assumed.source)
    assert replaced.digest() == loaded.digest()  # nothing but people reads it
