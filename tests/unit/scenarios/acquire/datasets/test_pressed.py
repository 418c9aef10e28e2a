"""Pressed confusers: the fingertip is shaken, and only true motion of the contact is labelled."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from detector.scores.quantiles import quantile
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan

CONFUSERS = config_dir() / "datasets" / "confusers.toml"
FIXED = ("contact_made_and_broken", "force_steps", "tap", "arm_vibration", "temperature_drift")


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return plan(load_dataset_config(CONFUSERS))


def first(jobs: list[Job], cause: str, **parameters: float) -> Recording:
    job = next(job for job in jobs if job.metadata.cause == cause)
    drawn = {**job.metadata.parameters, **parameters}
    metadata = msgspec.structs.replace(job.metadata, parameters=drawn)
    return make(msgspec.structs.replace(job, metadata=metadata))


def changes(r: Recording) -> np.ndarray:
    """(n - 1,) mean absolute change of the liveliest fingertip's taxels."""
    return np.abs(np.diff(r.counts.astype(int), axis=0)).mean(axis=2).max(axis=1)


@pytest.mark.parametrize("cause", FIXED)
def test_nothing_slips_although_the_signal_moves(jobs: list[Job], cause: str) -> None:
    r = first(jobs, cause)
    assert r.slip_true is not None
    assert not r.slip.any()
    assert r.slip_true.mean() < 0.03  # a shaken pad may slide for moments, there and back
    assert r.metadata is not None
    assert (r.metadata.set, r.metadata.cause) == ("confusers", cause)


def test_strokes_under_lost_samples_slip_half_a_millimetre_and_more(jobs: list[Job]) -> None:
    r = first(jobs, "lost_samples")
    assert r.slip_true is not None and r.contact_speed_mps is not None
    assert not (r.slip & ~r.slip_true).any()
    edges = np.flatnonzero(np.diff(r.slip, prepend=False, append=False)).reshape(-1, 2)
    ways = [r.contact_speed_mps[a:b].sum() * 0.01 for a, b in edges]
    assert len(ways) >= 3
    assert min(ways) > 0.0004


def test_a_tap_and_a_shaken_arm_are_heard(jobs: list[Job]) -> None:
    still = {"fingertip.wander_mm": 0.01, "control.force_n": 5.0}
    shaken = {"fingertip.vibration_mm": 0.025, "fingertip.sway_mm": 0.04}
    steady = quantile(np.sort(changes(first(jobs, "steady", **still))), 0.99)
    assert changes(first(jobs, "tap", **still)).max() > 3 * steady
    heard = changes(first(jobs, "arm_vibration", **still, **shaken))
    assert quantile(np.sort(heard), 0.99) > 3 * steady
