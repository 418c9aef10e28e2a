"""Every command of the page of a first day, and of the steps on hardware, is one of ours."""

import re
import shlex
from pathlib import Path

import pytest

from grasp.cli.main import build_parser

DOCS = Path(__file__).parents[2] / "docs"


def commands() -> list[str]:
    played = re.findall(r"^\$ (grasp .*)$", (DOCS / "first-day.md").read_text(), re.MULTILINE)
    steps = (DOCS / "hardware.md").read_text().partition("## Moved by hand")[0]
    return [*played, *re.findall(r"`(grasp [^`]+)`", steps)]


@pytest.mark.parametrize("line", commands())
def test_command_of_a_first_day_is_one_of_this_program(line: str) -> None:
    assert callable(build_parser().parse_args(shlex.split(line)[1:]).handler)


def test_every_step_on_hardware_names_its_verb() -> None:
    text = (DOCS / "hardware.md").read_text().partition("## Moved by hand")[0]
    steps = re.split(r"^\d+\. ", text, flags=re.MULTILINE)[1:]
    assert len(steps) >= 8
    assert [step[:40] for step in steps if "`grasp " not in step] == []
