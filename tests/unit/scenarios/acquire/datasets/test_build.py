"""Data sets: the plan of the paper's, equal builds, and builds that were ended go on."""

import errno
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from grasp.cli.main import main
from grasp.settings import config_dir
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.datasets import build as datasets
from scenarios.acquire.datasets.build import build, window
from scenarios.acquire.datasets.draws import with_values
from scenarios.acquire.datasets.plan import (
    DIRECTIONS,
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
PAPER_STATIC, PAPER_SLIP = 143_584, 122_918
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


def test_the_papers_set_has_the_papers_samples(jobs: list[Job]) -> None:
    assert sum(job.slip for job in jobs) == PAPER_SLIP
    assert sum(job.static for job in jobs) == PAPER_STATIC


def test_the_papers_set_is_distributed_as_table_1_says(jobs: list[Job]) -> None:
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
        assert directions == set(DIRECTIONS[group[0].motion.kind])


def test_paths_and_seeds_are_unique_and_the_plan_is_the_same_twice(
    paper: DatasetConfig, jobs: list[Job]
) -> None:
    assert len({job.path for job in jobs}) == len({job.metadata.seed for job in jobs}) == len(jobs)
    assert plan(paper) == jobs


def test_a_parameter_that_does_not_exist_is_refused(few: list[Job]) -> None:
    config = load_acquire_config("planar", "simulated")
    with pytest.raises(ConfigError, match="no such setting"):
        with_values(config, {"fingertip.depht_mm": 4.0})
    with pytest.raises(ConfigError, match="depth_mm"):
        with_values(config, {"fingertip.depth_mm": 400.0})


def test_the_window_holds_exactly_so_many_samples_of_slip() -> None:
    slip = np.array([0, 0, 0, 1, 1, 0, 1, 1, 1, 0], bool)
    assert window(slip, 4, 2) == 1
    assert window(slip, 3, 3) == 6
    assert window(slip, 4, 4) is None


def test_a_second_build_makes_only_what_is_missing_and_makes_it_equal(
    tmp_path: Path, few: list[Job]
) -> None:
    build(few, {}, tmp_path / "set", HERE, quiet)
    path = tmp_path / "set" / few[1].path
    before = path.read_bytes()
    path.unlink()
    assert build(few, {}, tmp_path / "set", HERE, quiet) == 1
    assert path.read_bytes() == before


def test_a_full_disk_leaves_nothing_half_written_and_the_build_goes_on(
    tmp_path: Path, few: list[Job], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "set"

    def half(file: object, **_: object) -> None:
        file.write(b"half")  # type: ignore[attr-defined]
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez_compressed", half)
        with pytest.raises(OSError, match="No space"):
            build(few[:1], {}, out, HERE, quiet)
    assert [path.name for path in out.rglob("*") if path.is_file()] == [datasets.INDEX]

    assert build(few[:1], {}, out, HERE, quiet) == 1


@pytest.mark.parametrize(
    ("says", "named"),
    [
        ('[[rows]]\nmotion = "primary"\nspeed = 0.1\npercent = {"../../x" = 100}', "../../x"),
        ('[[rows]]\nmotion = "primary"\nspeed = 0.1\npercent = {moon = 100}', "moon"),
        ('[[rows]]\nmotion = "primary"\nspeed = 0.1\npercent = {planar = 0}', "nothing to record"),
        ('[[causes]]\ncause = "tap"\non = ["a/b"]\nshare = 1\nseconds = 1', "a/b"),
        ('[[causes]]\ncause = "tap"\non = ["can"]\nshare = 1\nseconds = 1', "can"),
        ('[[causes]]\ncause = "grasped_tap"\non = ["can"]\nshare = 1\nseconds = 1\nload = [0.1, 1]',
         "straight"),
        ("", "nothing to record"),
    ],
)  # fmt: skip
def test_a_set_of_what_is_unknown_is_refused_before_a_folder_is_made(
    says: str, named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "set.toml", tmp_path / "out"
    file.write_text(f'name = "x"\nseed = 1\nslip_samples = 500\n{says}\n')
    assert main(["dataset", "build", str(file), "--out", str(out)]) == 2
    err = capsys.readouterr().err
    assert named in err and err.count("\n") == 1
    assert not out.exists()
