"""The settings of a recorded run beside those that nobody chose, and the command that runs it."""

import json
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from drivers.errors import ConfigError
from grasp.settings import UNSEEN, Layer, load, named_layer, names
from scenarios.campaign.config import RunConfig
from scenarios.report.run_record import RunRecord
from scenarios.rigs.calibration import calibration_layers
from scenarios.tap.settings import TapSettings
from scenarios.tap.tap import tap_config
from scenarios.trial import person
from scenarios.trial.config import DEFAULT_PROFILE

NAMED = ("rig", "profile", "detector_name", "object.name")  # by options of their own


class Setting(msgspec.Struct, frozen=True):
    """One setting; ``usual`` is what it is when nobody says anything, None where nobody knows."""

    key: str
    value: str
    usual: str | None

    @property
    def own(self) -> bool:
        return self.usual is not None and self.value != self.usual


def settings_of(run: RunRecord) -> list[Setting]:
    """All of them, in their order, as TOML writes values."""
    usual = dict(_leaves(_usual(run)))
    known = bool(usual)
    return [
        Setting(key, toml(value), toml(usual.get(key)) if known else None)
        for key, value in _leaves(run.settings)
        if key not in NAMED
    ]


def command_of(run: RunRecord) -> list[str]:
    """Words that run the same trial again with this version and its packaged configuration."""
    told = run.told
    own_object = not _packaged(told.object.name)
    words = ["grasp", "run", run.scenario, "--rig", told.rig]
    words += ["--object", f"{told.object.name}.toml" if own_object else told.object.name]
    if told.profile != DEFAULT_PROFILE:
        words += ["--profile", told.profile]
    if told.detector_name != _detector_of(told.profile):
        words += ["--detector", told.detector_name]
    words += ["--seed", run.metadata.get("seed", "0")]
    words += ["--trials", "1"] if run.scenario == "tap" else []
    for setting in settings_of(run):
        # a calibration is chosen by its name alone, and null is what a setting is without a word
        if setting.own and not setting.key.startswith("calibration.") and setting.value != "null":
            words += ["--set", f"{setting.key}={setting.value}"]
    return words


def object_file(run: RunRecord) -> str:
    """The TOML of an object that is not a packaged one; empty for one that is."""
    if _packaged(run.told.object.name):
        return ""
    lines = [f"{k} = {toml(v)}" for k, v in run.settings["object"].items() if v is not None]
    return "\n".join(["[object]", *lines]) + "\n"


def shell(words: list[str]) -> str:
    return shlex.join(words)


def toml(value: Any) -> str:
    """JSON of numbers, texts and lists is TOML; null is for reading alone."""
    return json.dumps(value, ensure_ascii=False)


def _packaged(body: str) -> bool:
    return body in [*names("objects"), *names(f"objects/{UNSEEN}")]


def _detector_of(profile: str) -> str:
    try:
        return str(named_layer("profiles", profile).table["detector_name"])
    except (ConfigError, KeyError):
        return ""


def _usual(run: RunRecord) -> dict[str, Any]:
    """What the same names give with nothing of one's own; empty where this version cannot tell."""
    told = run.told
    body = told.object.name
    own_object = Layer("recording", {"object": run.settings["object"]})
    try:
        layers = [
            named_layer("rigs", told.rig),
            named_layer("profiles", told.profile),
            named_layer("objects", body) if _packaged(body) else own_object,
            named_layer("detectors", told.detector_name),
            Layer("names", {key: run.settings[key] for key in ("rig", "profile", "detector_name")}),
        ]
        config = load(RunConfig, [*calibration_layers(layers), *layers])
        return _as_run(run, config)
    except ConfigError:
        return {}


def _as_run(run: RunRecord, config: RunConfig) -> dict[str, Any]:
    """With what the experiment itself sets before it begins, and keeps in its recording."""
    table: dict[str, Any] = msgspec.to_builtins(config)
    if run.scenario == "tap":
        tap = load(TapSettings, [Layer("recording", run.settings["tap"])])
        begun = tap_config(msgspec.structs.replace(config.for_tap(), tap=tap))
        return {**msgspec.to_builtins(begun), "tap": table["tap"]}
    if _at(run.settings, "controller", "hold_s") == person.HOLD_S:  # until it has been read
        table["controller"]["hold_s"] = person.HOLD_S
    return table


def _at(table: Mapping[str, Any], section: str, key: str) -> Any:
    return table.get(section, {}).get(key)


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and what stands there; a list is one value."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
