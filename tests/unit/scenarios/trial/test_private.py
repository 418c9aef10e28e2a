"""What a run, a campaign or an acquisition leaves can be read by its user alone."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from scenarios.lift import lift
from tests.unit.scenarios.conftest import config


@pytest.fixture(params=[0o000, 0o022])
def umask(request: pytest.FixtureRequest) -> Iterator[None]:
    before = os.umask(request.param)
    yield
    os.umask(before)


def open_to_others(folder: Path) -> list[tuple[str, str]]:
    found = [folder, *folder.rglob("*")]
    return [(str(p), oct(p.stat().st_mode)) for p in found if stat.S_IMODE(p.stat().st_mode) & 0o77]


@pytest.mark.usefixtures("umask")
def test_run_folder_is_private(tmp_path: Path) -> None:
    lift.run(config("controller.lift_height_m=0.05"), 0, tmp_path / "runs")
    assert len(list((tmp_path / "runs").rglob("*"))) == 3
    assert open_to_others(tmp_path / "runs") == []


def test_folder_that_was_there_stays_as_it_is(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    runs.chmod(0o755)
    lift.run(config("controller.lift_height_m=0.05"), 0, runs)
    assert stat.S_IMODE(runs.stat().st_mode) == 0o755
    (folder,) = runs.iterdir()
    assert open_to_others(folder) == []
