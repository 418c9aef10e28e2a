"""The calibration of the hand: section `calibration`, from a file chosen by name or by path."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.robotiq.calibration import GripperCalibration
from grasp.settings import Layer, named_layer, names, read_toml

KIND = "calibrations"
MANUAL_LEAST_N = 15.0  # of byte 0; Robotiq 3-Finger manual, 2014, p. 47


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


def weak_claim(known: GripperCalibration) -> str:
    """What is to be said in every run on real devices of a hand that is said to press with less
    than its manual states; empty for one that is not."""
    if known.least_force_n >= MANUAL_LEAST_N:
        return ""
    return (
        f"calibration {known.name!r} has force byte 0 press with {known.least_force_n:g} N, less "
        f"than the manual's {MANUAL_LEAST_N:g} N, by: {known.source}"
    )


def in_words(known: GripperCalibration) -> str:
    """What force byte 0 presses with, and who says so."""
    return weak_claim(known) or (
        f"calibration {known.name!r} has force byte 0 press with {known.least_force_n:g} N, by: "
        f"{known.source}"
    )


def choices() -> str:
    """What `gripper.calibration` may be, in words."""
    return f"{', '.join(names(KIND))}, or the path of a .toml file"


def _choice(table: dict[str, Any], before: str) -> str:
    gripper = table.get("gripper")
    choice = gripper.get("calibration", before) if isinstance(gripper, dict) else before
    return choice if isinstance(choice, str) else ""  # no text: refused where settings are loaded
