"""Files that are whole or not there."""

import os
from pathlib import Path

import pytest

from grasp.files import make_private_folder, write_whole


@pytest.mark.parametrize(("private", "mode"), [(False, 0o644), (True, 0o600)])
def test_a_file_takes_the_place_of_what_stood_there_and_leaves_nothing_beside(
    private: bool, mode: int, tmp_path: Path
) -> None:
    before = os.umask(0o022)
    try:
        for content in (b"first", b"second"):
            write_whole(tmp_path / "told.json", content, private)
            assert (tmp_path / "told.json").read_bytes() == content
    finally:
        os.umask(before)
    assert (tmp_path / "told.json").stat().st_mode & 0o777 == mode
    assert [path.name for path in tmp_path.iterdir()] == ["told.json"]


def test_folders_that_are_made_on_the_way_are_their_users_alone(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    make_private_folder(tmp_path / "runs" / "lift")
    make_private_folder(tmp_path / "runs" / "lift")
    modes = [path.stat().st_mode & 0o777 for path in (tmp_path, *tmp_path.rglob("*"))]
    assert modes == [0o755, 0o700, 0o700]
    with pytest.raises(FileExistsError):
        make_private_folder(tmp_path / "runs", exist_ok=False)
