"""The documents say what the code does."""

import re
from pathlib import Path

from grasp.phases import TRANSITIONS, Trigger
from grasp.settings import names
from scenarios.campaign.config import load_config
from scenarios.lift.scoring import LiftOutcome
from scenarios.tap.scoring import TapOutcome

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


def test_files_that_the_guides_name_are_there() -> None:
    rooms = "grasp|drivers|detector|scenarios|config|tests|docs|scripts|requirements"
    for guide in ("CONTRIBUTING.md", "docs/architecture.md"):
        named = re.findall(rf"`((?:{rooms})/[\w./-]+)`", read(guide))
        named = [name for name in named if "NAME" not in name]
        assert len(named) > 10
        assert [name for name in named if not (ROOT / name).exists()] == [], guide
