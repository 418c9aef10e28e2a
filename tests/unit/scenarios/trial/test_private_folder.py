"""The files of a run are readable by their owner only."""

import os
import stat
from pathlib import Path

from scenarios.lift.lift import lift
from tests.unit.scenarios.conftest import config


def test_run_folder_is_private_and_an_existing_parent_keeps_its_mode(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    runs.chmod(0o755)
    before = os.umask(0o000)
    try:
        lift.run(config("loop.deadline_s=1"), 0, runs)
    finally:
        os.umask(before)
    assert stat.S_IMODE(runs.stat().st_mode) == 0o755
    (folder,) = runs.iterdir()
    found = [folder, *folder.rglob("*")]
    assert len(found) > 2
    assert [path for path in found if stat.S_IMODE(path.stat().st_mode) & 0o77] == []
