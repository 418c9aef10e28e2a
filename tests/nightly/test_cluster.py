"""The same trials on a Dask cluster: a scheduler and two workers on this machine."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from grasp.settings import config_dir
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.rigs.workers import Workers
from tests.wire.scenarios.campaigns import (
    PATIENCE_S,
    campaign_file,
    finished,
    rows,
    started,
    until,
)

pytest.importorskip("distributed")
ROOT = Path(__file__).parents[2]
PAPER = load_dataset_config(config_dir() / "datasets" / "paper.toml")


class Cluster(NamedTuple):
    """A scheduler."""

    address: str
    process: subprocess.Popen[bytes]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler with two workers, each a process of its own."""
    book = tmp_path / "scheduler.json"
    file = ("--scheduler-file", str(book), "--no-dashboard")
    processes = [dask("dask_scheduler", "--host", "127.0.0.1", "--port", "0", *file, at=tmp_path)]
    try:
        until(book.exists)
        alone = ("--nworkers", "1", "--nthreads", "1", "--no-nanny")
        processes += [
            dask("dask_worker", *file, *alone, "--name", name, at=tmp_path)
            for name in ("one", "two")
        ]
        yield Cluster(json.loads(book.read_text())["address"], processes[0])
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(20)


def dask(program: str, *words: str, at: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{program}", *words], cwd=at,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def test_rows_are_those_of_one_machine(cluster: Cluster, tmp_path: Path) -> None:
    file = str(campaign_file(tmp_path, 3))
    here, there = tmp_path / "here.sqlite", tmp_path / "there.sqlite"
    assert finished(file, "--out", str(here), "--jobs", "1")[0] == 0
    code, _, err = finished(file, "--out", str(there), "--cluster", cluster.address)
    assert code == 0, err
    assert len(rows(there)) == 6
    assert rows(there) == rows(here)


def test_a_data_set_is_that_of_one_machine(cluster: Cluster, tmp_path: Path) -> None:
    jobs = [msgspec.structs.replace(job, static=200, slip=200) for job in plan(PAPER)[:3]]
    here, there = tmp_path / "here", tmp_path / "there"
    for out, workers in ((here, Workers(0)), (there, Workers(1, cluster.address))):
        assert build(jobs, {}, out, workers, lambda done, total: None) == 3
    made = sorted(path.relative_to(there) for path in there.glob("*/*.npz"))
    assert len(made) == 3
    assert all((there / path).read_bytes() == (here / path).read_bytes() for path in made)


def test_a_scheduler_that_goes_costs_no_row(cluster: Cluster, tmp_path: Path) -> None:
    out = tmp_path / "a.sqlite"
    file = str(campaign_file(tmp_path, 50))
    campaign = started(file, "--out", str(out), "--cluster", cluster.address)
    until(lambda: len(rows(out)) >= 2)
    cluster.process.kill()
    _, err = campaign.communicate(timeout=PATIENCE_S)
    assert campaign.returncode == 3
    assert f"the Dask scheduler at {cluster.address} is gone" in err
    assert 2 <= len(rows(out)) < 100
    assert {row["status"] for row in rows(out)} == {"done"}
