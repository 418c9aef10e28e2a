"""Fills the frozen settings classes of the packages from layers of TOML.

Later layers win. Every violation raises one ConfigError with the file, the key and the allowed
values.
"""

import difflib
import math
import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

from drivers.errors import ConfigError

T = TypeVar("T", bound=msgspec.Struct)
Table = dict[str, Any]

MAX_CHARACTERS = 1_000_000  # of a file
UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")
# a key, and a number with a comma as the decimal sign
COMMA_LINE = re.compile(r"^[ \t]*([\w.-]+)[ \t]*=[ \t]*([+-]?[0-9]+,[0-9]+)[ \t]*(?:#.*)?$", re.M)
MAX_DEPTH = 16  # of nested tables and lists
TOGETHER = "values that are consistent with each other"
# keys that are chosen by a command-line option, because they select further settings
CHOSEN = {"rig": "--rig", "profile": "--profile", "detector_name": "--detector"}
# subfolder with held-out test objects: found by name, but in no list
UNSEEN = "unseen"


class Layer(msgspec.Struct, frozen=True):
    """Settings from one place; ``source`` names it in error messages."""

    source: str
    table: Table


def config_dir() -> Path:
    """Folder of the packaged configuration: next to this file, or `config/` of a checkout."""
    installed = Path(__file__).parent / "_config"
    return installed if installed.is_dir() else Path(__file__).parent.parent / "config"


def names(kind: str) -> list[str]:
    """Names for which config/<kind>/<name>.toml exists; held-out ones are in <kind>/unseen."""
    return sorted(p.stem for p in (config_dir() / kind).glob("*.toml"))


def read_toml(path: Path) -> Layer:
    """Read a file as a layer; raises ConfigError if it is missing, malformed or no settings."""
    text = ""
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(MAX_CHARACTERS + 1)
        if "\0" in text:
            raise _other_encoding(path, "UTF-16")
        if len(text) > MAX_CHARACTERS:
            raise ValueError(f"more than {MAX_CHARACTERS} characters")
        table = tomllib.loads(text)
    except FileNotFoundError:
        raise ConfigError(str(path), "-", "no such file", "the path of a TOML file") from None
    except UnicodeDecodeError as error:
        marked = error.object.startswith(UTF_16_MARKS)
        raise _other_encoding(path, "UTF-16" if marked else "Latin-1 or Windows-1252") from None
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, tomllib.TOMLDecodeError) and (comma := COMMA_LINE.search(text)):
            raise _decimal_comma(str(path), *comma.groups()) from None
        raise ConfigError(str(path), "-", f"cannot be read: {error}", "valid TOML, UTF-8") from None
    return checked(Layer(str(path), table))


def _other_encoding(path: Path, likely: str) -> ConfigError:
    return ConfigError(str(path), "-", f"is not UTF-8, but probably {likely}", "save it as UTF-8")


def _decimal_comma(source: str, key: str, value: str) -> ConfigError:
    point = f"write a decimal point: {value.replace(',', '.')}"
    return ConfigError(source, key, f"is {value}, with a comma as the decimal sign", point)


def checked(layer: Layer) -> Layer:
    """The layer, after a check of its values; raises ConfigError for impossible ones."""
    _check(layer.source, "", layer.table, 0)
    return layer


def _check(source: str, key: str, value: Any, depth: int) -> None:
    if depth > MAX_DEPTH:
        raise ConfigError(source, key, "is nested too deeply", f"{MAX_DEPTH} levels")
    if isinstance(value, dict):
        for name, inner in value.items():
            _check(source, f"{key}.{name}".lstrip("."), inner, depth + 1)
    elif isinstance(value, list):
        for inner in value:
            _check(source, key, inner, depth + 1)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(source, key, "is not finite", "finite numbers")
    elif isinstance(value, int) and value.bit_length() > 63:
        raise ConfigError(source, key, "is too large for any setting", "less than 2^63")
    elif not all(c.isprintable() or c in "\n\t" for c in f"{key}{value}"):
        raise ConfigError(source, key, "contains control characters", "printable text")


def without_chosen(layer: Layer, options: Mapping[str, str] = CHOSEN) -> Layer:
    """The layer; raises ConfigError if it sets a key that only an option may choose."""
    for key in sorted(options.keys() & layer.table.keys()):
        raise ConfigError(layer.source, key, "is no setting", f"choose it with {options[key]}")
    return layer


