"""Every command of the page of a first day, and of the steps on hardware, is one of ours."""

import re
import shlex
from pathlib import Path

import pytest

from grasp.cli.main import build_parser
from scripts.figures import shown
from scripts.first_day import page_of, table_of

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


def test_page_of_a_first_day_says_what_it_found_and_of_which_code() -> None:
    page = DOCS / "first-day.md"
    text = page.read_text()
    assert table_of(text) in text
    (item,) = shown(page)
    assert item.figure is not None
    assert (item.figure.id, item.figure.command) == (
        "first-day", "python -m scripts.first_day --write",
    )  # fmt: skip
    assert "scenarios/lab" in item.figure.paths


def test_play_that_has_found_nothing_is_no_page() -> None:
    with pytest.raises(ValueError, match="calibrate hand"):
        page_of("```\n$ grasp find\n```\n", "0123abc")
