"""Asking and listening at a terminal: nothing that is typed keeps the caller waiting."""

import os
import sys
from collections.abc import Iterator

import pytest

from drivers.errors import UsageError
from grasp.cli.lab import TerminalOperator


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Where to write what is typed."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as standard_input:
        monkeypatch.setattr(sys, "stdin", standard_input)
        yield writing
    os.close(writing)


def test_lines_come_one_by_one_once_they_are_whole(typed: int) -> None:
    person = TerminalOperator()
    os.write(typed, b"12")
    assert person.poll() is None
    os.write(typed, b".5\nl\n")
    assert [person.poll(), person.poll(), person.poll()] == ["12.5", "l", None]


def test_an_input_that_has_ended_is_told_before_anything_is_asked(typed: int) -> None:
    person = TerminalOperator()
    person.expect()
    os.write(typed, b"early\n")
    person.expect()
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, sys.stdin.fileno())
    os.close(nowhere)
    with pytest.raises(UsageError, match="no terminal for questions"):
        person.expect()


def test_what_was_typed_before_a_question_is_no_answer(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    person = TerminalOperator()
    os.write(typed, b"\n\n\n")
    person.say("How far?")
    assert person.poll() is None
    assert capsys.readouterr().err == ">>> How far?\n"


def test_end_of_the_input_counts_as_ctrl_c_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with open(os.devnull) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        person = TerminalOperator()
        with pytest.raises(KeyboardInterrupt):
            person.poll()
        assert person.poll() is None
    assert "standard input has ended" in capsys.readouterr().err