def named_layer(kind: str, name: str, others: Sequence[str] = ()) -> Layer:
    """Read config/<kind>/<name>.toml. Raises ConfigError with the known names and ``others``."""
    known, testing = [*names(kind), *others], names(f"{kind}/{UNSEEN}")
    if name in testing:
        if name in names(kind):
            problem = f"is also the name of a file in config/{kind}/{UNSEEN}"
            raise ConfigError(f"config/{kind}/{name}.toml", name, problem, "another name")
        kind = f"{kind}/{UNSEEN}"
    elif name not in names(kind):
        rest = f"; held out for tests: {', '.join(testing)}" if testing else ""
        hint = suggestion(name, [*known, *testing])
        raise ConfigError(f"config/{kind}", name, f"unknown{hint}", ", ".join(known) + rest)
    return read_toml(config_dir() / kind / f"{name}.toml")


def suggestion(word: str, known: Sequence[str]) -> str:
    """Hint at the most similar known word, to append to a message; empty if there is none."""
    close = [each for each in known if len(word) > 2 and each.startswith(word)]
    close = close or difflib.get_close_matches(word, known, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def is_path(word: str) -> bool:
    """Whether a word is the path of a user's settings file rather than a name."""
    return word.endswith(".toml")


def item_layer(kind: str, section: str, word: str) -> Layer:
    """Read an item by name or path in config/<kind>, or from a user's file with only that section
    and a name that is not taken. Raises ConfigError."""
    path = Path(word)
    if not is_path(word):
        return named_layer(kind, word)
    if is_packaged(kind, path):
        return with_free_name(named_layer(kind, path.stem), kind, section, path.stem)
    layer = read_toml(path)
    for key in sorted(layer.table.keys() - {section}):
        raise ConfigError(word, key, f"does not belong to the {section}", f"only [{section}]")
    if not isinstance(layer.table.get(section), dict):
        raise ConfigError(word, section, "missing", f"a section [{section}]")
    return with_free_name(layer, kind, section)


def is_packaged(kind: str, path: Path) -> bool:
    """Whether a file is in config/<kind> or its folder of held-out test objects."""
    folder = (config_dir() / kind).resolve()
    return path.resolve().parent in (folder, folder / UNSEEN)


def with_free_name(layer: Layer, kind: str, section: str, chosen: Any = None) -> Layer:
    """The layer, if its item has no name of one in config/<kind>, with which results could be
    confused. It may keep the name ``chosen``. Raises ConfigError."""
    table = layer.table.get(section)
    name = table.get("name") if isinstance(table, dict) else None
    if name != chosen and name in [*names(kind), *names(f"{kind}/{UNSEEN}")]:
        taken = f"is {name!r}, a name in config/{kind}"
        remedy = f"another name, or --{section} {name}"
        raise ConfigError(layer.source, f"{section}.name", taken, remedy)
    return layer


def file_of(kind: str, word: str) -> Path:
    """Path of a file given by path or name in config/<kind>; raises ConfigError if unknown."""
    if is_path(word) or os.sep in word:
        return Path(word)
    return Path(named_layer(kind, word).source)


def assignment_layer(assignments: Sequence[str]) -> Layer:
    """Layer of `section.key=value` words of the command line; a value is TOML, else plain text."""
    pairs = []
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not all(key.strip().split(".")):
            raise ConfigError("--set", text, "not an assignment", "section.key=value")
        pairs.append((key.strip(), _value(key, value.strip())))
    return layer_of("--set", pairs)


def layer_of(source: str, values: Iterable[tuple[str, Any]]) -> Layer:
    """Layer of values by their dotted names; the value of a section is a mapping."""
    table: Table = {}
    for name, value in values:
        *sections, last = name.split(".")
        node = table
        for section in sections:
            node = node.setdefault(section, {})
            if not isinstance(node, dict):
                raise ConfigError(source, name, "is both a value and a section", "one of them")
        node[last] = value
    return checked(Layer(source, table))


def _value(key: str, text: str) -> Any:
    try:
        return tomllib.loads(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        if COMMA_LINE.match(f"v={text}"):
            raise _decimal_comma("--set", key, text) from None
        return text
    except (ValueError, RecursionError) as error:  # thousands of digits or brackets
        raise ConfigError("--set", key, str(error), "a value of TOML, or text") from None


def load(cls: type[T], layers: Sequence[Layer]) -> T:
    """Merge the layers and convert; raises ConfigError for the first violation."""
    merged, sources = _merged(layers)
    try:
        return msgspec.convert(merged, cls)
    except msgspec.ValidationError as error:
        raise _explain(cls, str(error), sources) from None


def sources_of(layers: Sequence[Layer]) -> dict[str, str]:
    """Source of each setting that is not a default, by its dotted name."""
    return _merged(layers)[1]


def _merged(layers: Sequence[Layer]) -> tuple[Table, dict[str, str]]:
    merged: Table = {}
    sources: dict[str, str] = {}

    def merge(into: Table, new: Table, source: str, prefix: str) -> None:
        for key, value in new.items():
            sources[prefix + key] = source
            if isinstance(value, dict) and isinstance(into.get(key, {}), dict):
                merge(into.setdefault(key, {}), value, source, f"{prefix}{key}.")
            else:
                into[key] = value

    for layer in layers:
        merge(merged, layer.table, layer.source, "")
    return merged, sources


def _explain(cls: type[msgspec.Struct], message: str, sources: dict[str, str]) -> ConfigError:
    """Make a ConfigError from msgspec's message, `problem - at `$.section.key``."""
    problem, _, at = message.partition(" - at `$")
    key = at.rstrip("`").lstrip(".")
    whole = hasattr(_type_at(cls, key), "__struct_fields__")  # a section, not one setting
    if field := re.search(r"(?:unknown|required) field `(.+?)`", problem):
        known = [name for name in _fields(_type_at(cls, key)) if key or name not in CHOSEN]
        key = f"{key}.{field[1]}".lstrip(".")
        elsewhere = [
            f"{s}.{field[1]}" for s in _fields(cls) if field[1] in _fields(_type_at(cls, s))
        ]
        hint = suggestion(elsewhere[0], elsewhere) if elsewhere else suggestion(field[1], known)
        text = "missing" if "required" in problem else f"unknown key{hint}"
        return ConfigError(_source(sources, key), key, text, ", ".join(known))
    if not key:  # inconsistent settings, of which the message names the first
        named = re.match(r"([a-z_]+\.[a-z_0-9]+): ", problem)
        return ConfigError(_source(sources, named[1] if named else ""), "-", problem, TOGETHER)
    remedy = TOGETHER if whole and not problem.startswith("Expected") else allowed(cls, key)
    if word := re.match(r"Invalid enum value '(.*)'", problem):
        problem += suggestion(word[1], re.findall(r"'(\w+)'", remedy))
    return ConfigError(_source(sources, key), key, problem, remedy)


def _source(sources: dict[str, str], key: str) -> str:
    key = re.sub(r"\[.*", "", key)
    while key and key not in sources:
        key = key.rpartition(".")[0]
    files = set(sources.values())
    return sources.get(key) or (files.pop() if len(files) == 1 else "configuration")


def _parts(key: str) -> list[str]:
    """Parts of a dotted key, without indices into lists and tables."""
    return [part for part in re.sub(r"\[[^]]*\]", "", key).split(".") if part]


def _fields(cls: type) -> tuple[str, ...]:
    return getattr(cls, "__struct_fields__", ())


def _type_at(cls: type, key: str) -> type:
    """The struct class at a dotted key, also of an optional value or the items of a list."""
    for part in _parts(key):
        hint = get_type_hints(cls).get(part, cls)
        cls = next((arg for arg in get_args(hint) if hasattr(arg, "__struct_fields__")), hint)
    return cls


def allowed(cls: type, key: str) -> str:
    """Allowed values of a field from its declaration: type, range and description."""
    *owner, name = _parts(key)
    within = _type_at(cls, ".".join(owner))
    if owner and not hasattr(within, "__struct_fields__"):
        return allowed(cls, ".".join(owner))  # a table with arbitrary names
    annotation = get_type_hints(within, include_extras=True).get(name, "?")
    base, *metas = get_args(annotation) or (annotation,)
    text = _type_text(get_type_hints(within).get(name, base))
    meta = next((m for m in metas if isinstance(m, msgspec.Meta)), None)
    if meta is None:
        return text
    signs = ((">=", meta.ge), (">", meta.gt), ("<=", meta.le), ("<", meta.lt))
    bounds = " and ".join(f"{sign} {bound:g}" for sign, bound in signs if bound is not None)
    description = f" ({meta.description})" if meta.description else ""
    return f"{text} {bounds}".strip() + description


def _type_text(kind: Any) -> str:
    """A type in words: `3 x 2 x int` is three times two integers, `n` is any number of them."""
    parts = get_args(kind)
    if get_origin(kind) is tuple and len({*parts} - {Ellipsis}) == 1:
        number = "n" if Ellipsis in parts else str(len(parts))
        return f"{number} x {_type_text(parts[0])}"
    if get_origin(kind) in (Union, UnionType):
        return " | ".join("None" if part is NoneType else _type_text(part) for part in parts)
    if get_origin(kind) is Literal:
        return " or ".join(map(str, parts))
    if isinstance(kind, type) and not parts:
        return kind.__name__
    return str(kind).replace("typing.", "")
