"""Pressed disturbances: only true motion of the contact is labelled as slip."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan

DISTURBANCES = config_dir() / "datasets" / "disturbances.toml"
FIXED = ("contact_made_and_broken", "force_steps", "tap", "arm_vibration", "temperature_drift")


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return plan(load_dataset_config(DISTURBANCES))


def first(jobs: list[Job], cause: str, **parameters: float) -> Recording:
    job = next(job for job in jobs if job.metadata.cause == cause)
    values = {**job.metadata.parameters, **parameters}
    metadata = msgspec.structs.replace(job.metadata, parameters=values)
    return make(msgspec.structs.replace(job, metadata=metadata))


@pytest.mark.parametrize("cause", FIXED)
def test_nothing_slips_although_the_signal_moves(jobs: list[Job], cause: str) -> None:
    r = first(jobs, cause)
    assert r.slip_true is not None
    assert not r.slip.any()
    assert r.slip_true.mean() < 0.03  # a vibrating pad may slide for moments
    assert r.metadata is not None
    assert (r.metadata.set, r.metadata.cause) == ("disturbances", cause)


def test_strokes_under_lost_samples_slip_half_a_millimetre_and_more(jobs: list[Job]) -> None:
    r = first(jobs, "lost_samples")
    assert r.slip_true is not None and r.contact_speed_mps is not None
    assert not (r.slip & ~r.slip_true).any()
    edges = np.flatnonzero(np.diff(r.slip, prepend=False, append=False)).reshape(-1, 2)
    distances = [r.contact_speed_mps[a:b].sum() * 0.01 for a, b in edges]
    assert len(distances) >= 3
    assert min(distances) > 0.0004
