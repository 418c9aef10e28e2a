"""By which rule a network of one's own is heard, and whether that rule was made for it."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp.cli import exits

HEARD_FROM = ("rule.threshold", "rule.limit")  # of either kind of rule


def rule_of_weights(config: Any) -> str:
    """By which rule a detector of one's own is heard: there are three that it could be. Of a
    packaged one `grasp config rule` tells."""
    from detector.interface import DETECTORS
    from scenarios.report.run_decision import in_words

    if config.detector_name in DETECTORS and not config.network.weights:
        return ""
    return f"{config.detector_label}: {in_words(config.rule)}"


def check_weights(config: Any) -> None:
    """Of one's own: no rule is spoken of beside weights with which a run would be refused. Raises
    BadFile, UsageError."""
    from drivers.interfaces import FINGERS

    if _own_weights(config):
        config.make_detector(FINGERS)


def check_named(words: Sequence[str], files: Any = None, assignments: Sequence[str] = ()) -> None:
    """Of each detector asked for, name, settings and weights; before any data are read, which know
    of how many taxels they are. Raises BadFile, ConfigError, UsageError."""
    from detector.network_file import read_network, weights_path
    from scenarios.campaign.config import load_config

    for word in words:
        config = load_config("can", "simulated", word, files, assignments)
        if weights := _own_weights(config):
            read_network(weights_path(weights))


def tell_untuned(config: Any, layers: Any) -> None:
    """Warn where weights of one's own are heard by a rule of somebody else's: by that of a packaged
    network, or by none but the defaults. ``layers`` are those that the settings are from. Of a
    rule of one's own nobody knows for which weights it was tuned."""
    from detector.network_file import PACKAGED, weights_digest, weights_path

    weights, name = _own_weights(config), config.detector_name
    if not weights or weights_digest(weights_path(weights)) == PACKAGED.get(name):
        return  # a copy
    if _rule_is_own(layers):
        return
    whose = f"the rule of the packaged {name}, tuned for other weights"
    made = shlex.join((name, "--set", f"network.weights={weights}"))
    if name not in PACKAGED:
        whose, made = "no rule that was tuned for it", shlex.quote(name)
    exits.report_line(f"{weights} is heard by {whose}")
    exits.say(f"`grasp detector tune {made} --data DIR` makes one, for --config")


def _own_weights(config: Any) -> str:
    """The file of them; empty for a packaged network by its name, and for what is no network."""
    from detector.interface import NETWORK
    from detector.network_file import is_weights

    if config.detector_section != NETWORK:
        return ""
    name = config.detector_name
    weights: str = config.network.weights or (name if is_weights(name) else "")
    return weights


def _rule_is_own(layers: Any) -> bool:
    """Whether a file of one's own, or `--set`, says from where on the rule hears slip."""
    from grasp.settings import config_dir, sources_of

    said = {source for key, source in sources_of(layers).items() if key in HEARD_FROM}
    return any(not Path(source).is_relative_to(config_dir()) for source in said)
