"""Exact rule and weights of the packaged default detector.

tests/nightly/test_default_detector.py tests its performance on recordings.
"""

from detector.decision import RuleSettings
from detector.network_file import read_network, weights_digest, weights_path
from detector.training.settings import DEFAULTS
from scenarios.campaign.config import load_config

DEFAULT = load_config("can", "simulated")
# To change one of these: tune the rule (`grasp detector tune`), show with `make results` that the
# new values are not worse, and write them here.
RULES = {
    "tcn": RuleSettings(
        kind="consecutive", fusion="mean", consecutive=2, threshold=0.7471, release=8
    ),
    "gru": RuleSettings(
        kind="consecutive", fusion="mean", consecutive=2, threshold=0.7625, release=8
    ),
}
WEIGHTS = {  # SHA-256 of the file
    "tcn": "f5a262c4ccc4d21705dd59a20ae650aa160697c3b3adb7bf927ac90c78c56818",
    "gru": "28cca7646b5bcb489bf2acce6f80901c73ba41c50d5ae75471c457476cece696",
}


def test_the_default_is_the_tcn() -> None:
    assert DEFAULT.detector_name == "tcn"


def test_packaged_rules_and_weights_are_unchanged() -> None:
    for name, rule in RULES.items():
        assert load_config("can", "simulated", name).rule == rule, "see above RULES"
        assert weights_digest(weights_path(name)) == WEIGHTS[name], "see above RULES"


def test_default_was_trained_for_all_steps() -> None:
    """The nightly test would also pass with weights of half the steps."""
    card = read_network(weights_path(DEFAULT.detector_name)).card
    assert card.steps == DEFAULTS[DEFAULT.detector_name].steps
