"""The page of a first day is what happens: played again, it asks and ends as it says there."""

from pathlib import Path

import pytest

from tests.nightly.day import play, skeleton

PAGE = Path(__file__).parents[2] / "docs" / "first-day.md"


@pytest.mark.timeout(900)
def test_first_day_goes_as_its_page_says(tmp_path: Path) -> None:
    assert skeleton(play(tmp_path)) == skeleton(PAGE.read_text(encoding="utf-8"))
