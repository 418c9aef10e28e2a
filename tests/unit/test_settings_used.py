"""Every declared setting is used."""

import ast
import typing
from collections.abc import Iterator
from pathlib import Path

import msgspec

from detector.training.settings import TrainSettings
from drivers.ur.emulator.controller import EmulatorSettings
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.datasets.plan import DatasetConfig
from scenarios.campaign.config import RunConfig
from scenarios.campaign.spec import CampaignSpec

ROOT = Path(__file__).parents[2]
PACKAGES = ("grasp", "drivers", "detector", "scenarios")
FILES = (
    RunConfig, AcquireConfig, CampaignSpec, DatasetConfig, TrainSettings, EmulatorSettings,
)  # fmt: skip


def structs(hint: object) -> Iterator[type[msgspec.Struct]]:
    """The struct classes in a type, and in their fields."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint
        for field in typing.get_type_hints(hint).values():
            yield from structs(field)
    for part in typing.get_args(hint):
        yield from structs(part)


class Source(typing.NamedTuple):
    """Names in the product's code: attributes that it reads, and its string constants."""

    attributes: set[str]
    texts: set[str]


def source() -> Source:
    found = Source(set(), set())
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                    found.attributes.add(node.attr)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.texts.add(node.value)
    return found


def unread(file: type[msgspec.Struct], source: Source) -> list[str]:
    """Settings of a file, `Section.setting`, that the code never reads."""
    found = []
    for section in dict.fromkeys(structs(file)):
        left = set(section.__struct_fields__) - source.attributes
        if section is file:  # its sections are looked up by name too
            left -= source.texts
        found += [f"{section.__name__}.{name}" for name in sorted(left)]
    return found


def test_every_setting_is_read() -> None:
    product = source()
    assert [name for file in FILES for name in unread(file, product)] == []
