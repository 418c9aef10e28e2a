"""Surfaces, bodies and layouts that a data set names: packaged ones, or files of one's own by their
paths, which count from the data set's file."""

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from drivers.errors import ConfigError
from grasp.settings import (
    Layer,
    by_path,
    load,
    named_layer,
    read_toml,
    thing_layer,
)
from scenarios.world.objects import Name

SECTIONS = {"surfaces": "surface", "bodies": "body"}  # of a thing's file


class _Named(msgspec.Struct, frozen=True):
    name: Name


def beside(config: Any, folder: Path) -> Any:
    """A data set's settings, or a part of them, whose paths count from that folder."""

    def found(word: str) -> str:
        return str(folder / word) if by_path(word) else word

    def tables(told: Mapping[str, Any]) -> dict[str, Any]:
        return {found(word): value for word, value in told.items()}

    return msgspec.structs.replace(
        config,
        layout=found(config.layout),
        on=tables(config.on),
        rows=[msgspec.structs.replace(r, percent=tables(r.percent)) for r in config.rows],
        parts=[msgspec.structs.replace(p, on=tables(p.on)) for p in config.parts],
        causes=[msgspec.structs.replace(c, on=list(map(found, c.on))) for c in config.causes],
    )


@cache
def called(kind: str, word: str) -> str:
    """The name of a surface or body; raises ConfigError for what is unknown or no such thing."""
    section = SECTIONS[kind]
    if not by_path(word):
        named_layer(kind, word)
        return word
    return load(_Named, [Layer(word, thing_layer(kind, section, word).table[section])]).name


def check(surfaces: Iterable[str], bodies: Iterable[str]) -> None:
    """Raises ConfigError for what is unknown or no such thing, and for two of one name: a recording
    tells its surface by that."""
    names: dict[tuple[str, str], str] = {}
    for kind, words in (("surfaces", surfaces), ("bodies", bodies)):
        for word in words:
            name = called(kind, word)
            other = names.setdefault((kind, name), word)
            if other != word:
                raise ConfigError(
                    word, f"{SECTIONS[kind]}.name", f"is {name!r}, as that of {other}",
                    "a name of its own",
                )  # fmt: skip


def fingerprints(*words: str) -> dict[str, str]:
    """Of the files among them."""
    return {word: read_toml(Path(word)).digest for word in words if by_path(word)}
