"""`grasp detector`: score and tune slip detectors, show their cards; check the decision rule of a
user's network."""

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from detector import network_file
from detector.decision import RuleSettings
from detector.loading import DETECTORS, FORMULAS, NETWORK
from detector.plugins import is_plugin
from detector.recording_checks import suspicions
from detector.recordings import Recording, read_all
from drivers.errors import UsageError
from drivers.interfaces import FINGERS
from grasp.cli import exits
from grasp.cli.commands import CardOptions, EvaluateOptions, TuneOptions
from grasp.cli.options import Json, check_writable
from grasp.cli.output import listing, progress, show
from grasp.settings import Layer, config_dir, named_layer, names, sources_of, suggestion
from scenarios.campaign.config import load_config
from scenarios.report.run_view import in_words
from scenarios.rigs.calibration import Files
from scenarios.trial.config import DEFAULT_PROFILE, TrialConfig
from scenarios.trial.layers import trial_layers

if TYPE_CHECKING:
    from detector.scores.evaluation import Evaluation
    from scenarios.benchmark.score_file import DetectorScores

FEW_SLIPS = 50  # with fewer the recall is uncertain: +/- 14 points at a recall of a half
LOW_RECALL = 0.5
FEW_EVENTS = 5  # with fewer allowed false alarms the rate is uncertain
RULE_LEVELS = ("rule.threshold", "rule.limit")  # one for each kind of rule
# keys that their names do not explain
OF_SCORES = {
    "slid": "distance slid until the event",
    "release": "end of the slip to the end of its event",
    "false_per_min": "false alarms per minute of a hand of three fingers; also by cause, where "
    "slide is strokes as in the paper",
    "threshold": "of single samples (accuracy, confusion); events follow the rule above",
}
OF_IMPACTS = {
    "moved": "impacts that moved the object by 1 mm or more",
    "far": "by 2 mm or more; registered: within 100 ms",
    "unmoved": "by less than 0.5 mm; unmoved_strong: those that are not weak",
}
OF_TUNING = {
    "false_per_min": "false alarms per minute of a hand of three fingers",
    "mean_delay_ms": "slips and moving impacts weigh half each; a miss counts 500 ms",
    "minutes": "of a hand at rest",
}
OF_CARD = {
    "window": "samples before the newest that affect an output; mode window: samples of the input",
    "threshold": "of single samples",
    "temperature, shift": "calibration: log-odds plus shift, divided by temperature",
}


def detector_evaluate(args: EvaluateOptions) -> int:
    from scenarios.benchmark.score_file import BEGINS
    from scenarios.benchmark.scoring import contender, read_split
    from scenarios.benchmark.slips import evaluated

    if args.out is not None:
        check_writable(args.out, BEGINS)
    check_named(args.detector, args.config, args.set)
    warnings: list[str] = []
    if args.recording is not None:
        data, recordings = str(args.recording), list(read_all([args.recording]))
        warnings = warn(args, recordings)
    else:
        data = f"{' '.join(folder.name for folder in args.data)}, {args.split}"
        recordings = read_split(args.data, args.split, exits.print_detail)
    kept = []
    for name in args.detector:
        with progress(f"streaming {name}", hidden=args.json) as bar:
            made = contender(name, recordings, data, args.label, args.config, args.set, bar)
        warn_of_untuned_rule(
            made.config, trial_layers("can", "simulated", name, args.config, args.set)
        )
        sheet = made.evaluation()
        known = {"detector_hash": made.config.detector_hash(), "warnings": warnings}
        value = msgspec.structs.asdict(sheet) | known
        show(args, value, scores_text(sheet, made.config.rule))
        if args.out is not None:
            kept.append(evaluated(made, sheet))
    if not args.json:
        print(legend(OF_SCORES | OF_IMPACTS))
    if args.out is not None:
        _keep(args, args.out, data, kept)
    return exits.SUCCESS


def warn(args: Json, recordings: Sequence[Recording]) -> list[str]:
    """Print, unless under --json, a warning for each suspicious property; returns the lines."""
    found = [line for recording in recordings for line in suspicions(recording)]
    for line in [] if args.json else found:
        exits.print_detail(f"warning: {line}")
    return found


