"""Recordings of grasped objects with disturbances: labels, displacements, reproducibility."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording, write
from grasp.settings import config_dir
from scenarios.acquire.datasets.build import make
from scenarios.acquire.datasets.causes import detectable_slip
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan

SETS = config_dir() / "datasets"


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return plan(load_dataset_config(SETS / "disturbances.toml"))


@pytest.fixture(scope="module")
def slips() -> list[Job]:
    return plan(load_dataset_config(SETS / "grasped-slip.toml"))


_made: dict[str, Recording] = {}


def of(jobs: list[Job], cause: str, number: int = 1, **parameters: float) -> list[Recording]:
    """The first recordings of a cause, with some parameters replaced; cached."""
    made = []
    for job in [job for job in jobs if job.metadata.cause == cause][:number]:
        key = f"{job.metadata.set} {job.path} {parameters}"
        if key not in _made:
            values = {**job.metadata.parameters, **parameters}
            metadata = msgspec.structs.replace(job.metadata, parameters=values)
            _made[key] = make(msgspec.structs.replace(job, metadata=metadata))
        made.append(_made[key])
    return made


@pytest.mark.parametrize("cause", ["grasped_lift_acceleration", "grasped_set_down"])
def test_open_hand_that_leaves_the_object_has_no_slip(jobs: list[Job], cause: str) -> None:
    """A contact that remains by rounding does not count: the arm retreats at 50 mm/s."""
    for r in of(jobs, cause):
        pressed = (r.counts.astype(int).sum(axis=2) < -30).any(axis=1)
        last = int(np.flatnonzero(pressed)[-1])
        assert len(r.slip) - last > 30
        assert r.slip_true is not None and r.moved_m is not None
        assert not r.slip[last + 9 :].any()  # a slip label lasts 80 ms at least
        assert not r.slip_true[last + 2 :].any()
        assert r.moved_m[last + 2 :].max() == 0.0


def test_mallet_impacts_slide_the_object_by_the_recorded_distance(
    slips: list[Job],
) -> None:
    (r,) = of(slips, "grasped_impact")
    assert r.metadata is not None and r.moved_m is not None
    hard = [a for a in r.metadata.disturbances if a.kind == "mallet" and 0.003 < a.moved_m < 0.03]
    assert hard
    for impact in hard:
        after = (r.t_s > impact.t_s) & (r.t_s < impact.t_s + 0.15)
        assert r.slip[after].any()
        assert r.moved_m[after].max() == pytest.approx(impact.furthest_m, rel=1e-3)


@pytest.mark.parametrize("cause", ["grasped_impact", "grasped_slip"])
def test_recording_is_reproducible(slips: list[Job], cause: str, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write(tmp_path / name, of(slips, cause)[0])
        _made.clear()
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_short_slip_has_an_extended_label_and_elastic_motion_has_none() -> None:
    step_m = np.zeros(40)
    step_m[5:7] = 0.003  # an impact
    step_m[20:22] = (0.002, -0.0018)  # elastic motion of the pads
    step_m[25:39] = 0.001  # a slide
    places_m = np.stack([np.cumsum(step_m), np.zeros(40)], axis=1)
    label = detectable_slip(step_m != 0.0, places_m)
    assert np.flatnonzero(np.diff(label, prepend=False)).tolist() == [5, 13, 25, 39]
