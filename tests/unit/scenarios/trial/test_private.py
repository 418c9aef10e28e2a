"""What a run, a campaign or an acquisition leaves can be read by its user alone."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from scenarios.acquire import acquire
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.press import motion
from scenarios.campaign.spec import combinations
from scenarios.campaign.store import CampaignStore
from scenarios.lift import lift
from tests.unit.scenarios.campaign.test_campaign import TWO_OBJECTS
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


@pytest.mark.usefixtures("umask")
def test_acquisition_is_private(tmp_path: Path) -> None:
    settings = load_acquire_config("planar", "simulated", None, [])
    course = motion("0", 0.05, 1.0)
    acquire.run(settings, course, 0, 1.0, tmp_path / "new" / "runs", False, lambda _: None)
    assert len(list((tmp_path / "new").rglob("*.npz"))) == 1
    assert open_to_others(tmp_path / "new") == []


@pytest.mark.usefixtures("umask")
def test_campaign_file_is_private(tmp_path: Path) -> None:
    path = tmp_path / "campaigns" / "c.sqlite"
    with CampaignStore.create(path, TWO_OBJECTS, combinations(TWO_OBJECTS)):
        assert open_to_others(path.parent) == []
        assert len(list(path.parent.iterdir())) > 1


def test_folder_that_was_there_stays_as_it_is(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    runs.chmod(0o755)
    lift.run(config("controller.lift_height_m=0.05"), 0, runs)
    assert stat.S_IMODE(runs.stat().st_mode) == 0o755
    (folder,) = runs.iterdir()
    assert open_to_others(folder) == []
