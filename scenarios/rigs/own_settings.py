"""What a user's own file and `--set` may say: settings, but not which rig, profile or detector."""

import os
from collections.abc import Sequence
from pathlib import Path

from grasp.settings import Layer, assignment_layer, not_chosen, read_toml


def own_file(file: Path | None) -> Path | None:
    """The file given, else that of $GRASP_CONFIG, else none; an empty variable names none."""
    named = os.environ.get("GRASP_CONFIG")
    return file or (Path(named) if named else None)


def own_layers(file: Path | None, assignments: Sequence[str]) -> list[Layer]:
    """The user's file, if there is one, then the assignments.

    Raises ConfigError for a file that cannot be read, and for a name that the command line alone
    may choose.
    """
    chosen = own_file(file)
    files = [] if chosen is None else [read_toml(chosen)]
    return [not_chosen(layer) for layer in (*files, assignment_layer(assignments))]
