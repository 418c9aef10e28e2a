"""The settings of a trial beside the defaults, and the command that runs it again. Settings are the
resolved table of a recording (``begun``: the experiment has set some) or of a campaign."""

import json
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from drivers.errors import ConfigError
from grasp.settings import CHOSEN, UNSEEN, Layer, load, named_layer, names
from scenarios.campaign.config import RunConfig
from scenarios.rigs.calibration import calibration_layers
from scenarios.tap.mallet import TapSettings
from scenarios.tap.tap import tap
from scenarios.trial import person
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.trial.layers import detector_layers

Told = Mapping[str, Any]
NAMED = ("rig", "profile", "detector_name", "object.name")  # by options of their own


def scenario_of(told: Told) -> str:
    """Of which experiment they are."""
    return "tap" if "tap" in told else "lift"


class Setting(msgspec.Struct, frozen=True):
    """One setting; ``usual`` is what it is when nobody says anything, None where nobody knows."""

    key: str
    value: str
    usual: str | None

    @property
    def own(self) -> bool:
        return self.usual is not None and self.value != self.usual


def settings_of(told: Told, begun: bool = True) -> list[Setting]:
    """All settings, in order, with values as TOML."""
    usual = dict(_leaves(_usual(told, begun)))
    known = bool(usual)
    return [
        Setting(key, toml(value), toml(usual.get(key)) if known else None)
        for key, value in _leaves(told)
        if key not in NAMED
    ]


def command_of(told: Told, seed: str, begun: bool = True) -> str:
    """The command that repeats the trial with this version and its packaged configuration."""
    body, profile, scenario = told["object"]["name"], told["profile"], scenario_of(told)
    words = ["grasp", "run", scenario, "--rig", told["rig"]]
    words += ["--object", body if _packaged(body) else f"{body}.toml"]
    if profile != DEFAULT_PROFILE:
        words += ["--profile", profile]
    if told["detector_name"] != _detector_of(profile):
        words += ["--detector", told["detector_name"]]
    words += ["--seed", seed, *(("--trials", "1") if scenario == "tap" else ())]
    for setting in settings_of(told, begun):
        # a calibration is chosen by its name alone, and null is what a setting is without a word
        if setting.own and not setting.key.startswith("calibration.") and setting.value != "null":
            words += ["--set", f"{setting.key}={setting.value}"]
    return shlex.join(words)


def object_file(told: Told) -> str:
    """The TOML of an object that is not a packaged one; empty for one that is."""
    if _packaged(told["object"]["name"]):
        return ""
    lines = [f"{k} = {toml(v)}" for k, v in told["object"].items() if v is not None]
    return "\n".join(["[object]", *lines]) + "\n"


def toml(value: Any) -> str:
    """JSON of numbers, texts and lists is TOML; null is for reading alone."""
    return json.dumps(value, ensure_ascii=False)


def _packaged(body: str) -> bool:
    return body in [*names("objects"), *names(f"objects/{UNSEEN}")]


def _detector_of(profile: str) -> str:
    try:
        return str(named_layer("profiles", profile).table.get("detector_name", ""))
    except ConfigError:
        return ""


def _usual(told: Told, begun: bool) -> dict[str, Any]:
    """The settings that the same names give; empty where this version does not know them."""
    body = told["object"]["name"]
    own_object = Layer("recording", {"object": told["object"]})
    try:
        layers = [
            named_layer("rigs", told["rig"]),
            named_layer("profiles", told["profile"]),
            named_layer("objects", body) if _packaged(body) else own_object,
            *detector_layers(told["detector_name"]),
            Layer("names", {key: told[key] for key in CHOSEN if key in told}),
        ]
        config = load(RunConfig, [*calibration_layers(layers), *layers])
        return _as_begun(told, config) if begun else msgspec.to_builtins(config)
    except ConfigError:
        return {}


def _as_begun(told: Told, config: RunConfig) -> dict[str, Any]:
    """With what the experiment itself sets before it begins."""
    table: dict[str, Any] = msgspec.to_builtins(config)
    if scenario_of(told) == "tap":
        mallet = load(TapSettings, [Layer("recording", told["tap"])])
        begun = tap.configure(msgspec.structs.replace(config.for_tap(), tap=mallet))
        return {**msgspec.to_builtins(begun), "tap": table["tap"]}
    if told.get("controller", {}).get("hold_s") == person.HOLD_S:  # until it has been read
        table["controller"]["hold_s"] = person.HOLD_S
    return table


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and their values; a list is one value."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
