"""The calibration of the hand: section `calibration`, from a file chosen by name or by path."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.protocol import FULL_BYTE
from grasp.settings import (
    Layer,
    assignment_layer,
    is_path,
    named_layer,
    names,
    read_toml,
    without_chosen,
)

Files = Path | Sequence[Path] | None  # of one's own, later ones on top; none: that of $GRASP_CONFIG


def own_files_of(files: Files) -> list[Path]:
    """Those given, else that of $GRASP_CONFIG, else none; an empty variable names none."""
    given = [files] if isinstance(files, Path) else list(files or ())
    named = os.environ.get("GRASP_CONFIG")
    return given or ([Path(named)] if named else [])


def own_layers(files: Files, assignments: Sequence[str]) -> list[Layer]:
    """The user's files, then the assignments.

    Raises ConfigError for a file that cannot be read, and for a name that the command line alone
    may choose.
    """
    read = map(read_toml, own_files_of(files))
    return [without_chosen(layer) for layer in (*read, assignment_layer(assignments))]


def rig_layers(word: str) -> tuple[str, list[Layer]]:
    """The packaged rig that a name or a file stands for, and what is set for it: that rig's
    settings, and over them the file's. Raises ConfigError."""
    if not is_path(word):
        return word, [without_chosen(named_layer("rigs", word))]
    file = read_toml(Path(word))
    like = file.table.get("rig")
    if like not in names("rigs"):
        said = "missing" if like is None else f"{like!r} is none"
        raise ConfigError(word, "rig", said, " or ".join(names("rigs")))
    rest = {key: value for key, value in file.table.items() if key != "rig"}
    own = Layer(file.source, rest)
    return str(like), [without_chosen(named_layer("rigs", str(like))), without_chosen(own)]


KIND = "calibrations"
MANUAL = GripperCalibration(
    name="manual", source="Robotiq 3-Finger manual, 2014, p. 47", least_force_n=15.0
)
FAR = 3.0  # times: forces further from the manual's, up or down, are not believed (assumed)
WEAK_PRESSES = 10  # of a byte that is said to be weaker than the manual's
_BYTES = range(FULL_BYTE + 1)


def calibration_layers(layers: Sequence[Layer]) -> list[Layer]:
    """What lies below ``layers``: the file that their `gripper.calibration` chooses, if any.

    So the settings that a run keeps say what a byte was worth. Raises ConfigError.
    """
    chosen = ""
    for layer in layers:
        chosen = _choice(layer.table, chosen)
    if not chosen:
        return []
    is_path = "/" in chosen or chosen.endswith(".toml")
    file = read_toml(Path(chosen)) if is_path else named_layer(KIND, chosen)
    return [Layer(file.source, {"calibration": {"name": Path(chosen).stem}}), file]


def weak_claim(known: GripperCalibration) -> str:
    """A warning for every run on real devices with a hand that is said to press with less than its
    manual states, at any byte; empty for any other hand."""
    byte = _weakest(known)
    if known.force_n(byte) >= MANUAL.force_n(byte) - 1e-9:
        return ""
    return (
        f"calibration {known.name!r} has force byte {byte} press with {known.force_n(byte):.4g} N, "
        f"less than the manual's {MANUAL.force_n(byte):.3g} N, by: {known.source}"
    )


def in_words(known: GripperCalibration) -> str:
    """What force byte 0 presses with, and who says so."""
    return weak_claim(known) or (
        f"calibration {known.name!r} has force byte 0 press with {known.least_force_n:g} N, by: "
        f"{known.source}"
    )


def check_claim(known: GripperCalibration) -> None:
    """Raises ConfigError for less than a third of the manual's force at any byte, and for less than
    the manual's where byte 0 was not pressed as often as `grasp calibrate hand` asks."""
    if not weak_claim(known):
        return
    byte = _weakest(known)
    manual_n = MANUAL.force_n(byte)
    claim = (
        f"{known.name!r} has force byte {byte} press with {known.force_n(byte):.4g} N, less than"
    )
    remedy = "what `grasp calibrate hand` writes; until then manual"
    if known.force_n(byte) < manual_n / FAR - 1e-9:
        why = f"{claim} a third of the manual's {manual_n:.3g} N, by {known.source}"
        raise ConfigError("gripper", "calibration", why, remedy)
    if 0 not in known.pressed_bytes or known.presses < WEAK_PRESSES:
        why = (f"{claim} the manual's {manual_n:.3g} N, by {known.source}: it does not say that "
               f"byte 0 was pressed {WEAK_PRESSES} times")  # fmt: skip
        raise ConfigError("gripper", "calibration", why, remedy)


def _weakest(known: GripperCalibration) -> int:
    """The byte of which the least part of the manual's force is claimed."""
    return min(_BYTES, key=lambda byte: known.force_n(byte) / MANUAL.force_n(byte))


def choices() -> str:
    """What `gripper.calibration` may be, in words."""
    return f"{', '.join(names(KIND))}, or the path of a .toml file"


def _choice(table: dict[str, Any], before: str) -> str:
    gripper = table.get("gripper")
    choice = gripper.get("calibration", before) if isinstance(gripper, dict) else before
    return choice if isinstance(choice, str) else ""  # no text: refused where settings are loaded
