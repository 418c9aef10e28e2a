"""Fills the frozen, bounded classes that the rooms declare, from layers of TOML.

Later layers win. Every violation becomes one ConfigError that names the file, the key and what is
allowed there.
"""

import difflib
import hashlib
import math
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from drivers.errors import ConfigError

T = TypeVar("T", bound=msgspec.Struct)
Table = dict[str, Any]

PLACE = re.compile(r"\[[^]]*\]")  # in a list or a table: which one does not matter
MOST_BYTES = 1_000_000  # of a file; ours are a few thousand
MOST_DEEP = 16  # tables and lists in one another; ours are three

# What is chosen by an option of its own: with each comes a file of settings, or more
CHOSEN = {
    "rig": "--rig", "profile": "--profile", "detector_name": "--detector", "files": "--config",
}  # fmt: skip


# Of a kind, kept for testing: found by name, in no list, so what goes over a kind never meets them
UNSEEN = "unseen"


class Layer(msgspec.Struct, frozen=True):
    """Settings from one place; ``source`` names it in error messages, ``digest`` tells what a file
    held."""

    source: str
    table: Table
    digest: str = ""


def config_dir() -> Path:
    """Folder of the packaged configuration: beside this file, or `config/` of a checkout."""
    installed = Path(__file__).parent / "_config"
    return installed if installed.is_dir() else Path(__file__).parent.parent / "config"


def names(kind: str) -> list[str]:
    """Names for which config/<kind>/<name>.toml exists; those kept for testing are not among them,
    but in a kind of their own, <kind>/unseen."""
    return sorted(p.stem for p in (config_dir() / kind).glob("*.toml"))


def read_toml(path: Path) -> Layer:
    """One file as a layer; raises ConfigError when it is missing, malformed or no settings."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ValueError(f"more than {MOST_BYTES} bytes")
        table = tomllib.loads(content.decode("utf-8"))
    except FileNotFoundError:
        raise ConfigError(str(path), "-", "no such file", "the path of a TOML file") from None
    except RecursionError:
        raise ConfigError(str(path), "-", "is nested too deeply", f"{MOST_DEEP} levels") from None
    except (OSError, ValueError) as error:
        once = "; a section stands once, with all its keys" if " twice" in str(error) else ""
        problem, allowed = f"cannot be read: {error}", f"valid TOML, UTF-8{once}"
        raise ConfigError(str(path), "-", problem, allowed) from None
    return checked(Layer(str(path), table, fingerprint(content)))


def fingerprint(content: bytes) -> str:
    """Of what a file holds."""
    return hashlib.sha256(content).hexdigest()[:16]


def own_files(layers: Sequence[Layer]) -> dict[str, str]:
    """The files of one's own among the layers, each with its fingerprint."""
    told = {layer.source: layer.digest for layer in layers if layer.digest}
    return {p: digest for p, digest in told.items() if not Path(p).is_relative_to(config_dir())}


def checked(layer: Layer) -> Layer:
    """The layer, if a setting can have such values at all; else ConfigError."""

    def refuse(key: str, problem: str, allowed: str) -> None:
        raise ConfigError(layer.source, key or "-", problem, allowed)

    waiting: list[tuple[str, int, Any]] = [("", 0, layer.table)]
    while waiting:  # not by recursion: that is what too deep a file would break
        key, depth, value = waiting.pop()
        if depth > MOST_DEEP:
            refuse(key, "is nested too deeply", f"{MOST_DEEP} levels")
        if isinstance(value, dict):
            for name, inner in value.items():
                if not name.isprintable():
                    refuse(f"{key}.{name}".lstrip("."), "holds control characters", "plain names")
                waiting.append((f"{key}.{name}".lstrip("."), depth + 1, inner))
        elif isinstance(value, list):
            if any(inner != inner for inner in value):  # a vector has no range that refuses it
                refuse(key, "holds what is not a number", "finite numbers")
            waiting += [(key, depth + 1, inner) for inner in value]
        elif isinstance(value, str):
            if not all(c.isprintable() or c in "\n\t" for c in value):
                refuse(key, "holds control characters", "text that can be printed")
        elif isinstance(value, int) and value.bit_length() > 63:
            refuse(key, "a whole number too large for any setting", "less than 2^63")
        elif isinstance(value, float) and math.isinf(value):
            refuse(key, "is infinite", "a finite number")
    return layer


