"""Settings that a data set names or draws: surfaces, kinds of objects and layouts, packaged ones or
files by their paths; and single settings replaced for one recording."""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from drivers.errors import ConfigError
from grasp.settings import Layer, by_path, file_of, load, named_layer, thing_layer
from scenarios.world.objects import Name

C = TypeVar("C", bound=msgspec.Struct)
SECTIONS = {"surfaces": "surface", "bodies": "body"}  # of a thing's file


class _Named(msgspec.Struct, frozen=True):
    name: Name


@cache
def called(kind: str, word: str) -> str:
    """The name of a surface or body; raises ConfigError for what is unknown or no such thing."""
    if not by_path(word):
        named_layer(kind, word)
        return word
    section = SECTIONS[kind]
    return load(_Named, [Layer(word, thing_layer(kind, section, word).table[section])]).name


def beside(value: Any, folder: Path) -> Any:
    """A data set's settings, or a part of them, whose paths count from that folder."""
    if isinstance(value, dict):
        return {beside(key, folder): beside(each, folder) for key, each in value.items()}
    if isinstance(value, list):
        return [beside(each, folder) for each in value]
    return str(folder / value) if isinstance(value, str) and by_path(value) else value


def fingerprints(*words: str) -> dict[str, str]:
    """Of the files among them."""
    files = [word for word in words if by_path(word)]
    return {file: hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16] for file in files}


def layout_file(name: str) -> Path | None:
    """Settings of a layout of taxels, by path or by a name in config/layouts; none: the kit's."""
    return file_of("layouts", name) if name else None


def with_values(config: C, values: Mapping[str, Any]) -> C:
    """The configuration with some settings replaced, `section.key`; raises ConfigError."""
    tree = msgspec.to_builtins(config)
    for key, value in values.items():
        section, _, name = key.partition(".")
        if name not in tree.get(section, {}):
            raise ConfigError("randomise", key, "no such setting", "section.key of a setting")
        tree[section][name] = value
    return load(type(config), [Layer("randomise", tree)])
