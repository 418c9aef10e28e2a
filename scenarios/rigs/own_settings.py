"""What a user's own files and `--set` may say: settings, but not which rig, profile or detector.

A rig may be a file of one's own too. It says which of the packaged rigs it is like, and is opened
as that one: a file for real devices is `hardware` whatever it is called.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from drivers.errors import ConfigError
from grasp.settings import (
    Layer,
    assignment_layer,
    by_path,
    named_layer,
    names,
    not_chosen,
    read_toml,
)

Files = Path | Sequence[Path] | None  # of one's own, later ones on top; none: that of $GRASP_CONFIG


def own_files_of(files: Files) -> list[Path]:
    """Those given, else that of $GRASP_CONFIG, else none; an empty variable names none."""
    given = [files] if isinstance(files, Path) else list(files or ())
    named = os.environ.get("GRASP_CONFIG")
    return given or ([Path(named)] if named else [])


def own_layers(files: Files, assignments: Sequence[str]) -> list[Layer]:
    """The user's files, then the assignments.

    Raises ConfigError for a file that cannot be read or says nothing, and for a name that the
    command line alone may choose.
    """
    read = [says_something(read_toml(file)) for file in own_files_of(files)]
    return [not_chosen(layer) for layer in (*read, assignment_layer(assignments))]


def says_something(layer: Layer) -> Layer:
    """The layer, if there is a setting in it: what a command that failed should have written is
    empty, and would pass for the settings there are without it. Raises ConfigError."""
    if any(table != {} for table in layer.table.values()):
        return layer
    remedy = f"settings (a rule: `grasp detector tune ... > {layer.source}`), or no such file"
    raise ConfigError(layer.source, "-", "says nothing: there is no setting in it", remedy)


def rig_layers(word: str) -> tuple[str, list[Layer]]:
    """The packaged rig that a name or a file stands for, and what is set for it: that rig's
    settings, and over them the file's. Raises ConfigError."""
    if not by_path(word):
        return word, [not_chosen(named_layer("rigs", word))]
    file = read_toml(Path(word))
    like = file.table.get("rig")
    if like not in names("rigs"):
        said = "missing" if like is None else f"{like!r} is none"
        raise ConfigError(word, "rig", said, " or ".join(names("rigs")))
    rest = {key: value for key, value in file.table.items() if key != "rig"}
    own = Layer(file.source, rest, file.digest)
    return str(like), [not_chosen(named_layer("rigs", str(like))), not_chosen(own)]