def _keep(args: EvaluateOptions, out: Path, data: str, kept: list["DetectorScores"]) -> None:
    from scenarios.benchmark.score_file import ScoreFile, Source, write_scores
    from scenarios.trial.result import versions

    of = ["--data", *map(str, args.data)] if args.data else ["--recording", str(args.recording)]
    words = ["grasp", "detector", "evaluate", *args.detector, *of, "--label", args.label]
    words += ["--split", args.split] if args.data else []
    for option, values in (("--set", args.set), ("--config", args.config or ())):
        words += [word for value in values for word in (option, str(value))]
    command = shlex.join(words)
    source = Source(data, args.split if args.data else "", args.label)
    file = ScoreFile(source=source, command=command, versions=versions(), detectors=kept)
    write_scores(out, file)
    if not args.json:
        print(out)


def scores_text(sheet: "Evaluation", rule: RuleSettings) -> str:
    """The figures of an evaluation, with the decision rule."""
    figures = sheet.figures.items()
    shown: dict[str, object] = {name: f.value for name, f in figures}
    shown["confusion"] = sheet.confusion
    shown["intervals"] = {name: (f.low, f.high) for name, f in figures if f.low is not None}
    return f"{sheet.detector} on {sheet.data}; {in_words(rule)}\n{listing(shown)}"


def legend(keys: dict[str, str]) -> str:
    """The meaning of each key, one line each."""
    return "\n".join(["meaning of the keys:", *(f"  {key}: {text}" for key, text in keys.items())])


def detector_tune(args: TuneOptions) -> int:
    check_named([args.detector], args.config, args.set)
    return _tune_unlabelled(args) if args.unlabelled else _tune_labelled(args)


def _tune_labelled(args: TuneOptions) -> int:
    from scenarios.benchmark.scoring import (
        contender,
        evidence,
        minutes_at_rest,
        read_split,
        tune_rule,
    )

    name, budget = args.detector, args.budget
    recordings = read_split(args.data, "validation", exits.print_detail)
    rest = minutes_at_rest(recordings)
    check_testable(rest, budget, "more `validation` recordings or simulated data sets")
    with progress(f"streaming {name}", hidden=args.json) as bar:
        made = contender(name, recordings, "validation", "slip", args.config, args.set, bar)
    with progress(f"tuning {name}", hidden=args.json) as bar:
        chosen = tune_rule(made, budget, bar)
    if chosen is None:
        raise UsageError(f"no rule keeps {name} within {budget:g} false alarms a minute",
                         "allow more false alarms with --budget")  # fmt: skip
    known = evidence(made.streams, chosen.rule)
    point = {**msgspec.structs.asdict(chosen), "minutes": known.minutes, "slips": known.slips}
    rule = point.pop("rule")
    lines = ["on the split validation:", *listing(point).splitlines()]
    if known.slips < FEW_SLIPS or known.minutes * budget < FEW_EVENTS:
        lines.append("few data: one slip or false alarm more or less would change the rule; give "
                     "more recordings, or simulated data sets in addition")  # fmt: skip
    if known.caught < LOW_RECALL * known.slips:
        missed = 1.0 - known.caught / known.slips
        lines.append(f"this rule misses {missed:.0%} of the slips; allow more false alarms with "
                     "--budget, or use another detector")  # fmt: skip
    lines += legend(OF_TUNING | OF_IMPACTS).splitlines()
    return show(args, {**point, "rule": rule}, _rule_text(lines, rule))


def check_testable(minutes: float, budget: float, more: str) -> None:
    """Raise UsageError if the hand's time at rest is too short for one false alarm of the budget.
    ``more``: the remedy. A budget of 0 needs no test."""
    if minutes * budget < 1.0 and budget > 0.0:
        raise UsageError(f"a budget of {budget:g} false alarms a minute needs {60 / budget:.3g} s "
                         f"of a hand at rest ({180 / budget:.3g} s of one finger); there are "
                         f"{60 * minutes:.1f} s",
                         f"give {more}, or a greater --budget")  # fmt: skip


def _tune_unlabelled(args: TuneOptions) -> int:
    from scenarios.benchmark.label_free import read_hold, tune_without_labels

    config = load_config("can", "simulated", args.detector, args.config, args.set)
    found = tune_without_labels(config, map(read_hold, args.unlabelled), args.budget)
    known = {k: v for k, v in msgspec.structs.asdict(found).items() if k != "rule"}
    lines = ["on the holds; the level is the CUSUM limit, or the threshold's log-odds:",
             *listing(known).splitlines()]  # fmt: skip
    if found.rule == config.rule:
        lines.append("the configured threshold is higher and is kept: a hand at rest gives no "
                     "data on closing, lifting or taps")  # fmt: skip
    return show(args, found, _rule_text(lines, found.rule))


def _rule_text(comments: Sequence[str], rule: RuleSettings) -> str:
    return "\n".join([*(f"# {line}" for line in comments), *rule_lines(rule)])


