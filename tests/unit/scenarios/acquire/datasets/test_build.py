"""Data sets: the plan of the paper's, equal builds, and builds that were ended go on."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import read, read_dataset
from drivers.errors import ConfigError, UsageError
from grasp.cli.main import main
from grasp.settings import config_dir
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.datasets import build as datasets
from scenarios.acquire.datasets.build import Progress, build, window
from scenarios.acquire.datasets.describe import (
    PAPER_SLIP,
    PAPER_STATIC,
    PAPER_TABLE,
    SURFACES,
    describe,
)
from scenarios.acquire.datasets.draws import with_values
from scenarios.acquire.datasets.plan import (
    DIRECTIONS,
    SEEDS,
    DatasetConfig,
    Job,
    apportion,
    load_dataset_config,
    plan,
    reduced,
)
from scenarios.rigs.workers import Workers

PAPER = config_dir() / "datasets" / "paper.toml"
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
    small = plan(reduced(paper, 0.02))
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


def test_parameters_are_drawn_within_their_ranges(paper: DatasetConfig, jobs: list[Job]) -> None:
    rigid, compliant = paper.parts
    of = {p.name: [j for j in jobs if j.metadata.part == p.name] for p in paper.parts}
    assert len(of["rigid"]) == pytest.approx(rigid.share * len(jobs), abs=2)
    assert len(of["compliant"]) == pytest.approx(compliant.share * len(jobs), abs=2)
    ranges = [(key, of["rigid"], *bounds) for key, bounds in paper.randomise.items()]
    ranges += [(key, of["compliant"], *bounds) for key, bounds in compliant.randomise.items()]
    for key, chosen, low, high in ranges:
        values = [job.metadata.parameters[key] for job in chosen]
        if low == high:
            assert set(values) == {low}
            continue
        assert low <= min(values) < max(values) <= high
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=0.15 * (high - low))


def test_ranges_of_one_surface_are_drawn_on_it_alone(paper: DatasetConfig, jobs: list[Job]) -> None:
    compliant = paper.parts[1]
    key = "fingertip.tilt_x_rad"
    assert set(compliant.on) == set(SURFACES)
    for job in jobs:
        if job.metadata.part == "rigid":
            assert key not in job.metadata.parameters
        else:
            low, high = compliant.on[job.surface][key]
            assert low <= job.metadata.parameters[key] <= high


def test_every_part_is_on_every_surface_and_in_every_split(jobs: list[Job]) -> None:
    for job_part in ("rigid", "compliant"):
        chosen = [job for job in jobs if job.metadata.part == job_part]
        assert {job.surface for job in chosen} == set(SURFACES)
        assert {job.metadata.split for job in chosen} == {"train", "validation", "test"}


def test_a_parameter_that_does_not_exist_is_refused(few: list[Job]) -> None:
    config = load_acquire_config("planar", "simulated")
    with pytest.raises(ConfigError, match="no such setting"):
        with_values(config, {"fingertip.depht_mm": 4.0})
    with pytest.raises(ConfigError, match="depth_mm"):
        with_values(config, {"fingertip.depth_mm": 400.0})


def test_parts_sum_to_the_total() -> None:
    assert apportion(10, np.array([1.0, 1.0, 1.0])) == [4, 3, 3]
    assert apportion(7, np.array([5.0, 0.0, 2.0])) == [5, 0, 2]


def test_the_window_holds_exactly_so_many_samples_of_slip() -> None:
    slip = np.array([0, 0, 0, 1, 1, 0, 1, 1, 1, 0], bool)
    assert window(slip, 4, 2) == 1
    assert window(slip, 3, 3) == 6
    assert window(slip, 4, 4) is None


@pytest.mark.parametrize("processes", [0, 2])
def test_a_build_makes_what_was_planned(tmp_path: Path, few: list[Job], processes: int) -> None:
    seen: list[tuple[int, int]] = []
    made = build(
        few, {}, tmp_path / "set", Workers(processes), lambda *counted: seen.append(counted)
    )
    assert made == 3
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    for job in few:
        r = read(tmp_path / "set" / job.path)
        assert r.metadata == job.metadata
        assert int(r.slip.sum()) == job.slip
        assert len(r.slip) == job.samples
        assert r.t_s[0] == 0.0
        assert r.slip_true is not None


@pytest.mark.parametrize("pause_share", [0.3, 4.0])
def test_the_labels_shares_come_out_whatever_the_first_pauses(
    few: list[Job], pause_share: float
) -> None:
    parameters = few[0].metadata.parameters | {"control.pause_share": pause_share}
    metadata = msgspec.structs.replace(few[0].metadata, parameters=parameters)
    job = msgspec.structs.replace(few[0], metadata=metadata, static=500, slip=400)
    r = datasets.make(job)
    assert (len(r.slip), int(r.slip.sum())) == (900, 400)


def test_any_number_of_processes_makes_equal_files(tmp_path: Path, few: list[Job]) -> None:
    sets = [plan(load_dataset_config(PAPER.with_name(name)))
            for name in ("confusers.toml", "grasped-slip.toml")]  # fmt: skip
    struck = next(job for job in sets[0] if job.metadata.cause == "grasped_tap")
    jobs = [few[0], struck, sets[0][0], sets[1][0]]
    for processes, name in ((0, "here"), (2, "there")):
        build(jobs, {}, tmp_path / name, Workers(processes), quiet)
    for job in jobs:
        here, there = (tmp_path / name / job.path for name in ("here", "there"))
        assert here.read_bytes() == there.read_bytes(), job.path


def test_a_second_build_makes_only_what_is_missing_and_makes_it_equal(
    tmp_path: Path, few: list[Job]
) -> None:
    build(few, {}, tmp_path / "set", HERE, quiet)
    path = tmp_path / "set" / few[1].path
    before = path.read_bytes()
    path.unlink()
    assert build(few, {}, tmp_path / "set", HERE, quiet) == 1
    assert path.read_bytes() == before


def test_a_folder_of_something_else_is_refused(tmp_path: Path, few: list[Job]) -> None:
    build(few[:1], {}, tmp_path / "set", HERE, quiet)
    with pytest.raises(UsageError, match=f"1 recordings where {len(few)} are asked") as refused:
        build(few, {}, tmp_path / "set", HERE, quiet, "--data")
    assert (
        "--share" in refused.value.remedy and "another folder with --data" in refused.value.remedy
    )
    with pytest.raises(UsageError, match="of other settings or of another version"):
        build(few[1:2], {}, tmp_path / "set", HERE, quiet)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").touch()
    with pytest.raises(UsageError, match="not empty"):
        build(few, {}, tmp_path / "other", HERE, quiet)


def test_a_build_that_was_killed_leaves_whole_files_only_and_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "set"
    command = [sys.executable, "-c", "from grasp.cli.main import main; raise SystemExit(main())",
               "dataset", "build", str(PAPER), "--share", "0.02", "--jobs", "2",
               "--out", str(out)]  # fmt: skip
    home = Path(datasets.__file__).parents[3]
    child = subprocess.Popen(command, cwd=home, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 100
    while len(list(out.glob("*/[!.]*.npz"))) < 3 and child.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    workers = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < deadline, "workers live on"
        time.sleep(0.05)
    left = {path: path.read_bytes() for path in out.glob("*/[!.]*.npz")}
    assert len(read_dataset(out)) == len(left) >= 3
    small = reduced(load_dataset_config(PAPER), 0.02)
    every = plan(small)
    nearly = [job for job in every if (out / job.path).exists()]
    index = json.loads((out / datasets.INDEX).read_text())
    assert index["recordings"] == len(every)
    again = tmp_path / "again"
    build(nearly[:2], {}, again, HERE, quiet)
    for job in nearly[:2]:
        assert (again / job.path).read_bytes() == left[out / job.path]


def test_another_seed_draws_other_recordings_of_the_same_distribution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[Job]] = []

    def told(jobs: list[Job], config: object, out: Path, workers: object, show: Progress) -> int:
        asked.append(jobs)
        return 0

    monkeypatch.setattr(datasets, "build", told)
    words = ["dataset", "build", str(PAPER), "--share", "0.02", "--out", str(tmp_path)]
    assert main(words) == main([*words, "--seed", "77"]) == 0
    of_file, anew = asked
    assert [job.samples for job in anew] == [job.samples for job in of_file]
    seeds = [{job.metadata.seed for job in jobs} for jobs in asked]
    assert not seeds[0] & seeds[1]
    assert {seed // SEEDS for seed in seeds[1]} == {77}


@pytest.mark.parametrize(("share", "told"), [("0.02", True), ("1", False)])
def test_a_build_whose_recordings_are_too_short_to_be_scored_says_so(
    share: str,
    told: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def begun(jobs: list[Job], config: object, out: Path, workers: object, show: Progress) -> int:
        show(0, len(jobs))
        return 0

    monkeypatch.setattr(datasets, "build", begun)
    assert main(["dataset", "build", "paper", "--share", share, "--out", str(tmp_path)]) == 0
    assert ("none is scored: a larger --share" in capsys.readouterr().err) is told


def test_a_build_says_what_it_makes_and_then_the_time_left_for_what_was_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def half(jobs: list[Job], config: object, out: Path, workers: object, show: Progress) -> int:
        for done in range(len(jobs) - 10, len(jobs) + 1):
            show(done, len(jobs))
        return 10

    monkeypatch.setattr(datasets, "build", half)
    words = ["dataset", "build", "paper", "--share", "0.1", "--out", str(tmp_path)]
    assert main(words) == 0
    plan, *lines = capsys.readouterr().err.splitlines()
    assert plan.startswith("       84 recordings; ") and plan.endswith("; 74 are there")
    assert [line.partition(",")[0] for line in lines] == [
        f"recordings: {done} of 10" for done in range(1, 11)
    ]
    assert all(line.endswith(" s left") for line in lines)
    assert main([*words, "--json"]) == 0
    assert "recordings: " not in capsys.readouterr().err


def test_a_build_that_is_interrupted_says_what_there_is_and_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(jobs: list[Job], config: object, out: Path, workers: object, show: Progress) -> int:
        show(3, len(jobs))
        raise KeyboardInterrupt

    monkeypatch.setattr(datasets, "build", stopped)
    assert main(["dataset", "build", "paper", "--share", "0.001", "--out", str(tmp_path)]) == 130
    err = capsys.readouterr().err
    assert f"3 of 84 recordings are in {tmp_path} (run the same command again)" in err


def test_a_report_counts_what_is_there(tmp_path: Path, few: list[Job]) -> None:
    build(few, {}, tmp_path / "set", HERE, quiet)
    report = describe(read_dataset(tmp_path / "set"))
    assert report.recordings == 3
    assert report.samples == sum(job.samples for job in few)
    assert report.slip == sum(job.slip for job in few)
    assert len(report.table) == 3
    assert sum(cell.percent for cell in report.table) == pytest.approx(100.0)


def test_the_command_line_describes(
    tmp_path: Path, few: list[Job], capsys: pytest.CaptureFixture[str]
) -> None:
    build(few, {}, tmp_path / "set", HERE, quiet)
    folder = str(tmp_path / "set")
    assert main(["dataset", "describe", folder]) == 0
    assert "Table I" in capsys.readouterr().out
    assert main(["dataset", "describe", folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recordings"] == 3


def test_an_empty_folder_and_a_wrong_share_are_usage_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "describe", str(tmp_path)]) == 2
    assert main(["dataset", "build", str(PAPER), "--out", str(tmp_path), "--share", "2"]) == 2
    assert "share" in capsys.readouterr().err


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


def test_a_full_disk_at_the_first_file_leaves_an_empty_folder(
    tmp_path: Path, few: list[Job], monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(path: Path, content: bytes) -> int:
        with path.open("wb") as file:
            file.write(content[:10])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    out = tmp_path / "set"
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", half)
        with pytest.raises(OSError, match="No space"):
            build(few[:1], {}, out, HERE, quiet)
    assert list(out.iterdir()) == []
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


@pytest.mark.parametrize("out", ["/proc/nobody/set", "/sys/set"])
def test_a_folder_that_may_not_be_written_is_told_in_one_line(
    out: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["dataset", "build", str(PAPER), "--share", "0.001", "--out", out]
    assert main(words) == 2
    err = capsys.readouterr().err
    assert "/proc/nobody" in err or "/sys/set" in err
    assert err.count("\n") == 1