def not_chosen(layer: Layer, options: Mapping[str, str] = CHOSEN) -> Layer:
    """The layer, if it says nothing that only an option of its own may choose."""
    for key, option in options.items():
        if key in layer.table:
            raise ConfigError(layer.source, key, "is no setting", f"choose it with {option}")
    return layer


def named_layer(kind: str, name: str, others: Sequence[str] = ()) -> Layer:
    """config/<kind>/<name>.toml, or of those kept for testing; raises ConfigError listing the known
    names, and the ``others`` that the caller knows of."""
    known = [*names(kind), *others]
    if name in names(f"{kind}/{UNSEEN}"):
        kind = f"{kind}/{UNSEEN}"
    elif name not in names(kind):
        testing = names(f"{kind}/{UNSEEN}")
        rest = f"; kept for testing: {', '.join(testing)}" if testing else ""
        hint = meant(name, [*known, *testing])
        raise ConfigError(f"config/{kind}", name, f"unknown{hint}", ", ".join(known) + rest)
    return read_toml(config_dir() / kind / f"{name}.toml")


def meant(word: str, known: Sequence[str]) -> str:
    """Behind a word that is none of those known: the one that it is nearly; empty for none."""
    close = difflib.get_close_matches(word, known, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def by_path(word: str) -> bool:
    """Whether a word is the path of a file of one's own rather than a name."""
    return word.endswith(".toml")


def thing_layer(kind: str, section: str, word: str) -> Layer:
    """A thing by its name in config/<kind>, or from a file of one's own by its path, which has that
    section alone and a name that is not taken. Raises ConfigError."""
    if not by_path(word):
        return named_layer(kind, word)
    layer = read_toml(Path(word))
    others = [key for key in layer.table if key != section]
    table = layer.table.get(section)
    if others:
        raise ConfigError(
            word, others[0], f"is not of the {section}", f"[{section}] alone; --config"
        )
    if not isinstance(table, dict):
        raise ConfigError(word, section, "missing", f"a section [{section}]")
    return own_name(layer, kind, section)


def own_name(layer: Layer, kind: str, section: str, chosen: Any = None) -> Layer:
    """The layer, if it gives its thing no name of one in config/<kind>, for which the results would
    be taken; ``chosen`` is the one that it may keep. Raises ConfigError."""
    table = layer.table.get(section)
    name = table.get("name") if isinstance(table, dict) else None
    if name != chosen and name in [*names(kind), *names(f"{kind}/{UNSEEN}")]:
        taken = f"is {name!r}, as one of config/{kind} is called"
        raise ConfigError(
            layer.source, f"{section}.name", taken, f"a name of its own, or --{section} {name}"
        )
    return layer


def file_of(kind: str, word: str) -> Path:
    """A file by its path, or by its name in config/<kind>; raises ConfigError for no known name."""
    if by_path(word) or os.sep in word:
        return Path(word)
    named_layer(kind, word)
    return config_dir() / kind / f"{word}.toml"


def assignment_layer(assignments: Sequence[str]) -> Layer:
    """`section.key=value` words of the command line; a value is TOML, or else plain text."""
    table: Table = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        parts = key.strip().split(".")
        if not equals or not all(parts):
            raise ConfigError("--set", text, "not an assignment", "section.key=value")
        if len(parts) > MOST_DEEP:
            raise ConfigError("--set", key, "is nested too deeply", f"{MOST_DEEP} levels")
        node = table
        for part in parts[:-1]:
            node = node.setdefault(part, {})
            if not isinstance(node, dict):
                raise ConfigError("--set", key, "is both a value and a section", "one of them")
        node[parts[-1]] = _value(key, value.strip())
    return checked(Layer("--set", table))


def _value(key: str, text: str) -> Any:
    try:
        return tomllib.loads(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        return text
    except RecursionError:
        raise ConfigError("--set", key, "is nested too deeply", f"{MOST_DEEP} levels") from None
    except ValueError as error:  # a whole number of thousands of digits
        raise ConfigError("--set", key, str(error), "a value of TOML, or text") from None


def load(cls: type[T], layers: Sequence[Layer]) -> T:
    """Merge the layers and convert; raises ConfigError for the first violation."""
    merged, sources = _merged(layers)
    try:
        return msgspec.convert(merged, cls)
    except msgspec.ValidationError as error:
        raise _explain(cls, str(error), sources) from None


def sources_of(layers: Sequence[Layer]) -> dict[str, str]:
    """Where each setting that is not a class's default is from, by its dotted name."""
    return _merged(layers)[1]


def _merged(layers: Sequence[Layer]) -> tuple[Table, dict[str, str]]:
    merged: Table = {}
    sources: dict[str, str] = {}
    for layer in layers:
        _merge(merged, layer.table, layer.source, sources, "")
    return merged, sources


def _merge(into: Table, new: Table, source: str, sources: dict[str, str], prefix: str) -> None:
    for key, value in new.items():
        path = f"{prefix}{key}"
        sources[path] = source
        if isinstance(value, dict) and isinstance(into.get(key, {}), dict):
            _merge(into.setdefault(key, {}), value, source, sources, f"{path}.")
        else:
            into[key] = value


TOGETHER = "what goes together"
NAMED = re.compile(r"([a-z_]+\.[a-z_0-9]+): ")  # the setting that a problem begins with


def _explain(cls: type[msgspec.Struct], message: str, sources: dict[str, str]) -> ConfigError:
    """A ConfigError from msgspec's message, `problem - at `$.section.key``."""
    problem, _, at = message.partition(" - at `$")
    key = at.rstrip("`").lstrip(".")
    field = re.search(r"(?:unknown|required) field `(.+?)`", problem)
    if field:
        owner = _type_at(cls, key)
        key = f"{key}.{field[1]}".lstrip(".")
        known = list(getattr(owner, "__struct_fields__", ()))
        missing = "required" in problem
        text = "missing" if missing else f"unknown key{meant(field[1], known)}"
        return ConfigError(_source(sources, key), key, text, ", ".join(known))
    if not key:  # settings that do not go together
        named = NAMED.match(problem)
        return ConfigError(_source(sources, named[1] if named else ""), "-", problem, TOGETHER)
    if word := re.match(r"Invalid enum value '(.*)'", problem):
        problem += meant(word[1], re.findall(r"'(\w+)'", allowed(cls, key)))
    if hasattr(_type_at(cls, key), "__struct_fields__") and not problem.startswith("Expected"):
        return ConfigError(_source(sources, key), key, problem, TOGETHER)
    return ConfigError(_source(sources, key), key, problem, allowed(cls, key))


def _source(sources: dict[str, str], key: str) -> str:
    key = re.sub(r"\[.*", "", key)
    while key and key not in sources:
        key = key.rpartition(".")[0]
    files = set(sources.values())
    return sources.get(key) or (files.pop() if len(files) == 1 else "configuration")


def _type_at(cls: type, key: str) -> type:
    """The struct class that the dotted key leads to, where it may be left out or is one of many."""
    for part in filter(None, PLACE.sub("", key).split(".")):
        hint = get_type_hints(cls).get(part, cls)
        cls = next((arg for arg in get_args(hint) if hasattr(arg, "__struct_fields__")), hint)
    return cls


def allowed(cls: type, key: str) -> str:
    """What the field's declaration says is allowed: type, range and description."""
    owner_key, _, name = PLACE.sub("", key).rpartition(".")
    if owner_key and not hasattr(_type_at(cls, owner_key), "__struct_fields__"):
        return allowed(cls, owner_key)  # a table of any names
    hints = get_type_hints(_type_at(cls, owner_key), include_extras=True)
    annotation = hints.get(name, "?")
    base, *metas = get_args(annotation) or (annotation,)
    meta = next((m for m in metas if isinstance(m, msgspec.Meta)), None)
    text = _said(get_type_hints(_type_at(cls, owner_key)).get(name, base))
    if meta is None:
        return text
    bounds = [
        f"{sign} {bound:g}"
        for sign, bound in ((">=", meta.ge), (">", meta.gt), ("<=", meta.le), ("<", meta.lt))
        if bound is not None
    ]
    description = f" ({meta.description})" if meta.description else ""
    return " ".join([text, " and ".join(bounds)]).strip() + description


def _said(kind: Any) -> str:
    """A type in words: `3 x 2 x int` is three times two whole numbers, `n` is any number."""
    parts = get_args(kind)
    if get_origin(kind) is tuple and len({*parts} - {Ellipsis}) == 1:
        many = "n" if Ellipsis in parts else str(len(parts))
        return f"{many} x {_said(parts[0])}"
    if NoneType in parts:
        return " | ".join("None" if part is NoneType else _said(part) for part in parts)
    if isinstance(kind, type) and not parts:
        return kind.__name__
    return str(kind).replace("typing.", "")
