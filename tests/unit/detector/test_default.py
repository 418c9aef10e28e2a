"""The default detector as it is packaged: rule and weights are held to the value.

What they do on recordings is told by tests/nightly/test_default_detector.py.
"""

from detector.decision import RuleSettings
from detector.network_file import read_network, weights_digest, weights_path
from detector.training.settings import DEFAULTS
from scenarios.campaign.config import load_config

DEFAULT = load_config("can", "simulated")
# What is packaged. Who changes one of them on purpose: tune the rule (`grasp detector tune`), show
# with `make results` that new ones are no
# worse, and write the new values here. A test that fails for any other reason has found a mistake.
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


def test_packaged_rules_and_weights_are_those_that_the_figures_were_made_with() -> None:
    for name, rule in RULES.items():
        assert load_config("can", "simulated", name).rule == rule, "see above RULES"
        assert weights_digest(weights_path(name)) == WEIGHTS[name], "see above RULES"


def test_the_default_was_trained_to_its_end() -> None:
    """Those of half the steps may do as well in what the nightly test asks of them."""
    card = read_network(weights_path(DEFAULT.detector_name)).card
    assert card.steps == DEFAULTS[DEFAULT.detector_name].steps
