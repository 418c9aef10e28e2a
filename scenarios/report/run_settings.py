"""Settings of a trial compared with the defaults, and the command that repeats it.

Settings are the resolved table of a recording, which the experiment has changed (``configured``),
or of a campaign, which it has not."""

import json
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from drivers.errors import ConfigError
from grasp.settings import CHOSEN, UNSEEN, Layer, load, named_layer, names
from scenarios.campaign.config import RunConfig
from scenarios.rigs.calibration import calibration_layers
from scenarios.tap.config import TapSettings
from scenarios.tap.tap import tap
from scenarios.trial import operator_prompts
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.trial.layers import detector_layers

Resolved = Mapping[str, Any]
NAMED = ("rig", "profile", "detector_name", "object.name")  # set by separate options


def scenario_of(settings: Resolved) -> str:
    """Name of the experiment with these settings."""
    return "tap" if "tap" in settings else "lift"


class Setting(msgspec.Struct, frozen=True):
    """One setting; ``default`` is None where it is unknown."""

    key: str
    value: str
    default: str | None

    @property
    def changed(self) -> bool:
        return self.default is not None and self.value != self.default


def settings_of(settings: Resolved, configured: bool = True) -> list[Setting]:
    """All settings in order, with values as TOML."""
    defaults = dict(_leaves(_defaults(settings, configured)))
    known = bool(defaults)
    return [
        Setting(key, toml(value), toml(defaults.get(key)) if known else None)
        for key, value in _leaves(settings)
        if key not in NAMED
    ]


def command_of(settings: Resolved, seed: str, configured: bool = True) -> str:
    """The command that repeats the trial with this version and its packaged configuration."""
    name, profile, scenario = settings["object"]["name"], settings["profile"], scenario_of(settings)
    arguments = ["grasp", "run", scenario, "--rig", settings["rig"]]
    arguments += ["--object", name if _packaged(name) else f"{name}.toml"]
    if profile != DEFAULT_PROFILE:
        arguments += ["--profile", profile]
    if settings["detector_name"] != _detector_of(profile):
        arguments += ["--detector", settings["detector_name"]]
    arguments += ["--seed", seed, *(("--trials", "1") if scenario == "tap" else ())]
    for each in settings_of(settings, configured):
        # a calibration is selected by its name, and null means that a setting is not given
        if each.changed and not each.key.startswith("calibration.") and each.value != "null":
            arguments += ["--set", f"{each.key}={each.value}"]
    return shlex.join(arguments)


def object_file(settings: Resolved) -> str:
    """The TOML file of a user's object; empty for a packaged one."""
    if _packaged(settings["object"]["name"]):
        return ""
    lines = [f"{k} = {toml(v)}" for k, v in settings["object"].items() if v is not None]
    return "\n".join(["[object]", *lines]) + "\n"


def toml(value: Any) -> str:
    """A value as TOML, which equals JSON for numbers, texts and lists; None as null, for
    display."""
    return json.dumps(value, ensure_ascii=False)


def _packaged(name: str) -> bool:
    return name in [*names("objects"), *names(f"objects/{UNSEEN}")]


def _detector_of(profile: str) -> str:
    try:
        return str(named_layer("profiles", profile).table.get("detector_name", ""))
    except ConfigError:
        return ""


def _defaults(settings: Resolved, configured: bool) -> dict[str, Any]:
    """Default settings for the same rig, profile, object and detector; empty where this version
    lacks one of them."""
    name = settings["object"]["name"]
    recorded = Layer("recording", {"object": settings["object"]})
    try:
        layers = [
            named_layer("rigs", settings["rig"]),
            named_layer("profiles", settings["profile"]),
            named_layer("objects", name) if _packaged(name) else recorded,
            *detector_layers(settings["detector_name"]),
            Layer("names", {key: settings[key] for key in CHOSEN if key in settings}),
        ]
        config = load(RunConfig, [*calibration_layers(layers), *layers])
        return _configured(settings, config) if configured else msgspec.to_builtins(config)
    except ConfigError:
        return {}


def _configured(settings: Resolved, config: RunConfig) -> dict[str, Any]:
    """The settings as the experiment changes them before it begins."""
    table: dict[str, Any] = msgspec.to_builtins(config)
    if scenario_of(settings) == "tap":
        mallet = load(TapSettings, [Layer("recording", settings["tap"])])
        configured = tap.configure(msgspec.structs.replace(config.for_tap(), tap=mallet))
        return {**msgspec.to_builtins(configured), "tap": table["tap"]}
    # with an operator the hold lasts until the tape mark has been read
    if settings.get("controller", {}).get("hold_s") == operator_prompts.HOLD_S:
        table["controller"]["hold_s"] = operator_prompts.HOLD_S
    return table


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and their values; a list is one value."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
