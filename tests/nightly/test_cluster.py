"""The same trials on a Dask cluster: a scheduler and two workers on this machine."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.wire.scenarios.campaigns import campaign_file, finished, rows, started
from tests.wire.waiting import PATIENCE_S, until

pytest.importorskip("distributed")
ROOT = Path(__file__).parents[2]


class Cluster(NamedTuple):
    """A scheduler and its file."""

    address: str
    file: tuple[str, ...]
    process: subprocess.Popen[bytes]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler with two workers in separate processes."""
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
        yield Cluster(json.loads(book.read_text())["address"], file, processes[0])
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(20)


def dask(program: str, *arguments: str, at: Path, path: Path = ROOT) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{program}", *arguments], cwd=at,
        env={**os.environ, "PYTHONPATH": str(path)}, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def test_rows_are_those_of_one_machine(cluster: Cluster, tmp_path: Path) -> None:
    file = str(campaign_file(tmp_path, 3))
    here, there = tmp_path / "here.sqlite", tmp_path / "there.sqlite"
    assert finished(file, "--out", str(here), "--jobs", "1")[0] == 0
    code, _, err = finished(file, "--out", str(there), "--cluster", cluster.address)
    assert code == 0, err
    assert len(rows(there)) == 6
    assert rows(there) == rows(here)


def test_killed_scheduler_loses_no_row(cluster: Cluster, tmp_path: Path) -> None:
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


def test_a_worker_without_the_package_is_named_before_any_trial(
    cluster: Cluster, tmp_path: Path
) -> None:
    from distributed import Client

    (tmp_path / "scenarios.py").write_text("raise ImportError('no scenarios here')")
    one = ("--nworkers", "1", "--no-nanny", "--name", "bare")
    bare = dask("dask_worker", *cluster.file, *one, at=tmp_path, path=tmp_path)
    try:
        with Client(cluster.address, set_as_default=False) as client:
            until(lambda: len(client.nthreads()) == 3)
        out = tmp_path / "a.sqlite"
        file = str(campaign_file(tmp_path, 3))
        code, _, err = finished(file, "--out", str(out), "--cluster", cluster.address)
        assert code == 2 and "no scenarios here" in err and not rows(out), err
    finally:
        bare.terminate()
        bare.wait(20)
