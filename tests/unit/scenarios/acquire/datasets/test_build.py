"""Building of data sets: the paper's distribution, and continued builds."""

from collections import Counter
from pathlib import Path

import pytest

from grasp.settings import config_dir
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import (
    STROKES,
    DatasetConfig,
    Job,
    load_dataset_config,
    plan,
    reduced,
)
from scenarios.rigs.workers import Workers

PAPER = config_dir() / "datasets" / "paper.toml"
SURFACES = ("planar", "sphere", "cylinder-y", "cylinder-x")
# Grover et al. 2022, Table I: percent of the samples, surfaces as above; speeds in m/s or rad/s.
PAPER_TABLE = {
    ("primary", 0.05): (5.3, 3.7, 3.5, 3.6),
    ("primary", 0.075): (4.5, 4.7, 3.7, 3.7),
    ("primary", 0.1): (4.8, 4.7, 3.3, 3.2),
    ("oblique", 0.05): (4.9, 3.3, 3.3, 3.3),
    ("oblique", 0.075): (3.5, 4.2, 3.5, 3.4),
    ("oblique", 0.1): (3.9, 4.2, 3.0, 3.1),
    ("rotation", 1.0): (3.8, 1.2, 1.5, 1.2),
}
HERE = Workers(0)


def quiet(done: int, total: int) -> None:
    pass


@pytest.fixture(scope="module")
def paper() -> DatasetConfig:
    return load_dataset_config(PAPER)


@pytest.fixture(scope="module")
def jobs(paper: DatasetConfig) -> list[Job]:
    return plan(paper)


@pytest.fixture(scope="module")
def few(paper: DatasetConfig) -> list[Job]:
    """Three small recordings of different motions and surfaces."""
    small = plan(reduced(paper, 0.01))
    return [small[0], small[40], small[-1]]


def test_paper_data_set_has_the_distribution_of_table_1(jobs: list[Job]) -> None:
    samples: Counter[tuple[str, float, str]] = Counter()
    for job in jobs:
        speed = job.motion.speed_mps or job.motion.spin_radps
        samples[job.motion.kind, speed, job.surface] += job.samples
    total = sum(samples.values())
    table_sum = sum(sum(row) for row in PAPER_TABLE.values())  # 100.0 by rounding, or nearly
    for (motion, speed), row in PAPER_TABLE.items():
        for surface, percent in zip(SURFACES, row, strict=True):
            ours = 100.0 * samples[motion, speed, surface] / total
            assert ours == pytest.approx(percent * 100.0 / table_sum, abs=0.01)


def test_every_direction_and_every_split_is_in_every_group(jobs: list[Job]) -> None:
    groups: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        groups.setdefault((job.surface, job.path.rsplit("-", 2)[0]), []).append(job)
    assert len(groups) == 28
    for group in groups.values():
        splits = Counter(job.metadata.split for job in group)
        assert splits["validation"] == splits["test"] == max(1, round(0.1 * len(group)))
        assert splits["train"] >= 8
        directions = {job.motion.direction for job in group}
        assert directions == set(STROKES[group[0].motion.kind])


def test_paths_and_seeds_are_unique_and_the_plan_is_the_same_twice(
    paper: DatasetConfig, jobs: list[Job]
) -> None:
    assert len({job.path for job in jobs}) == len({job.metadata.seed for job in jobs}) == len(jobs)
    assert plan(paper) == jobs


def test_continued_build_makes_equal_missing_recordings(tmp_path: Path, few: list[Job]) -> None:
    build(few, {}, tmp_path / "set", HERE, quiet)
    path = tmp_path / "set" / few[1].path
    before = path.read_bytes()
    path.unlink()
    assert build(few, {}, tmp_path / "set", HERE, quiet) == 1
    assert path.read_bytes() == before
