"""Layers of settings that a trial is configured from, and a check for settings without effect."""

import os
from collections.abc import Sequence
from pathlib import Path

from detector.decision import RuleSettings
from detector.loading import PLUGIN, SECTIONS, section_of
from detector.network_file import is_weights
from detector.plugins import FILE_SEPARATOR, installed_plugins, is_plugin_file
from drivers.errors import ConfigError
from grasp.control.controller_settings import ControllerSettings
from grasp.settings import (
    CHOSEN,
    Layer,
    item_layer,
    named_layer,
    names,
    read_toml,
    with_free_name,
    without_chosen,
)
from scenarios.rigs.calibration import (
    Assignments,
    Files,
    calibration_layers,
    rig_layers,
    user_layers,
)
from scenarios.trial.config import DEFAULT_PROFILE


def detector_layers(word: str) -> list[Layer]:
    """Settings of a detector: its file in config/detectors, or for a user's detector the `.toml`
    file of the same name in the same folder, if there is one.

    Raises ConfigError for an unknown name, and where that `.toml` file sets anything but rule and
    detector: it is found implicitly, so it must not change limits or devices."""
    if not (is_plugin_file(word) or is_weights(word)):
        if word in names("detectors"):
            return [named_layer("detectors", word)]
        if word in (installed := installed_plugins()):
            return []
        others = (*installed, f"FILE{FILE_SEPARATOR}NAME", "FILE.onnx")
        return [named_layer("detectors", word, others)]
    file = Path(word.rpartition(":")[0] if is_plugin_file(word) else word)
    beside = file.with_suffix(".toml")
    if not os.path.lexists(beside):
        return []
    layer = read_toml(beside)
    for section in sorted(layer.table.keys() - {"rule", *SECTIONS}):
        problem = "is no detector section; a file beside a detector may only set its rule"
        raise ConfigError(
            layer.source, section, problem, f"[rule] and [{PLUGIN}]; all else by --config"
        )
    return [layer]


def check_read(
    rule: RuleSettings, controller: ControllerSettings, own: Sequence[Layer], detector: str = ""
) -> None:
    """Raises ConfigError where the user's layers set a value that is not read by the rule, the
    slip response or the ``detector``, if one is given."""
    unread = {f"controller.{key}": by for key, by in controller.unread.items()}
    this_rule = f"a rule of kind {rule.kind} and fusion {rule.fusion}"
    unread |= {f"rule.{key}": this_rule for key in rule.unused}
    others = SECTIONS - {section_of(detector)} if detector else frozenset()
    for layer in own:
        for key, by in sorted(unread.items()):
            section, _, name = key.partition(".")
            if name in layer.table.get(section, {}):
                raise ConfigError(layer.source, key, f"is not read by {by}", "leave it out")
        for section in sorted(others & layer.table.keys()):
            remedy = f"[{section_of(detector)}] alone, or another --detector"
            raise ConfigError(layer.source, section, f"is not read by {detector}", remedy)


def trial_layers(
    object_name: str | Layer,
    rig: str,
    detector: str | None = None,
    files: Files = None,
    assignments: Assignments = (),
    profile: str = DEFAULT_PROFILE,
) -> list[Layer]:
    """Layers in order of increasing priority: class defaults, rig, profile, object, detector, files
    (or $GRASP_CONFIG), assignments. Rig, object and detector are names or paths; the object may
    also be a layer. Without ``detector`` the profile's is used.

    Raises ConfigError for an unknown name, and where a file or an assignment selects one of these.
    """
    whole = named_layer("profiles", profile)
    if not isinstance(object_name, Layer):
        object_name = item_layer("objects", "object", object_name)
    if detector is None:
        detector = str(whole.table["detector_name"])
    chosen = object_name.table.get("object", {}).get("name")
    like, of_rig = rig_layers(rig)
    layers = [
        *of_rig,
        without_chosen(whole, {key: CHOSEN[key] for key in ("rig", "profile")}),
        without_chosen(object_name),
        *map(without_chosen, detector_layers(detector)),
        *(with_free_name(x, "objects", "object", chosen) for x in user_layers(files, assignments)),
    ]
    layers = [*calibration_layers(layers), *layers]
    chosen_names = {"rig": like, "profile": profile, "detector_name": detector}
    return [*layers, Layer("command line", chosen_names)]
