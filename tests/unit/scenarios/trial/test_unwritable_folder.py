"""A folder that cannot be written is found before a rig opens."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import CouldNotRecord, UsageError
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs import opening
from scenarios.tap.tap import tap
from scenarios.trial import run_folder
from tests.unit.scenarios.conftest import config


@pytest.fixture(autouse=True)
def no_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(*_: object, **__: object) -> None:
        raise AssertionError("a rig was opened")

    monkeypatch.setattr("scenarios.rigs.simulated.simulated", opened)
    monkeypatch.setattr("scenarios.rigs.emulated.emulated", opened)
    monkeypatch.setattr(opening, "hardware", opened)


@pytest.fixture(params=["below a file", "on a read-only file system", "on a full disk"])
def nowhere(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A folder that cannot be written."""
    if request.param == "below a file":
        (tmp_path / "file").write_text("")
        return tmp_path / "file" / "runs"
    if request.param == "on a read-only file system":
        return Path("/proc/runs")  # also for root

    def full(**_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(run_folder, "TemporaryFile", full)
    return tmp_path / "runs"


def lifts(runs: Path) -> Any:
    return lift.run(config(), 0, runs)


def taps(runs: Path) -> Any:
    return tap.run(load_config("can", "simulated", "energy", None, ()).for_tap(), 0, runs)


@pytest.mark.parametrize("run", [lifts, taps])
def test_no_rig_opens_for_an_unwritable_folder(run: Callable[[Path], Any], nowhere: Path) -> None:
    with pytest.raises((CouldNotRecord, UsageError)) as refused:
        run(nowhere)
    assert "--runs" in refused.value.remedy
