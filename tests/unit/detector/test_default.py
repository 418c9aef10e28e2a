"""The default detector as it is packaged: worse weights, or a worse rule, are noticed.

By what they do on as few recordings as a quick test makes weights of half a training cannot be told
from the packaged ones, so rule and weights are held to the value as well; on all recordings for
validation they are told (slow).
"""

import lzma
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings, log_odds
from detector.network_file import read_network, weights_digest, weights_path
from detector.recordings import Recording
from detector.scores.evaluation import stream_recordings
from detector.scores.sweep import SweepPoint, sweep
from detector.training.settings import DEFAULTS
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.campaign.config import load_config

pytestmark = pytest.mark.timeout(600)  # recordings are made: minutes beside other work
SEED = 77  # of no data set
KINDS = {"grasped_blow": 12, "grasped_slip": 8}
ONE_EVENT_PER_MIN = 0.3868  # of a hand's rest in these
DEFAULT = load_config("can", "simulated")
# What is packaged. Who changes one of them on purpose: tune the rule (`grasp detector tune`), show
# by the rule of docs/default-detector.md ("Which one is the default, and why") that new ones are no
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
# `grasp detector train tcn --minutes 0.35` on 63 recordings of blows: 780 steps of 12,000
CUT_SHORT = Path(__file__).with_name("cut_short.onnx.xz")
# of seed 0 the best of the first 6,000 steps of 12,000, calibrated
HALF_TRAINED = Path(__file__).with_name("half_trained.onnx.xz")
LEARNT = ("paper", "confusers", "grasped-slip", "mallet")
LIKELIHOOD = 0.068  # of five whole trainings .0636 to .0660


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


def point(recordings: list[Recording], *assignments: str) -> SweepPoint:
    config = load_config("can", "simulated", DEFAULT.detector_name, None, assignments)
    (found,) = sweep(stream_recordings(config.make_detector, recordings), [config.rule])
    return found


def too_bad(p: SweepPoint) -> list[str]:
    """What of it is worse than the packaged weights and rule have it, with some room."""
    assert p.blows is not None
    bounds = {
        "mean delay": p.mean_delay_ms < 200.0,  # 190: misses count 500
        "idle blows": p.blows.unmoved_registered == 0,  # none of 17
        "false events": p.false_per_min < 0.5 * ONE_EVENT_PER_MIN,  # none
    }
    return [name for name, kept in bounds.items() if not kept]


def test_the_default_is_the_tcn() -> None:
    assert DEFAULT.detector_name == "tcn"


@pytest.mark.parametrize("name", RULES)
def test_the_packaged_rule_is_the_one_that_the_figures_were_made_with(name: str) -> None:
    assert load_config("can", "simulated", name).rule == RULES[name], "see above RULES"


@pytest.mark.parametrize("name", WEIGHTS)
def test_the_packaged_weights_are_those_that_the_figures_were_made_with(name: str) -> None:
    assert weights_digest(weights_path(name)) == WEIGHTS[name], "see above RULES"


def test_the_default_was_trained_to_its_end() -> None:
    """Those of half the steps may do as well in what is asked of them below."""
    card = read_network(weights_path(DEFAULT.detector_name)).card
    assert card.steps == DEFAULTS[DEFAULT.detector_name].steps


def test_the_default_registers_what_moves_and_hardly_what_does_not(
    recordings: list[Recording],
) -> None:
    assert too_bad(point(recordings)) == []


@pytest.mark.parametrize(("threshold", "false_events"), [(0.5, 3), (0.6, 1)])
def test_a_lower_threshold_is_noticed(
    recordings: list[Recording], threshold: float, false_events: int
) -> None:
    """So many false events, and an idle blow too; what slips is heard sooner."""
    found = point(recordings, f"rule.threshold={threshold}")
    assert too_bad(found) == ["idle blows", "false events"]
    assert found.false_per_min == pytest.approx(false_events * ONE_EVENT_PER_MIN, rel=1e-3)


def test_a_shorter_release_is_noticed(recordings: list[Recording]) -> None:
    assert too_bad(point(recordings, "rule.release=1")) == ["false events"]


def test_weights_of_a_training_that_was_cut_short_are_noticed(
    recordings: list[Recording], tmp_path: Path
) -> None:
    """At a fifteenth of the steps nine in ten of what moves are missed: 485 ms. At half of them no
    bound tells them here: 152 ms and AUC .9875 of seed 0, where it has 190 and .9873 at the end."""
    path = unpacked(CUT_SHORT, tmp_path)
    assert read_network(path).card.steps < DEFAULTS[DEFAULT.detector_name].steps
    assert "mean delay" in too_bad(point(recordings, f"network.weights={path}"))


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_weights_of_half_a_training_are_noticed_by_what_they_do(tmp_path: Path) -> None:
    """On the 582 recordings of the split `validation` that weights and rule were chosen on."""
    configs = [load_dataset_config(config_dir() / "datasets" / f"{name}.toml") for name in LEARNT]
    jobs = [job for config in configs for job in plan(config) if job.metadata.split == "validation"]
    recordings = [make(job) for job in jobs]
    assert len(recordings) == 582
    half = unpacked(HALF_TRAINED, tmp_path)
    assert loss(recordings) < LIKELIHOOD < loss(recordings, f"network.weights={half}")  # .0702


def loss(recordings: list[Recording], *assignments: str) -> float:
    """Mean negative log-likelihood of the labels, by the mean of a hand's log-odds."""
    config = load_config("can", "simulated", DEFAULT.detector_name, None, assignments)
    told = stream_recordings(config.make_detector, recordings)
    odds = np.concatenate([log_odds(s.probabilities).mean(axis=1) for s in told])
    slips = np.concatenate([s.labels for s in told])
    return float(np.logaddexp(0.0, np.where(slips, -odds, odds)).mean())


def unpacked(weights: Path, folder: Path) -> Path:
    path = folder / weights.stem
    path.write_bytes(lzma.decompress(weights.read_bytes()))
    return path
