"""No setting is declared that nothing reads."""

import ast
import os
import typing
from collections.abc import Iterator
from pathlib import Path

import msgspec
import mypy.build
import mypy.config_parser
import mypy.options
import pytest
from mypy.find_sources import create_source_list
from mypy.nodes import MemberExpr
from mypy.types import Instance, TupleType, Type, TypeVarType, UnionType, get_proper_type

from detector.training.settings import TrainSettings
from drivers.ur.emulator.settings import EmulatorSettings
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.datasets.plan import DatasetConfig
from scenarios.campaign.config import RunConfig
from scenarios.campaign.spec import CampaignSpec
from scenarios.studies.grip_search import GripCriteria
from scenarios.world.ladder.experiments import World

ROOT = Path(__file__).parents[2]
PACKAGES = ("grasp", "drivers", "detector", "scenarios")
FILES = (
    RunConfig, AcquireConfig, CampaignSpec, DatasetConfig, GripCriteria, World, TrainSettings,
    EmulatorSettings,
)  # fmt: skip


def structs(hint: object) -> Iterator[type[msgspec.Struct]]:
    """The struct classes in a type, and in the fields of those."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint
        for field in typing.get_type_hints(hint).values():
            yield from structs(field)
    for part in typing.get_args(hint):
        yield from structs(part)


class Said(typing.NamedTuple):
    """What the product's code says: attributes it reads, texts that stand alone."""

    attributes: set[str]
    texts: set[str]


@pytest.fixture(scope="module")
def said() -> Said:
    found = Said(set(), set())
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                    found.attributes.add(node.attr)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.texts.add(node.value)
    return found


def unread(file: type[msgspec.Struct], said: Said) -> list[str]:
    """Settings of a file, `Section.setting`, that the code never reads."""
    found = []
    for section in dict.fromkeys(structs(file)):
        left = set(section.__struct_fields__) - said.attributes
        if section is file:  # its sections are looked up by name too
            left -= said.texts
        found += [f"{section.__name__}.{name}" for name in sorted(left)]
    return found


@pytest.mark.parametrize("file", FILES)
def test_every_setting_is_read(file: type[msgspec.Struct], said: Said) -> None:
    assert unread(file, said) == []


# what is looked up by a name: sections, and a file that is one more layer; and what people read
NOT_BY_TYPE = {
    "RunConfig.network", "RunConfig.psd", "RunConfig.psd_fair",
    "DriverSettings.calibration", "GraspObject.description", "FixedSurface.description",
    "DatasetConfig.name",
}  # fmt: skip


def read_by_type() -> set[tuple[str, str]]:
    """Class and attribute of every access that the type checker sees, base classes included."""
    told = mypy.options.Options()
    mypy.config_parser.parse_config_file(told, lambda: None, str(ROOT / "pyproject.toml"))
    told.export_types, told.preserve_asts, told.incremental = True, True, False
    told.cache_dir = os.devnull
    sources = create_source_list([str(ROOT / package) for package in PACKAGES], told)
    types = mypy.build.build(sources, told).types
    accesses = [e for e in types if isinstance(e, MemberExpr) and e.expr in types]
    return {(owner, e.name) for e in accesses for owner in owners(types[e.expr])}


def owners(kind: Type) -> Iterator[str]:
    """Full names of our classes that a value of this type may be of."""
    kind = get_proper_type(kind)
    if isinstance(kind, Instance):
        yield from (base.fullname for base in kind.type.mro if base.fullname.startswith(PACKAGES))
    elif isinstance(kind, UnionType):
        for item in kind.items:
            yield from owners(item)
    elif isinstance(kind, TypeVarType):
        yield from owners(kind.upper_bound)
    elif isinstance(kind, TupleType):
        yield from owners(kind.partial_fallback)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_setting_is_read_of_its_own_section() -> None:
    """By type, so that another class's attribute of the same name does not count."""
    reads = read_by_type()
    sections = dict.fromkeys(section for file in FILES for section in structs(file))
    unread = [
        f"{section.__name__}.{name}"
        for section in sections
        for name in section.__struct_fields__
        if not any((f"{c.__module__}.{c.__qualname__}", name) in reads for c in section.__mro__)
    ]
    assert set(unread) == NOT_BY_TYPE


class PlantedSection(msgspec.Struct, frozen=True):
    force_limit_n: float = 10.0
    force_limit_of_nothing_n: float = 10.0


class PlantedFile(RunConfig, frozen=True, kw_only=True):
    planted: PlantedSection = PlantedSection()


def test_a_setting_that_nothing_reads_is_found(said: Said) -> None:
    assert unread(PlantedFile, said) == [
        "PlantedFile.planted", "PlantedSection.force_limit_of_nothing_n",
    ]  # fmt: skip
