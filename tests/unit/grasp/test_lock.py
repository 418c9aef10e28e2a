"""A file that one process holds: who comes second is told by whom."""

import os
from pathlib import Path

import pytest

from drivers.errors import GraspError, Refused
from grasp.lock import Holder, locked


def refused(holder: Holder | None) -> GraspError:
    return Refused("somebody" if holder is None else f"{holder.pid}: {holder.command}", "wait")


def test_who_comes_second_is_told_which_process_holds_it_and_later_gets_it(tmp_path: Path) -> None:
    file = tmp_path / "cell.lock"
    with locked(file, 0o600, refused):
        assert file.stat().st_mode & 0o777 == 0o600
        with pytest.raises(Refused, match=f"^{os.getpid()}: .*"), locked(file, 0o600, refused):
            raise AssertionError("held twice")
    assert not file.exists()
    with locked(file, 0o644, refused):
        assert file.stat().st_mode & 0o777 == 0o644
