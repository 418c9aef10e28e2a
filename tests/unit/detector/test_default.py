"""The default detector as it is packaged: worse weights, or a worse rule, are noticed."""

import msgspec
import pytest

from detector.decision import RuleSettings
from detector.network_file import read_network, weights_path
from detector.recordings import Recording
from detector.scores.evaluation import stream_recordings
from detector.scores.sweep import SweepPoint, sweep
from detector.training.settings import DEFAULTS
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.campaign.config import load_config

SEED = 77  # of no data set
KINDS = {"grasped_blow": 12, "grasped_slip": 8}
DEFAULT = load_config("can", "simulated")


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    """Blows on a firm grip and lifts of what is too heavy, on objects that nobody has seen."""
    config = load_dataset_config(config_dir() / "datasets" / "grasped-slip.toml")
    rows = [row for row in config.causes if row.cause in KINDS]
    plans = (
        plan(msgspec.structs.replace(config, seed=SEED, causes=[row], recordings=KINDS[row.cause]))
        for row in rows
    )
    return [make(job) for jobs in plans for job in jobs]


def point(recordings: list[Recording], rule: RuleSettings) -> SweepPoint:
    (found,) = sweep(stream_recordings(DEFAULT.make_detector, recordings), [rule])
    return found


def test_the_default_is_the_tcn() -> None:
    assert DEFAULT.detector_name == "tcn"


def test_the_default_was_trained_to_its_end() -> None:
    """Those of half the steps may do as well in what is asked of them below."""
    card = read_network(weights_path(DEFAULT.detector_name)).card
    assert card.steps == DEFAULTS[DEFAULT.detector_name].steps


def test_the_default_registers_what_moves_and_hardly_what_does_not(
    recordings: list[Recording],
) -> None:
    """With the threshold at even odds three times the false events; the `tcn` before: 210 ms."""
    p = point(recordings, DEFAULT.rule)
    assert p.blows is not None
    assert p.mean_delay_ms < 175.0  # 165: misses count 500
    assert p.blows.unmoved_registered <= 1  # 1 of 22
    assert p.false_per_min < 0.6  # 0.38
