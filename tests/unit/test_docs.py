"""Links in the documents lead somewhere, and their commands are of this program."""

import re
import shlex
from pathlib import Path

import pytest

from grasp.cli.commands import build_parser

ROOT = Path(__file__).parents[2]


def test_links_between_documents_lead_somewhere() -> None:
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def anchors(page: Path) -> set[str]:
    """Of its headings, as the site and Git's web pages make them."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    heads = (re.sub(r"[^\w\s-]", "", head) for head in re.findall(r"^#+ (.+)$", text, re.MULTILINE))
    return {re.sub(r"[-\s]+", "-", head.strip().lower()) for head in heads}


def test_links_into_a_document_lead_to_a_heading_of_it() -> None:
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        found = re.findall(r"\]\((?!https?:)([^)#]*)#([^)]+)\)", page.read_text(encoding="utf-8"))
        for target, anchor in found:
            there = page.parent / target if target else page
            assert anchor in anchors(there), f"{page.name}: {target}#{anchor}"


def test_commands_in_the_users_pages_are_accepted_by_the_command_line() -> None:
    commands: list[str] = []
    for name in ("index", "troubleshooting", "first-day", "force-limit", "limits"):
        page = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
        commands += re.findall(r"^    (?:\$ )?(grasp [^\n]*)$", page, re.MULTILINE)
        commands += re.findall(r"`(grasp [^`]+)`", page)
    assert len(commands) > 60
    for command in commands:
        words = [
            w for w in shlex.split(command, comments=True)[1:] if w not in ("COMMAND", "--help")
        ]
        if any(word.startswith("--") for word in words):
            assert build_parser().parse_args(words).command, command
        else:  # a name in a sentence
            with pytest.raises(SystemExit, match="0"):
                build_parser().parse_args([*words, "--help"])
