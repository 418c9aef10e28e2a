"""The words of the command line: no number gets past the parser unchecked."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pytest

from grasp.cli.commands import build_parser
from grasp.cli.main import main
from grasp.cli.options import file_to_write, file_with_folders, folder_to_fill, picture
from grasp.cli.output import progress

PLACES = (file_to_write, file_with_folders, folder_to_fill)


def options(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """Every argument of every verb, with the words that lead to it."""
    for action in parser._actions:  # argparse has no public way to walk
        if isinstance(action, argparse._SubParsersAction):
            for verb in dict.fromkeys(action.choices.values()):
                yield from options(verb)
        elif action.type not in (None, str, Path, picture, *PLACES):
            yield f"{parser.prog} {'/'.join(action.option_strings) or action.dest}", action


def test_every_number_of_the_command_line_has_bounds() -> None:
    numbers = dict(options(build_parser()))
    assert {"run", "campaign", "calibrate", "emulate"} <= {n.split()[1] for n in numbers}
    for name, action in numbers.items():
        assert callable(action.type)
        below = "-100" if name.startswith("grasp arm step") else "-1"  # a step goes either way
        for text in (below, "nan", "1e400", "inf", "9" * 30, "much", ""):
            with pytest.raises((argparse.ArgumentTypeError, ValueError)):
                action.type(text)
                pytest.fail(f"{name} takes {text}")


def test_a_number_out_of_bounds_is_a_usage_error_that_names_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["calibrate", "fingertip", "--recording", "x.csv", "--clips"]
    assert main([*words, "-1"]) == 2
    assert "2 to 100000" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "twice"),
    [
        ("detector evaluate energy energy --recording x.csv", "NAME: energy twice"),
        ("detector evaluate energy --data sets sets/", "--data: sets twice"),
        ("detector tune energy --unlabelled a.csv ./a.csv", "--unlabelled: a.csv twice"),
    ],
)
def test_what_is_listed_twice_is_refused_because_it_would_count_twice(
    words: str, twice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert f"argument {twice}" in capsys.readouterr().err


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
