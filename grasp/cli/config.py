"""`grasp config show`: every setting with its value, allowed range and source; `check`: are files
of one's own what they should be?"""

import argparse
import json
import shlex
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError, GraspError, UsageError
from grasp.cli import exits
from grasp.cli.output import json_line
from grasp.cli.rules import check_weights, tell_untuned
from grasp.cli.run import add_trial_options

HELP = "show the resolved settings, check files of your own"
FINGERPRINT = "a file of your own that settings came from, and its fingerprint"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("config", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    show = actions.add_parser("show", help="every setting, its value and what is allowed")
    show.add_argument("section", nargs="?", help="show this section alone")
    add_trial_options(show, rig="emulated")
    show.add_argument(
        "--json", action="store_true", help="the resolved settings as one JSON object"
    )
    show.set_defaults(handler=run)
    text = "are files of your own what they should be?"
    check = actions.add_parser(
        "check", help=text,
        description=text + " Opens no device and runs no trial; the detectors of a campaign are "
        "loaded. What a file is, an object, surface, calibration, rig, campaign, data "
        "set, or settings for --config, is told by what is in it. Each is judged alone. Exit code "
        "2 if one is wrong.",
    )  # fmt: skip
    check.add_argument("file", nargs="+", metavar="FILE", help="path of a .toml file")
    check.set_defaults(handler=check_files)


def check_files(args: argparse.Namespace) -> int:
    code = exits.SUCCESS
    for word in args.file:
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
    from scenarios.trial.config import check_answer_and_rule

    default = load_config("can", "simulated").detector_name
    readers, refused = [], None
    for name in sorted(DETECTORS, key=lambda name: (name != default, name)):
        config = load_for_devices("can", "simulated", path, detector=name)
        try:
            check_answer_and_rule(config.rule, config.controller, own_layers(path, ()))
            readers.append(name)
        except ConfigError as error:
            refused = refused or error
    if refused is None or default in readers:
        return ""
    if readers:
        return f" (read with {', '.join(readers)}, not with {default}: {refused.key})"
    layered = f"grasp config show --config THAT.toml --config {shlex.quote(str(path))}"
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


def run(args: argparse.Namespace) -> int:
    import msgspec

    from grasp.settings import allowed, meant, sources_of
    from scenarios.campaign.config import load_config
    from scenarios.trial.config import trial_layers

    chosen = (args.object, args.rig, args.detector, args.config, args.set, args.profile)
    config = load_config(*chosen)
    check_weights(config)
    table = msgspec.to_builtins(config)
    sections = [name for name, value in table.items() if isinstance(value, dict)]
    if args.section is not None and args.section not in sections:
        if args.section == "detector":
            told = f"its settings are in [{config.detector_section}] and [rule]"
            remedy = f"`grasp detector card` names all, {config.detector_name} is chosen: {told}"
            raise UsageError("no section 'detector'", remedy)
        hint = meant(args.section, sections)
        raise UsageError(f"no section {args.section!r}{hint}", f"one of: {', '.join(sections)}")
    shown = sections if args.section is None else [args.section]
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
