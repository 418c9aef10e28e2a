"""The calibration of the hand: section `calibration`, from a file chosen by name or by path."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp.settings import Layer, named_layer, names, read_toml

KIND = "calibrations"


def calibration_layers(layers: Sequence[Layer]) -> list[Layer]:
    """What lies below ``layers``: the file that their `gripper.calibration` chooses, if any.

    So the settings that a run keeps say what a byte was worth. Raises ConfigError.
    """
    chosen = ""
    for layer in layers:
        chosen = _choice(layer.table, chosen)
    if not chosen:
        return []
    by_path = "/" in chosen or chosen.endswith(".toml")
    file = read_toml(Path(chosen)) if by_path else named_layer(KIND, chosen)
    return [Layer(file.source, {"calibration": {"name": Path(chosen).stem}}), file]


def choices() -> str:
    """What `gripper.calibration` may be, in words."""
    return f"{', '.join(names(KIND))}, or the path of a .toml file"


def _choice(table: dict[str, Any], before: str) -> str:
    gripper = table.get("gripper")
    choice = gripper.get("calibration", before) if isinstance(gripper, dict) else before
    return choice if isinstance(choice, str) else ""  # no text: refused where settings are loaded
