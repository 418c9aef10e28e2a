"""Settings replaced by name: what a recording of a data set draws for itself."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from drivers.errors import ConfigError
from grasp.settings import Layer, file_of, load

C = TypeVar("C", bound=msgspec.Struct)


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
