"""Both pictures of docs/architecture.md say what the code does: its rooms, and a step's data."""

import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import msgspec
import pytest

from grasp.controller import Decision
from grasp.loop import Tick
from grasp.observation import Observation, StepInput
from grasp.step import StepResult

PAGE = Path(__file__).parents[2] / "docs" / "architecture.md"
PARTS = ("grasp.cli", "detector.training")  # rooms of their own
RECORDS: tuple[type[msgspec.Struct], ...] = (StepInput, Observation, Decision, StepResult, Tick)
FIELDS = {record.__name__: record.__struct_fields__ for record in RECORDS}
ARROW = re.compile(r"(\w+) (?:-- \"(.*)\" )?--> (\w+)")

Arrows = set[tuple[str, str]]


@pytest.fixture(scope="module")
def pictures() -> list[str]:
    """Flowcharts of the page: of the data, of the rooms."""
    return re.findall(r"```mermaid\nflowchart TD\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)


# The rooms


def room(module: str) -> str:
    """Short name of the room that a module is in; empty for `scenarios` itself. What `import grasp`
    is stands with the library, whose names it lends."""
    parts = module.split(".")
    if module == "grasp":
        return "library"
    if parts[0] == "scenarios":
        return ".".join(parts[1:2])
    return parts[1] if ".".join(parts[:2]) in PARTS else parts[0]


@cache
def modules() -> dict[str, set[str]]:
    """What each module imports."""
    graph = grimp.build_graph("grasp", "drivers", "detector", "scenarios", cache_dir=None)
    return {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}


def imports() -> Arrows:
    every = {
        (room(module), room(other)) for module, others in modules().items() for other in others
    }
    return {(a, b) for a, b in every if a and b and a != b}


def reached(start: str, arrows: Arrows) -> set[str]:
    found: set[str] = set()
    ahead = [start]
    while ahead:
        new = {b for a, b in arrows if a == ahead[-1]} - found
        found |= new
        ahead[-1:] = new
    return found


def drawn(arrows: Arrows) -> list[str]:
    """Without arrows that follow from others."""
    needed = {(a, b) for a, b in arrows if b not in reached(a, arrows - {(a, b)})}
    return [f"    {a} --> {b}" for a, b in sorted(needed)]


def test_the_picture_of_the_rooms_is_the_import_graph(pictures: list[str]) -> None:
    assert pictures[1].splitlines() == drawn(imports())


def test_rooms_import_one_another_in_no_circle() -> None:
    arrows = imports()
    assert [name for name in {a for a, _ in arrows} if name in reached(name, arrows)] == []


def test_modules_import_one_another_in_no_circle() -> None:
    TopologicalSorter(modules()).prepare()


def test_every_room_is_described() -> None:
    text = PAGE.read_text("utf-8")
    rows = "\n".join(re.findall(r"^\| (`.*?) \|", text, re.MULTILINE))
    described = {name.split("/")[-1] for name in re.findall(r"`([\w/]+)`", rows)}
    rooms = {name for arrow in imports() for name in arrow}
    assert rooms - described - {"training"} == set()


# The data


def labelled(picture: str) -> list[tuple[str, list[str], str]]:
    """Arrows as tail, fields, head."""
    found = (ARROW.search(line) for line in picture.splitlines())
    return [(m[1], m[2].split(", ") if m[2] else [], m[3]) for m in found if m]


def test_records_of_a_step_are_drawn_with_their_fields(pictures: list[str]) -> None:
    nodes = re.findall(r"(\w+)\[\"\1: (.*)\"\]", pictures[0])
    assert {name: tuple(fields.split(", ")) for name, fields in nodes} == FIELDS


def test_what_goes_along_an_arrow_is_a_field_of_what_it_joins(pictures: list[str]) -> None:
    for tail, fields, head in labelled(pictures[0]):
        if not {tail, head} & FIELDS.keys():
            continue  # between parts: test_data_picture.py
        known = {*FIELDS.get(tail, ()), *FIELDS.get(head, ())}
        assert [field for field in fields if field not in known] == [], f"{tail} --> {head}"


def test_every_field_comes_from_somewhere(pictures: list[str]) -> None:
    arrows = labelled(pictures[0])
    for name, wanted in FIELDS.items():
        arriving = {field for _, fields, head in arrows if head == name for field in fields}
        assert arriving == set(wanted), name
