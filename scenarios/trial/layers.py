"""From which layers of settings a trial's are made, and what in them nothing would read."""

import os
from collections.abc import Sequence
from pathlib import Path

from detector.decision import RuleSettings
from detector.interface import OWN, SECTIONS, section_of
from detector.network_file import is_weights
from detector.plugins import MARK, is_code, offered
from drivers.errors import ConfigError
from grasp.controller_settings import ControllerSettings
from grasp.settings import (
    CHOSEN,
    Layer,
    fingerprint,
    named_layer,
    names,
    not_chosen,
    own_files,
    own_name,
    read_toml,
    thing_layer,
)
from scenarios.rigs.calibration import (
    Files,
    calibration_layers,
    own_layers,
    rig_layers,
    says_something,
)
from scenarios.trial.config import DEFAULT_PROFILE


def detector_layers(word: str) -> list[Layer]:
    """What is set for a detector: its file of config/detectors; of one's own its fingerprint, and
    the `.toml` of the same name beside it, if there is one. Raises ConfigError for an unknown
    name, and where that file says nothing, or speaks of more than a rule and detectors: what is
    read because another file lies beside it sets no limit, and no device."""
    if word in offered() and word not in names("detectors"):
        return []
    if not (is_code(word) or is_weights(word)):
        return [named_layer("detectors", word, (*offered(), f"FILE{MARK}NAME", "FILE.onnx"))]
    file = Path(word.rpartition(":")[0] if is_code(word) else word)
    beside = file.with_suffix(".toml")
    code = Layer(str(file), {}, _fingerprint(file))
    if not os.path.lexists(beside) or _is_being_written(beside):
        return [code]
    layer = says_something(read_toml(beside))
    for section in sorted(layer.table.keys() - {"rule", *SECTIONS}):
        problem = "is not of a detector: what lies beside one sets its rule"
        raise ConfigError(
            layer.source, section, problem, f"[rule] and [{OWN}]; all else by --config"
        )
    return [code, layer]


def _fingerprint(file: Path) -> str:
    """Empty where the file cannot be read: who loads it says so."""
    try:
        return fingerprint(file.read_bytes()) if file.is_file() else ""
    except OSError:
        return ""


def _is_being_written(file: Path) -> bool:
    """Whether what is printed goes there: with `tune mine.onnx > mine.toml` a shell has emptied the
    file before anything is read."""
    try:
        return os.path.samestat(os.fstat(1), file.stat())
    except OSError:  # closed
        return False


def check_read(
    rule: RuleSettings, controller: ControllerSettings, own: Sequence[Layer], detector: str = ""
) -> None:
    """Raises ConfigError where the user's own layers set what the rule, the chosen answer to slip
    or the ``detector``, if one is named, does not read."""
    unread = {
        f"controller.{key}": (by, f"set another {by.partition(' ')[0]}")
        for key, by in controller.unread.items()
    }
    this_rule = f"a rule of kind {rule.kind} and fusion {rule.fusion}"
    unread |= {f"rule.{key}": (this_rule, "set rule.kind or rule.fusion") for key in rule.unread}
    others = SECTIONS - {section_of(detector)} if detector else frozenset()
    for layer in own:
        for key, (by, instead) in sorted(unread.items()):
            section, _, name = key.partition(".")
            if name in layer.table.get(section, {}):
                problem, remedy = f"is not read by {by}", f"leave it out, or {instead}"
                raise ConfigError(layer.source, key, problem, remedy)
        for section in sorted(others & layer.table.keys()):
            said = layer.table[section]
            name = next(iter(said), "") if isinstance(said, dict) else ""
            raise ConfigError(
                layer.source, f"{section}.{name}".rstrip("."), f"is not read by {detector}",
                f"[{section_of(detector)}] alone, or another --detector",
            )  # fmt: skip


def trial_layers(
    object_name: str | Layer,
    rig: str,
    detector: str | None = None,
    files: Files = None,
    assignments: Sequence[str] = (),
    profile: str = DEFAULT_PROFILE,
) -> list[Layer]:
    """Class defaults <- rig <- profile <- object (or as it is) <- detector <- files (or
    $GRASP_CONFIG), later ones on top <- assignments; rig, object and detector by name or path.
    Without a name of its own, the detector is the profile's.

    Raises ConfigError for an unknown name, and where a file or an assignment says one.
    """
    whole = named_layer("profiles", profile)
    if not isinstance(object_name, Layer):
        object_name = thing_layer("objects", "object", object_name)
    if detector is None:
        detector = str(whole.table["detector_name"])
    chosen = object_name.table.get("object", {}).get("name")
    like, of_rig = rig_layers(rig)
    layers = [
        *of_rig,
        not_chosen(whole, {key: CHOSEN[key] for key in ("rig", "profile", "files")}),
        not_chosen(object_name),
        *map(not_chosen, detector_layers(detector)),
        *(own_name(own, "objects", "object", chosen) for own in own_layers(files, assignments)),
    ]
    layers = [*calibration_layers(layers), *layers]
    chosen_names = {"rig": like, "profile": profile, "detector_name": detector}
    return [*layers, Layer("command line", {**chosen_names, "files": own_files(layers)})]
