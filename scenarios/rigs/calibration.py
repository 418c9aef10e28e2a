"""Calibration of the hand: the section `calibration`, from a file chosen by name or path."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

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
    suggestion,
    without_chosen,
)
from scenarios.rigs.config import GraspRigConfig

ConfigT = TypeVar("ConfigT", bound=GraspRigConfig)
Files = Path | Sequence[Path] | None  # user's files, later ones override; none: $GRASP_CONFIG
Assignments = Sequence[str] | Layer  # `section.key=value`, or a layer of such values


def config_files(files: Files) -> list[Path]:
    """The given files, else that of $GRASP_CONFIG unless it is empty, else none."""
    given = [files] if isinstance(files, Path) else list(files or ())
    named = os.environ.get("GRASP_CONFIG")
    return given or ([Path(named)] if named else [])


def user_layers(files: Files, assignments: Assignments) -> list[Layer]:
    """Layers of the user's files, then of the assignments.

    Raises ConfigError for an unreadable file, and for a setting that only a command-line option may
    choose.
    """
    read = map(read_toml, config_files(files))
    given = assignments if isinstance(assignments, Layer) else assignment_layer(assignments)
    return [without_chosen(layer) for layer in (*read, given)]


def rig_layers(word: str) -> tuple[str, list[Layer]]:
    """Packaged rig for a name or a file, and its settings overridden by the file's. Raises
    ConfigError."""
    if not is_path(word):
        known = names("rigs")
        if word not in known:
            remedy = f"{', '.join(known)}, or the path of a .toml file"
            raise ConfigError("--rig", "-", f"{word!r} is unknown{suggestion(word, known)}", remedy)
        return word, [without_chosen(named_layer("rigs", word))]
    file = read_toml(Path(word))
    base = file.table.get("rig")
    if base not in names("rigs"):
        problem = "missing" if base is None else f"unknown rig {base!r}"
        raise ConfigError(word, "rig", problem, " or ".join(names("rigs")))
    rest = {key: value for key, value in file.table.items() if key != "rig"}
    overrides = Layer(file.source, rest)
    return str(base), [without_chosen(named_layer("rigs", str(base))), without_chosen(overrides)]


KIND = "calibrations"
MANUAL = GripperCalibration(
    name="manual", source="Robotiq 3-Finger manual, 2014, p. 47", least_force_n=15.0
)
MANUAL_FACTOR = 3.0  # forces beyond this factor of the manual's are implausible; assumed
WEAK_PRESSES = 10  # presses required for a force below the manual's
_BYTES = range(FULL_BYTE + 1)


def calibration_layers(layers: Sequence[Layer]) -> list[Layer]:
    """Layers of the file that `gripper.calibration` in ``layers`` chooses, if any; they go below.

    So a run's recorded settings contain its calibration. Raises ConfigError.
    """
    chosen = ""
    for layer in layers:
        chosen = _choice(layer.table, chosen)
    if not chosen:
        return []
    is_path = "/" in chosen or chosen.endswith(".toml")
    file = read_toml(Path(chosen)) if is_path else named_layer(KIND, chosen)
    return [Layer(file.source, {"calibration": {"name": Path(chosen).stem}}), file]


def calibration(config: GraspRigConfig) -> GripperCalibration:
    """Calibration of this rig's hand; raises ConfigError if none is chosen and, on real devices,
    for an implausible one."""
    if config.calibration is None:
        raise ConfigError("gripper", "calibration", "not set; this rig has no default", choices())
    if config.real:
        check_weak_claim(config.calibration)
    return config.calibration


def settings_to_open(config: ConfigT) -> ConfigT:
    """Settings for a command that only opens the hand, at the least force: the manual's calibration
    replaces an implausible one. Raises ConfigError if none is chosen."""
    try:
        calibration(config)
    except ConfigError:
        if config.calibration is None:
            raise
        return msgspec.structs.replace(config, calibration=MANUAL)
    return config


def weak_claim(known: GripperCalibration) -> str:
    """Warning for a calibration whose force is below the manual's at any byte; else empty. Every
    run on real devices shows it."""
    byte = _weakest(known)
    if known.force_n(byte) >= MANUAL.force_n(byte) - 1e-9:
        return ""
    return (
        f"calibration {known.name!r}: force byte {byte} gives {known.force_n(byte):.4g} N, less "
        f"than the manual's {MANUAL.force_n(byte):.3g} N; source: {known.source}"
    )


def describe_calibration(known: GripperCalibration) -> str:
    """Force of byte 0 and the source of the calibration, or the warning of ``weak_claim``."""
    return weak_claim(known) or (
        f"calibration {known.name!r}: force byte 0 gives {known.least_force_n:g} N; source: "
        f"{known.source}"
    )


def check_weak_claim(known: GripperCalibration) -> None:
    """Raises ConfigError for a force below a third of the manual's at any byte, and for one below
    the manual's with fewer presses of byte 0 than `grasp calibrate hand` takes."""
    if not weak_claim(known):
        return
    byte = _weakest(known)
    manual_n = MANUAL.force_n(byte)
    claim = f"{known.name!r}: force byte {byte} gives {known.force_n(byte):.4g} N, less than"
    remedy = "a file written by `grasp calibrate hand`; until then manual"
    if known.force_n(byte) < manual_n / MANUAL_FACTOR - 1e-9:
        problem = f"{claim} a third of the manual's {manual_n:.3g} N; source: {known.source}"
        raise ConfigError("gripper", "calibration", problem, remedy)
    if 0 not in known.pressed_bytes or known.presses < WEAK_PRESSES:
        problem = (f"{claim} the manual's {manual_n:.3g} N; source: {known.source}; the file does "
                   f"not state {WEAK_PRESSES} presses of byte 0")  # fmt: skip
        raise ConfigError("gripper", "calibration", problem, remedy)


def _weakest(known: GripperCalibration) -> int:
    """Byte with the smallest force relative to the manual's."""
    return min(_BYTES, key=lambda byte: known.force_n(byte) / MANUAL.force_n(byte))


def choices() -> str:
    """Values of `gripper.calibration` that real devices accept, as text."""
    return "manual, or the file that `grasp calibrate hand` writes"


def _choice(table: dict[str, Any], before: str) -> str:
    gripper = table.get("gripper")
    choice = gripper.get("calibration", before) if isinstance(gripper, dict) else before
    return choice if isinstance(choice, str) else ""  # loading the settings refuses other types
