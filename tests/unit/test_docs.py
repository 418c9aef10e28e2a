"""Links in the documents have targets, and their commands exist."""

import re
import shlex
from pathlib import Path

from grasp.cli.commands import build_parser

ROOT = Path(__file__).parents[2]


def test_links_between_documents_have_targets() -> None:
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def anchors(page: Path) -> set[str]:
    """Link anchors of a page's headings, as the site and Git hosts make them."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    heads = (re.sub(r"[^\w\s-]", "", head) for head in re.findall(r"^#+ (.+)$", text, re.MULTILINE))
    return {re.sub(r"[-\s]+", "-", head.strip().lower()) for head in heads}


def test_links_into_a_document_match_its_headings() -> None:
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        found = re.findall(r"\]\((?!https?:)([^)#]*)#([^)]+)\)", page.read_text(encoding="utf-8"))
        for target, anchor in found:
            there = page.parent / target if target else page
            assert anchor in anchors(there), f"{page.name}: {target}#{anchor}"


def test_commands_in_the_hardware_pages_exist() -> None:
    docs = ROOT / "docs"
    played = re.findall(r"^\$ (grasp .*)$", (docs / "first-day.md").read_text(), re.MULTILINE)
    steps = (docs / "hardware.md").read_text().partition("## Moved by hand")[0]
    lines = [*played, *re.findall(r"`(grasp [^`]+)`", steps)]
    assert len(lines) > 20
    for line in lines:
        assert build_parser().parse_args(shlex.split(line)[1:]).command, line
