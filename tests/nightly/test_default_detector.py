"""The packaged default detector on taps and lifts that played no part in its training."""

import msgspec
import pytest

from detector.recordings import Recording
from detector.scores.evaluation import stream_recordings
from detector.scores.sweep import sweep
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.campaign.config import load_config

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]  # 20 recordings are made
SEED = 77  # of no data set
KINDS = {"grasped_impact": 12, "grasped_slip": 8}
ONE_EVENT_PER_MIN = 0.3868  # of a hand's rest in these
DEFAULT = load_config("can", "simulated")


def recordings() -> list[Recording]:
    """Taps on a firm grip and lifts of objects that are too heavy, on new objects."""
    config = load_dataset_config(config_dir() / "datasets" / "grasped-slip.toml")
    rows = [row for row in config.causes if row.cause in KINDS]
    plans = (
        plan(msgspec.structs.replace(config, seed=SEED, causes=[row], recordings=KINDS[row.cause]))
        for row in rows
    )
    return [make(job) for jobs in plans for job in jobs]


def test_the_default_registers_what_moves_and_hardly_what_does_not() -> None:
    (found,) = sweep(stream_recordings(DEFAULT.make_detector, recordings()), [DEFAULT.rule])
    assert found.impacts is not None
    assert found.mean_delay_ms < 200.0  # 190: misses count 500
    assert found.impacts.unmoved_registered == 0  # none of 17
    assert found.false_per_min < 0.5 * ONE_EVENT_PER_MIN  # none
