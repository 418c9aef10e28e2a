"""The words of the command line: no number gets past the parser unchecked."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.errors import UsageError
from grasp.cli.main import build_parser, main
from grasp.cli.options import decimal, need, progress, whole
from grasp.cli.pictures import picture
from grasp.cli.places import file_to_write, file_with_folders, folder_to_fill

PLACES = (file_to_write, file_with_folders, folder_to_fill)


def options(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """Every argument of every verb, with the words that lead to it."""
    for action in parser._actions:  # argparse has no public way to walk
        if isinstance(action, argparse._SubParsersAction):
            for verb in dict.fromkeys(action.choices.values()):
                yield from options(verb)
        elif action.type not in (None, str, Path, picture, *PLACES):
            yield f"{parser.prog} {'/'.join(action.option_strings) or action.dest}", action


NUMBERS = dict(options(build_parser()))


@pytest.mark.parametrize("name", NUMBERS)
def test_every_number_of_the_command_line_has_bounds(name: str) -> None:
    read = NUMBERS[name].type
    assert callable(read)
    below = "-100" if name.startswith("grasp arm step") else "-1"  # a step goes either way
    for text in (below, "nan", "1e400", "inf", "9" * 30, "much", ""):
        with pytest.raises((argparse.ArgumentTypeError, ValueError)):
            read(text)


def test_numbers_are_found_in_every_group_of_verbs() -> None:
    verbs = {name.split()[1] for name in NUMBERS}
    assert {"run", "campaign", "detector", "world", "emulate"} <= verbs


def test_a_number_out_of_bounds_is_a_usage_error_that_names_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["world", "calibrate", "--recording", "x.csv", "--clips"]
    assert main([*words, "-1"]) == 2
    assert "2 to 100000" in capsys.readouterr().err


def test_bounds_belong_to_what_is_allowed() -> None:
    assert (whole(2, 5)("2"), whole(2, 5)("5")) == (2, 5)
    assert (decimal(0.5, 2)("0.5"), decimal(0.5, 2)("2")) == (0.5, 2.0)


@pytest.mark.parametrize(
    ("words", "twice"),
    [
        ("detector evaluate energy energy --recording x.csv", "NAME: energy twice"),
        ("detector evaluate energy --data sets sets/", "--data: sets twice"),
        ("detector tune --static a.csv ./a.csv", "--static: a.csv twice"),
    ],
)
def test_what_is_listed_twice_is_refused_because_it_would_count_twice(
    words: str, twice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert f"argument {twice}" in capsys.readouterr().err


def test_a_package_that_is_not_installed_is_refused_with_its_extra() -> None:
    need("charts", "numpy")
    with pytest.raises(UsageError, match="no_such_package") as caught:
        need("charts", "no_such_package")
    assert "grasp-controller[charts]" in caught.value.remedy
    assert "make install-charts" in caught.value.remedy


def test_a_picture_in_a_folder_that_is_not_there_is_refused_before_anything_is_computed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["world", "strokes", "--out", "nowhere/a.svg"]) == 2
    assert "there is no folder nowhere" in capsys.readouterr().err


def test_progress_without_a_terminal_is_a_line_for_each_tenth(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress("draws") as show:
        for done in range(1, 101):
            show(done, 100)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(",")[0] for line in lines] == [
        f"draws: {done} of 100" for done in range(10, 101, 10)
    ]
    assert all(line.endswith(" s left") for line in lines)
    with progress("draws", hidden=True) as show:
        show(1, 1)
    assert not capsys.readouterr().err


def test_lines_of_progress_begin_anew_with_the_next_of_several(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress("training") as show:
        for name in ("first", "second"):
            for step in (1, 10):
                show(step, 10, name)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [
        "first: 1 of 10", "first: 10 of 10", "second: 1 of 10", "second: 10 of 10",
    ]  # fmt: skip
