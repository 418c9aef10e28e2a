"""The site of `make docs`: every page is on it, under a path, and links out of it become words."""

import re
from pathlib import Path

from scripts.site_hook import on_page_markdown

ROOT = Path(__file__).parents[2]
SITE = (ROOT / "mkdocs.yml").read_text("utf-8")


def test_there_is_a_path_each_for_trying_measuring_and_extending() -> None:
    assert re.findall(r"^  - ([A-Z]\w+):$", SITE, re.MULTILINE) == [
        "Trying",
        "Measuring",
        "Extending",
    ]
    index = (ROOT / "docs" / "index.md").read_text("utf-8")
    assert all(f"**{path}.**" in index for path in ("Trying", "Measuring", "Extending"))


def test_warnings_of_the_site_are_errors() -> None:
    assert "strict: true" in SITE
    assert "mkdocs build --strict" in (ROOT / "Makefile").read_text("utf-8")


def test_every_call_of_the_library_is_in_the_reference() -> None:
    import grasp

    text = (ROOT / "docs" / "api.md").read_text("utf-8")
    (members,) = re.findall(r"library\.calls\n    options:\n      members: \[(.*?)\]", text)
    assert sorted(members.split(", ")) == sorted(grasp.__all__)


def test_links_out_of_the_site_are_told_as_paths() -> None:
    told = on_page_markdown(
        "[CONTRIBUTING.md](../CONTRIBUTING.md), [one](../examples/a.py#x), [in](b.md)"
    )
    assert told == "`CONTRIBUTING.md`, one (`examples/a.py`), [in](b.md)"
