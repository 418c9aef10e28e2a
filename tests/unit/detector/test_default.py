"""Exact rule and weights of the packaged default detector.

tests/nightly/test_default_detector.py tests its performance on recordings.
"""

from detector.decision import RuleSettings
from detector.network_file import read_network, weights_digest, weights_path
from detector.training.settings import DEFAULTS
from scenarios.campaign.config import load_config

DEFAULT = load_config("can", "simulated")
# To change one of these: choose weights and rule on `grasp benchmark --split validation`, run
# `make results`, and write them here.
RULES = {
    "tcn": RuleSettings(
        kind="either",
        fusion="mean",
        consecutive=2,
        threshold=0.7,
        drift=-0.85,
        limit=20.0,
        quiet=0.3,
        release=5,
    ),
    "gru": RuleSettings(
        kind="consecutive", fusion="mean", consecutive=2, threshold=0.65, quiet=0.15, release=5
    ),
}
WEIGHTS = {  # SHA-256 of the file
    "tcn": "78ecb627121e6e9d477c59141c2cfd1fe1bc723857ed8f4fc03fa95947d9fff9",
    "gru": "38e0aecb17722ef3e1f66d1a7c297a8383826038a4159bb9e59aa78e3b8e0bdc",
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
