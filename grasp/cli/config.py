"""`grasp config`: print every setting with its value, allowed range and source, or check the
user's files."""

import argparse
import json
import shlex
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError, GraspError, UsageError
from grasp.cli import exits
from grasp.cli.output import json_line
from grasp.cli.parser import verb
from grasp.cli.rules import check_weights, tell_untuned
from grasp.cli.run import add_trial_options

HELP = "show the resolved settings, check files of your own"
FINGERPRINT = "a file of your own that settings came from, and its fingerprint"


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "config", run, HELP, ". Prints every setting with its value, its allowed "
        "range and its source. With FILE (your own .toml: an object, surface, calibration, rig, "
        "campaign, data set, or settings for --config) it checks that file alone instead. Opens no "
        "device and runs no trial, but loads the detectors of a campaign. Exit code 2 if a file is "
        "wrong.")  # fmt: skip
    parser.option("section SECTION|FILE", "sections to show, or files to check", nargs="*")
    add_trial_options(parser, rig="emulated")
    parser.flag("--json", "the resolved settings as one JSON object")


def run(args: argparse.Namespace) -> int:
    from grasp.settings import by_path

    if not any(by_path(word) for word in args.section):
        return _show(args)
    if args.json:
        raise UsageError("--json prints settings, but a FILE is checked", "leave out --json")
    code = exits.SUCCESS
    for word in args.section:
        try:
            print(f"{word}: {_checked(word)}")
        except GraspError as error:
            code = exits.report(error.kind, error.message, error.remedy, as_json=False)
    return code


def _checked(word: str) -> str:
    """What a file is; raises ConfigError, or what its own reader raises, where it is wrong."""
    from grasp.settings import by_path, fingerprint, read_toml
    from scenarios.acquire.config import load_acquire_config
    from scenarios.acquire.datasets.plan import DatasetConfig, load_dataset_config, plan
    from scenarios.campaign.config import load_config, load_for_devices
    from scenarios.campaign.spec import CampaignSpec, combinations, read_spec

    if not by_path(word):
        raise UsageError(f"{word} is no .toml file", "give the path of one")
    path = Path(word)
    keys = set(read_toml(path).table)
    whose = fingerprint(path.read_bytes())
    if keys == {"object"} and "name" in read_toml(path).table["object"]:
        config = load_config(word, "simulated")
        return f"an object for --object, {config.object.name!r}; fingerprint {whose}"
    if keys == {"surface"}:
        name = load_acquire_config(word, "simulated").surface.name
        return f"a surface for --surface, {name!r}; fingerprint {whose}"
    if keys == {"calibration"}:
        load_for_devices("can", "simulated", None, [f"gripper.calibration={word}"])
        return f"a calibration for gripper.calibration; fingerprint {whose}"
    if "rig" in keys:
        like = load_for_devices("can", word).rig
        return f"a rig for --rig, opened as {like}; fingerprint {whose}"
    if keys & {"objects", "scenarios"} and keys <= set(CampaignSpec.__struct_fields__):
        places = combinations(read_spec(path))
        return f"a campaign of {len(places)} places; fingerprint {whose}"
    if keys & {"rows", "causes"} and keys <= set(DatasetConfig.__struct_fields__):
        jobs = plan(load_dataset_config(path))
        return f"a data set of {len(jobs)} recordings; fingerprint {whose}"
    return f"settings for --config, {_settings(path)}; fingerprint {whose}"


def _settings(path: Path) -> str:
    """Which sections; each must be one of a trial or of an acquisition."""
    from grasp.settings import read_toml
    from scenarios.acquire.config import AcquireConfig, load_acquire_config
    from scenarios.campaign.config import RunConfig, load_for_devices

    sections = read_toml(path).table
    pressed = sections.keys() & (set(AcquireConfig.__struct_fields__))
    if pressed - set(RunConfig.__struct_fields__):  # checks what a trial does not know
        load_acquire_config("planar", "simulated", path)
    if sections.keys() <= pressed and pressed - set(RunConfig.__struct_fields__):
        return f"of an acquisition: {', '.join(sections)}"
    load_for_devices("can", "simulated", path)
    return ", ".join(sections) + _read_by(path)


def _read_by(path: Path) -> str:
    """With which detectors all that is set for the rule is read, where it is not with the default
    one. Raises UsageError where that, or what is set for the answer to slip, is read with none: a
    run that is told no more would refuse it."""
    from detector.interface import DETECTORS
    from scenarios.campaign.config import load_config, load_for_devices
    from scenarios.rigs.calibration import own_layers
    from scenarios.trial.layers import check_read

    default = load_config("can", "simulated").detector_name
    readers, refused = [], None
    for name in sorted(DETECTORS, key=lambda name: (name != default, name)):
        config = load_for_devices("can", "simulated", path, detector=name)
        try:
            check_read(config.rule, config.controller, own_layers(path, ()))
            readers.append(name)
        except ConfigError as error:
            refused = refused or error
    if refused is None or default in readers:
        return ""
    if readers:
        return f" (read with {', '.join(readers)}, not with {default}: {refused.key})"
    layered = f"grasp config --config THAT.toml --config {shlex.quote(str(path))}"
    raise UsageError(
        f"{refused.message}; so alone no run takes it",
        f"{refused.remedy.removeprefix('allowed: ')}; beside THAT file, which does: `{layered}`",
    )


def _whence(source: str | None) -> str:
    """Who set a value; of a packaged file where it lies in `config`."""
    from grasp.settings import config_dir

    if source is None:
        return "default"
    path = Path(source)
    inside = path.is_relative_to(config_dir())
    return f"from {path.relative_to(config_dir()) if inside else source}"


def _show(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.settings import allowed, sources_of
    from scenarios.campaign.config import load_config
    from scenarios.trial.layers import trial_layers

    chosen = (args.object, args.rig, args.detector, args.config, args.set, args.profile)
    config = load_config(*chosen)
    check_weights(config)
    table = msgspec.to_builtins(config)
    sections = [name for name, value in table.items() if isinstance(value, dict)]
    for word in args.section:
        _check_section(word, sections, config)
    shown = args.section or sections
    layers = trial_layers(*chosen)
    if {"rule", "network"} & set(shown):
        tell_untuned(config, layers)
    if args.json:
        print(json_line({name: table[name] for name in shown}))
        return exits.SUCCESS
    sources = sources_of(layers)
    for name in shown:
        print(f"[{name}]")
        for key, value in table[name].items():
            place = f"{name}.{key}"
            told = FINGERPRINT if name == "files" else allowed(type(config), place)
            print(f"{key} = {json.dumps(value)}  # {told}; {_whence(sources.get(place))}")
        print()
    return exits.SUCCESS


def _check_section(word: str, sections: list[str], config: Any) -> None:
    """Raises UsageError for a section that the settings do not have."""
    from grasp.settings import meant

    if word in sections:
        return
    if word == "detector":
        remedy = (
            f"see [{config.detector_section}] and [rule] for the chosen {config.detector_name}; "
            "`grasp detector card` lists all detectors"
        )
        raise UsageError("no section 'detector'", remedy)
    hint = meant(word, sections)
    raise UsageError(f"no section {word!r}{hint}", f"one of: {', '.join(sections)}")
