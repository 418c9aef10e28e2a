"""`grasp detector card`: what a network's weights say of themselves, and the rule it comes with;
without a name, all detectors there are."""

import argparse
import json
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import network_path
from grasp.cli.output import json_line
from grasp.cli.parser import verb


def add_parser(actions: Any) -> None:
    parser = verb(actions, "card", card, "show the card of a network: data, seed, commit, "
        "calibration")  # fmt: skip
    parser.option("network NAME|FILE.onnx", "packaged name, or a file; without it: list all "
        "detectors, the default and the rule of each", nargs="?")  # fmt: skip
    parser.flag("--json", "one JSON object per detector")


def card(args: argparse.Namespace) -> int:
    import msgspec

    if args.network is None:
        return _list(args)
    _check_no_formula(args.network)
    from detector.auxiliary_outputs import read_outputs
    from detector.network_file import read_network, weights_digest
    from scenarios.report.run_decision import in_words

    weights = network_path(args.network)
    loaded = read_network(weights)
    found = msgspec.to_builtins(loaded.card)
    found["samples"], counted = _samples(loaded.card)
    counted["threshold"] = " (above it a sample reads as slip in scores; a rule makes events)"
    rule = _rule(args.network)
    if rule is not None:
        found["rule"] = msgspec.to_builtins(rule)
    outputs = read_outputs(weights, weights_digest(weights), loaded)
    if outputs is not None:
        told = msgspec.to_builtins(outputs.file)
        found["heads"] = {key: value for key, value in told.items() if key != "layers"}
    if args.json:
        print(json_line(found))
    else:
        for key, value in found.items():
            shown = in_words(rule) if key == "rule" else json.dumps(value)
            print(f"{key}: {shown}{counted.get(key, '')}")
    return exits.SUCCESS


def _list(args: argparse.Namespace) -> int:
    """The packaged detectors, a line each."""
    import msgspec

    from detector.interface import FORMULAS
    from grasp.settings import named_layer, names
    from scenarios.report.run_decision import in_words
    from scenarios.trial.config import DEFAULT_PROFILE

    default = named_layer("profiles", DEFAULT_PROFILE).table["detector_name"]
    for name in names("detectors"):
        kind, rule = "formula" if name in FORMULAS else "network", _rule(name)
        if args.json:
            told = {"name": name, "kind": kind, "default": name == default}
            print(json_line({**told, "rule": msgspec.to_builtins(rule)}))
        else:
            mark = " (default)" if name == default else ""
            print(f"{name}{mark}: {kind}; {in_words(rule)}")
    return exits.SUCCESS


def _check_no_formula(word: str) -> None:
    """Raises UsageError for a detector without weights, with where its settings are."""
    from detector.interface import FORMULAS

    if word in FORMULAS:
        raise UsageError(
            f"{word} is a formula: it has no weights, and so no card",
            f"`grasp config {FORMULAS[word].section} --detector {word}` has its settings, "
            "`grasp detector card` every detector",
        )


def _samples(card: Any) -> tuple[int | None, dict[str, str]]:
    """How many samples an output depends on at most, the newest among them; None: on all, in a
    state that fades. And what the card counts, by key."""
    if card.mode == "window":
        return card.window, {"window": " samples, the newest among them"}
    if not card.window:
        return None, {"window": " (it has a state)", "samples": " (all, in a state that fades)"}
    told = " samples before the newest"
    return card.window + 1, {"window": told, "samples": " that an output depends on at most"}


def _rule(network: str) -> Any:
    """By which a packaged network is heard unless somebody says otherwise; None for a file, of
    which it depends on how it is asked for."""
    import msgspec

    from detector.decision import RuleSettings
    from grasp.settings import named_layer, names

    if network not in names("detectors"):
        return None
    return msgspec.convert(named_layer("detectors", network).table.get("rule", {}), RuleSettings)
