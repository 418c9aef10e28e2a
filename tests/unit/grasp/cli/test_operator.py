"""Questions at a terminal: input never blocks the caller."""

import os
import sys
from collections.abc import Iterator

import pytest

from drivers.errors import UsageError
from grasp.cli.questions import TerminalOperator
from scenarios.trial.operator_prompts import WITHDRAWN


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Descriptor to which tests write typed input."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as standard_input:
        monkeypatch.setattr(sys, "stdin", standard_input)
        yield writing
    os.close(writing)


def test_lines_are_returned_one_by_one_once_complete(typed: int) -> None:
    person = TerminalOperator()
    os.write(typed, b"12")
    assert person.poll() is None
    os.write(typed, b".5\nl\n")
    assert [person.poll(), person.poll(), person.poll()] == ["12.5", "l", None]


def test_ended_input_is_refused_before_the_first_question(typed: int) -> None:
    person = TerminalOperator()
    person.expect()
    os.write(typed, b"early\n")
    person.expect()
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, sys.stdin.fileno())
    os.close(nowhere)
    with pytest.raises(UsageError, match="no terminal for questions"):
        person.expect()


def test_input_before_a_question_is_discarded(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    person = TerminalOperator()
    os.write(typed, b"\n\n\n")
    person.say("How far?")
    assert person.poll() is None
    assert capsys.readouterr().err == ">>> How far?\n"


def test_question_is_open_until_it_is_answered_or_withdrawn(typed: int) -> None:
    person = TerminalOperator()
    assert not person.asking
    person.say("How far?")
    os.write(typed, b"1")
    assert person.poll() is None and person.asking
    os.write(typed, b"2\n")
    assert person.poll() == "12" and not person.asking
    person.say("How far?")
    person.say(WITHDRAWN)
    assert not person.asking


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
