"""What heads tell beside what is told without them, as tables; and what a true speed is worth."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from detector.scores.heads import Score
from grasp.settings import config_dir
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan
from scenarios.studies.detectors.kinds import HEADS, Row, scores_of, sizing_table, sizings, table

FIGURE = (0.35, 0.3, 0.4)
ROWS = [
    Row("hand", "energy", Score((1.84, 1.7, 1.9), None, None, None, None)),
    Row("hand", HEADS, Score((1.47, 1.4, 1.6), None, FIGURE, FIGURE, None)),
]


def test_a_row_each_and_a_dash_where_nothing_is_said() -> None:
    *_, energy, heads = table(ROWS).splitlines()
    assert energy == "| hand | energy | 1.84 [1.70, 1.90] | – | – | – | – |"
    assert heads.count("0.35 [0.30, 0.40]") == 2


def test_a_file_of_heads_has_their_scores_alone() -> None:
    found = scores_of(ROWS)
    assert set(found) == {"hand: speed_factor", "hand: direction", "hand: beside"}
    assert found["hand: direction"] == FIGURE


@pytest.fixture(scope="module")
def lifts() -> list[Job]:
    jobs = plan(load_dataset_config(config_dir() / "datasets" / "grasped-slip.toml"))
    return [job for job in jobs if job.metadata.cause == "grasped_slip"][:20]


def as_recorded(job: Job) -> Recording:
    """A lift in which the fingers leave the object behind as fast as the arm gets."""
    speed = np.minimum(0.01 * np.arange(50.0), 0.1)
    speed *= job.metadata.parameters["controller.lift_acceleration_mps2"]
    return Recording(
        np.arange(50) * 0.01, np.zeros((50, 3, 6), np.int16), np.arange(50) > 0, None, job.path,
        job.metadata, velocity_mps=np.stack([speed, 0.0 * speed], axis=1).astype(np.float32),
        spin_radps=np.zeros(50, np.float32),
    )  # fmt: skip


def test_speed_that_is_the_arms_says_nothing_of_missing_force(lifts: list[Job]) -> None:
    found = sizings([as_recorded(job) for job in lifts])
    assert [s.after_ms for s in found] == [50.0, 100.0, 150.0]
    for s in found:
        assert s.lifts == 20
        assert s.with_acceleration == pytest.approx(1.0)
        assert abs(s.with_load) < 0.6
    assert sizing_table(found).count("\n") == 4


def test_what_is_no_lift_or_ends_too_soon_sizes_nothing(lifts: list[Job]) -> None:
    made = as_recorded(lifts[0])
    assert made.metadata is not None
    blow = msgspec.structs.replace(
        made, metadata=msgspec.structs.replace(made.metadata, cause="grasped_blow")
    )
    short = msgspec.structs.replace(made, t_s=made.t_s[:4])
    assert sizings([blow, short, made]) == []