def rule_lines(rule: RuleSettings) -> list[str]:
    """The settings that this kind of rule uses, as lines of TOML."""
    used = {k: v for k, v in msgspec.to_builtins(rule).items() if k not in rule.unused}
    rounded = {k: v if isinstance(v, str) else round(v, 4) for k, v in used.items()}
    return ["[rule]", *(f"{key} = {json.dumps(value)}" for key, value in rounded.items())]


def detector_card(args: CardOptions) -> int:
    name = args.network
    if name is None:
        return _list(args)
    found = msgspec.to_builtins(network_file.read_network(network_path(name)).card)
    text = listing(found)
    if (rule := _packaged_rule(name)) is not None:
        found["rule"] = rule
        text += f"\n{in_words(rule)}"
    text += f"\n{legend(OF_CARD)}"
    return show(args, found, text)


def _list(args: CardOptions) -> int:
    default = named_layer("profiles", DEFAULT_PROFILE).table["detector_name"]
    for name in names("detectors"):
        kind, rule = "formula" if name in FORMULAS else "network", _rule_of(name)
        value = {"name": name, "kind": kind, "default": name == default, "rule": rule}
        mark = " (default)" if name == default else ""
        show(args, value, f"{name}{mark}: {kind}; {in_words(rule)}")
    return exits.SUCCESS


def _packaged_rule(network: str) -> RuleSettings | None:
    """The default decision rule of a packaged network; None for a file."""
    return _rule_of(network) if network in names("detectors") else None


def _rule_of(network: str) -> RuleSettings:
    return msgspec.convert(named_layer("detectors", network).table.get("rule", {}), RuleSettings)


def network_path(word: str) -> Path:
    """Path of the weights of a packaged network or a file; raises UsageError for other words."""
    known = network_file.packaged_networks()
    if word not in known and (word in FORMULAS or is_plugin(word)):
        raise UsageError(f"detector {word!r} is no network, so it has no card",
                         f"`grasp detector evaluate {word} --data DIR` scores it")  # fmt: skip
    if not network_file.is_weights(word) and word not in known:
        raise UsageError(f"{word!r} is no packaged network{suggestion(word, known)}",
                         f"one of {', '.join(known)}, or a file that ends in .onnx")  # fmt: skip
    return network_file.weights_path(word)


def rule_of_weights(config: TrialConfig) -> str:
    """The decision rule of a user's detector, in words; empty for a packaged one."""
    if config.detector_name in DETECTORS and not config.network.weights:
        return ""
    return f"{config.detector_label}: {in_words(config.rule)}"


def check_weights(config: TrialConfig) -> None:
    """Raise BadFile or UsageError if a user's weights would be refused by a run."""
    if _own_weights(config):
        config.make_detector(FINGERS)


def check_named(words: Sequence[str], files: Files = None, assignments: Sequence[str] = ()) -> None:
    """Check settings and weights of each detector before data are read. Raises BadFile,
    ConfigError, UsageError."""
    for word in words:
        config = load_config("can", "simulated", word, files, assignments)
        if weights := _own_weights(config):
            network_file.read_network(network_file.weights_path(weights))


def warn_of_untuned_rule(config: TrialConfig, layers: Sequence[Layer]) -> None:
    """Warn if a user's weights are used with a rule that was tuned for others, or with defaults.
    ``layers``: the layers of the settings."""
    weights, name = _own_weights(config), config.detector_name
    if not weights:
        return
    path = network_file.weights_path(weights)
    if network_file.weights_digest(path) == network_file.PACKAGED_SHA256.get(name):
        return  # a copy
    levels = {source for key, source in sources_of(layers).items() if key in RULE_LEVELS}
    if any(not Path(source).is_relative_to(config_dir()) for source in levels):
        return  # a rule of the user's own
    whose = f"the rule of the packaged {name}, tuned for other weights"
    made = shlex.join((name, "--set", f"network.weights={weights}"))
    if name not in network_file.PACKAGED_SHA256:
        whose, made = "no rule that was tuned for it", shlex.quote(name)
    exits.report_line(f"{weights} is used with {whose}")
    exits.print_detail(f"`grasp detector tune {made} --data DIR` makes a rule for --config")


def _own_weights(config: TrialConfig) -> str:
    """Path of a user's weights; empty for a packaged network or another kind of detector."""
    if config.detector_section != NETWORK:
        return ""
    name = config.detector_name
    weights: str = config.network.weights or (name if network_file.is_weights(name) else "")
    return weights
