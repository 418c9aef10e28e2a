"""The documents say what the code does."""

import re
from pathlib import Path

from grasp.phases import TRANSITIONS, Trigger
from grasp.settings import names
from scenarios.acquire.acquire import AcquireResult
from scenarios.campaign.config import load_config
from scenarios.lift.result import LiftResult
from scenarios.lift.scoring import LiftOutcome
from scenarios.tap.result import Alarm, TapResult
from scenarios.tap.scoring import TapOutcome
from scenarios.trial.ending import End
from scenarios.trial.result import Bug, PhaseEntry, TimingResult, TrialResult
from scenarios.world.world_settings import RunPlan

ROOT = Path(__file__).parents[2]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def mermaid() -> str:
    """State diagram of the table of phases, in Mermaid's language."""
    lines = ["stateDiagram-v2", "    [*] --> idle"]
    for trigger, sources, dest in TRANSITIONS:
        if trigger in (Trigger.FAIL, Trigger.STOP):
            lines.append(
                f"    note right of {dest.value}: {trigger.value} leads here from every phase"
            )
            continue
        lines += [f"    {s.value} --> {dest.value}: {trigger.value}" for s in sources]
    return "\n".join(lines) + "\n"


def test_state_diagram_is_the_one_of_the_table() -> None:
    shown = re.search(r"```mermaid\n(stateDiagram.*?)```", read("docs/architecture.md"), re.S)
    assert shown is not None
    assert shown[1] == mermaid()


def test_every_outcome_is_explained() -> None:
    text = read("docs/data-formats.md")
    assert [o for o in LiftOutcome if f"`{o.value}`" not in text] == []


def test_every_outcome_of_a_tap_is_explained() -> None:
    text = read("docs/experiments.md")
    assert [o for o in TapOutcome if f"`{o.value}`" not in text] == []


def test_every_key_of_a_result_is_explained_and_no_other() -> None:
    section = read("docs/data-formats.md").split("\n## A result: ")[1].split("\n## ")[0]
    tables = re.findall(r"^\| ([a-z ]+) \| meaning \|\n((?:\|.*\n)+)", section, re.M)
    told = {
        title: {
            key for row in rows.splitlines() for key in re.findall(r"`(\w+)`", row.split("|")[1])
        }
        for title, rows in tables
    }
    both = set(TrialResult.__struct_fields__)
    assert told == {
        "lift and tap": both,
        "lift alone": set(LiftResult.__struct_fields__) - both,
        "tap alone": set(TapResult.__struct_fields__) - both,
        "acquisition": set(AcquireResult.__struct_fields__) - {"failure"},
    }


def test_parts_of_a_result_are_explained() -> None:
    section = read("docs/data-formats.md").split("\n## A result: ")[1].split("\n## ")[0]
    parts = (PhaseEntry, TimingResult, End, Bug, RunPlan, Alarm)
    keys = {key for part in parts for key in part.__struct_fields__}
    assert [key for key in sorted(keys) if f"`{key}`" not in section] == []


def test_positions_of_the_fingers_in_the_document_are_those_of_the_objects() -> None:
    text = read("docs/experiments.md")
    for name in names("objects"):
        counts = load_config(name, "simulated", "energy").object.grip_counts
        assert f"| {name} | {' '.join(map(str, counts))} |" in text


def test_every_object_is_named_in_the_readme() -> None:
    assert [name for name in names("objects") if f"`{name}`" not in read("README.md")] == []


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


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    told = re.findall(r"- (\S+\.md)$", read("mkdocs.yml"), re.MULTILINE)
    assert sorted(told) == sorted(pages)


def test_files_that_the_guides_name_are_there() -> None:
    rooms = "grasp|drivers|detector|scenarios|config|tests|docs|scripts|requirements"
    for guide in ("CONTRIBUTING.md", "docs/architecture.md"):
        named = re.findall(rf"`((?:{rooms})/[\w./-]+)`", read(guide))
        named = [name for name in named if "NAME" not in name]
        assert len(named) > 10
        assert [name for name in named if not (ROOT / name).exists()] == [], guide
