"""`grasp config`: print every setting with its value, allowed range and source, or check the
user's files."""

import json
from pathlib import Path

import msgspec

from drivers.errors import GraspError, UsageError
from grasp import settings
from grasp.cli import exits
from grasp.cli.detector import check_weights, warn_of_untuned_rule
from grasp.cli.device_commands import ConfigOptions
from grasp.cli.output import JsonObject, show
from scenarios.campaign.config import RunConfig, load_config, load_for_devices
from scenarios.rigs.calibration import user_layers
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.trial.layers import check_read, trial_layers


def config(args: ConfigOptions) -> int:
    if not any(settings.is_path(word) for word in args.sections):
        return _show(args)
    if args.json:
        raise UsageError("--json prints settings, but a FILE is checked", "leave out --json")
    default = settings.named_layer("profiles", DEFAULT_PROFILE).table["detector_name"]
    code, detector = exits.SUCCESS, args.detector or str(default)
    for word in args.sections:
        try:
            print(f"{word}: {_checked(word, detector)}")
        except GraspError as error:
            code = exits.report(error.kind, error.message, error.remedy, as_json=False)
    return code


def _checked(word: str, detector: str) -> str:
    """Kind of a file, in words; raises ConfigError, or its reader's error, for a wrong file.
    ``detector``: the detector with which settings are checked."""
    if not settings.is_path(word):
        raise UsageError(f"{word} is no .toml file", "give the path of one")
    path = Path(word)
    table = settings.read_toml(path).table
    return _kind(path, table, detector)


def _kind(path: Path, table: JsonObject, detector: str) -> str:
    from scenarios.acquire.config import AcquireConfig, load_acquire_config
    from scenarios.acquire.datasets.plan import DatasetConfig, load_dataset_config, plan
    from scenarios.campaign.spec import CampaignSpec, combinations, read_spec

    keys, word = table.keys(), str(path)
    packaged = settings.is_packaged("objects", path)
    if packaged or (keys == {"object"} and "name" in table["object"]):
        return f"an object for --object, {load_config(word, 'simulated').object.name!r}"
    if keys == {"surface"}:
        surface = load_acquire_config(word, "simulated").surface
        return f"a surface for --surface, {surface.name!r}"
    if keys == {"calibration"}:
        load_for_devices("can", "simulated", None, [f"gripper.calibration={word}"])
        return "a calibration for gripper.calibration"
    if "rig" in keys:
        return f"a rig for --rig, opened as {load_for_devices('can', word).rig}"
    if keys & {"objects", "scenarios"} and keys <= set(CampaignSpec.__struct_fields__):
        number = len(combinations(read_spec(path)))
        return f"a campaign of {number} combination{'s' if number != 1 else ''}"
    if keys & {"rows", "causes"} and keys <= set(DatasetConfig.__struct_fields__):
        return f"a data set of {len(plan(load_dataset_config(path)))} recordings"
    acquiring = keys & set(AcquireConfig.__struct_fields__)
    if acquiring - set(RunConfig.__struct_fields__):  # sections that a trial does not have
        load_acquire_config("planar", "simulated", path)
        if keys <= acquiring:
            return f"settings for --config, of an acquisition: {', '.join(keys)}"
    config = load_for_devices("can", "simulated", path, detector=detector)
    check_read(config.rule, config.controller, user_layers(path, ()))
    return f"settings for --config, {', '.join(keys)}"


def _show(args: ConfigOptions) -> int:
    chosen = (args.object, args.rig, args.detector, args.config, args.set, args.profile)
    config = load_config(*chosen)
    check_weights(config)
    table = msgspec.to_builtins(config)
    sections = [name for name, value in table.items() if isinstance(value, dict)]
    for word in args.sections:
        if word not in sections:
            hint = settings.suggestion(word, sections)
            remedy = f"a .toml file, or one of: {', '.join(sections)}"
            raise UsageError(f"no such file or section: {word!r}{hint}", remedy)
    shown = args.sections or sections
    layers = trial_layers(*chosen)
    if {"rule", "network"} & set(shown):
        warn_of_untuned_rule(config, layers)

    def text() -> str:
        sources, lines = settings.sources_of(layers), []
        for name in shown:
            lines.append(f"[{name}]")
            for key, value in table[name].items():
                full = f"{name}.{key}"
                range_text = settings.allowed(type(config), full)
                source = _from(sources.get(full))
                lines.append(f"{key} = {json.dumps(value)}  # {range_text}; {source}")
            lines.append("")
        return "\n".join(lines)

    return show(args, {name: table[name] for name in shown}, text)


def _from(source: str | None) -> str:
    if source is None:
        return "default"
    path = Path(source)
    inside = path.is_relative_to(settings.config_dir())
    return f"from {path.relative_to(settings.config_dir()) if inside else source}"
