"""Confusers: the fingertip is shaken, and only true motion of the contact is labelled."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from detector.scores.quantiles import quantile
from grasp.settings import config_dir
from scenarios.acquire.datasets import build as datasets
from scenarios.acquire.datasets.build import Job, make, plan
from scenarios.acquire.datasets.confusers import as_felt

CONFUSERS = config_dir() / "datasets" / "confusers.toml"
FIXED = ("contact_made_and_broken", "force_steps", "tap", "arm_vibration", "temperature_drift")


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return plan(datasets.load_dataset_config(CONFUSERS))


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
    assert (r.slip == r.slip_true).all()
    assert r.slip.mean() < 0.03  # a shaken pad may slide for moments, and is labelled so
    assert r.metadata is not None
    assert (r.metadata.set, r.metadata.cause) == ("confusers", cause)


def test_a_tap_and_a_shaken_arm_are_heard(jobs: list[Job]) -> None:
    still = {"fingertip.wander_mm": 0.01, "control.force_n": 5.0}
    shaken = {"fingertip.vibration_mm": 0.025, "fingertip.sway_mm": 0.04}
    steady = quantile(np.sort(changes(first(jobs, "steady", **still))), 0.99)
    assert changes(first(jobs, "tap", **still)).max() > 3 * steady
    heard = changes(first(jobs, "arm_vibration", **still, **shaken))
    assert quantile(np.sort(heard), 0.99) > 3 * steady


def test_contact_is_made_and_broken_again_and_again(jobs: list[Job]) -> None:
    load = -first(jobs, "contact_made_and_broken").counts[:, 0].sum(axis=1)
    pressed = load > 0.3 * load.max()
    assert np.diff(pressed.astype(int)).clip(0).sum() >= 2
    assert (load < 0.05 * load.max()).mean() > 0.05  # off the surface, again and again


def test_drift_shifts_the_taxels_although_force_control_holds_their_sum(jobs: list[Job]) -> None:
    """1.6 counts a kelvin on every taxel; the sum is what the arm presses by."""
    warm, cold = (
        first(jobs, "temperature_drift", **{"fingertip.warming_k": kelvin}).counts[-50:, 0]
        for kelvin in (15.0, -15.0)
    )
    shift = warm.mean(axis=0) - cold.mean(axis=0)
    assert abs(shift).max() > 5
    assert abs(shift.sum()) < 0.5 * abs(shift).sum()


def test_lost_samples_are_repeated_while_the_contact_slides(jobs: list[Job]) -> None:
    r = first(jobs, "lost_samples", **{"sampling.lost_share": 0.2})
    repeated = (np.diff(r.counts, axis=0) == 0).all(axis=(1, 2)).mean()
    assert repeated > 0.15
    assert 0.1 < r.slip.mean() < 0.7


@pytest.mark.parametrize("cause", ["grasped_closing_and_tightening", "grasped_tap"])
def test_a_grasp_is_recorded_with_three_fingers_and_holds(jobs: list[Job], cause: str) -> None:
    r = first(jobs, cause)
    assert r.fingers == 3
    assert r.slip.mean() < 0.05
    assert np.abs(r.counts).max() > 30
    assert (r.counts.astype(int).sum(axis=2) < -30).all(axis=1).any()  # all three pressed


def test_blows_on_a_firm_grip_are_heard_and_only_hard_ones_slide_the_object(
    jobs: list[Job],
) -> None:
    blows = [job for job in jobs if job.metadata.cause == "grasped_blow"]
    made = [make(job) for job in blows[:4]]
    assert any(r.slip.any() for r in made)
    for r in made:
        loud = changes(r) > 10
        near_slip = np.convolve(r.slip[1:], np.ones(61), "same") > 0
        assert (loud & ~near_slip).any()
        assert r.slip.mean() < 0.1


def test_a_short_slip_is_labelled_until_it_can_be_felt_and_a_tiny_one_not_at_all() -> None:
    step_m = np.zeros(40)
    step_m[5:7] = 0.003  # a blow
    step_m[20:22] = (0.002, -0.0018)  # the pads give, and swing back
    step_m[25:39] = 0.001  # a slide
    places_m = np.stack([np.cumsum(step_m), np.zeros(40)], axis=1)
    label = as_felt(step_m != 0.0, places_m)
    assert np.flatnonzero(np.diff(label, prepend=False)).tolist() == [5, 13, 25, 39]


def test_an_uneven_grasp_loads_its_fingers_differently(jobs: list[Job]) -> None:
    uneven = first(jobs, "grasped_uneven_load", **{"variation.finger_scatter_m": 0.0008})
    loads = -uneven.counts.astype(int).sum(axis=2)
    held = loads[loads.max(axis=1) > 0.5 * loads.max()].mean(axis=0)
    assert held.max() > 2 * held.min()


def test_every_cause_has_all_splits(jobs: list[Job]) -> None:
    for cause in {job.metadata.cause for job in jobs}:
        splits = [job.metadata.split for job in jobs if job.metadata.cause == cause]
        assert splits.count("validation") == splits.count("test") == len(splits) // 4


def test_seeds_of_the_two_sets_are_apart(jobs: list[Job]) -> None:
    paper = plan(datasets.load_dataset_config(config_dir() / "datasets" / "paper.toml"))
    assert not {j.metadata.seed for j in paper} & {j.metadata.seed for j in jobs}


def test_what_is_too_heavy_slips_in_the_hand_and_nobody_reacts() -> None:
    path = config_dir() / "datasets" / "grasped-slip.toml"
    slips = plan(datasets.load_dataset_config(path))
    r = first(slips, "grasped_slip", **{"object.added_mass_kg": 0.4})
    assert r.fingers == 3
    assert r.slip[:100].sum() == 0  # it begins with a grasp that holds
    assert r.slip.sum() > 50
    assert changes(r)[r.slip[1:]].mean() > 3 * changes(r)[~r.slip[1:]].mean()


def test_seeds_of_slips_in_the_hand_are_apart_from_those_of_the_confusers(jobs: list[Job]) -> None:
    path = config_dir() / "datasets" / "grasped-slip.toml"
    slips = plan(datasets.load_dataset_config(path))
    assert not {j.metadata.seed for j in slips} & {j.metadata.seed for j in jobs}
