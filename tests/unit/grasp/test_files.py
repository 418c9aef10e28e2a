"""Atomic writing, private folders and lock files."""

import os
import resource
from contextlib import suppress
from pathlib import Path

import pytest

from drivers.errors import GraspError, OutputClosedError, Refused
from grasp.files import (
    Holder,
    locked,
    make_private_folder,
    use_writable_cache,
    whole_folder,
    why_not_writable,
    write_whole,
)


@pytest.mark.parametrize(("private", "mode"), [(False, 0o644), (True, 0o600)])
def test_writing_replaces_a_file_and_leaves_no_partial_file(
    private: bool, mode: int, tmp_path: Path
) -> None:
    before = os.umask(0o022)
    try:
        for content in (b"first", b"second"):
            write_whole(tmp_path / "new.json", content, private)
            assert (tmp_path / "new.json").read_bytes() == content
    finally:
        os.umask(before)
    assert (tmp_path / "new.json").stat().st_mode & 0o777 == mode
    assert [path.name for path in tmp_path.iterdir()] == ["new.json"]


def test_a_folder_appears_when_it_is_complete(tmp_path: Path) -> None:
    for error in (KeyboardInterrupt, OSError, None):
        with suppress(KeyboardInterrupt, OSError), whole_folder(tmp_path / "new") as folder:
            (folder / "first").write_bytes(b"1")
            assert not (tmp_path / "new").exists()
            if error is not None:
                raise error
        assert os.listdir(tmp_path) == ([] if error else ["new"])
    with pytest.raises(OSError, match=r"not empty.*new"), whole_folder(tmp_path / "new") as folder:
        pass
    assert os.listdir(tmp_path) == ["new"] and os.listdir(tmp_path / "new") == ["first"]


def test_a_pipe_without_a_reader_is_a_closed_output(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with pytest.raises(OutputClosedError):
        write_whole(Path(f"/dev/fd/{writer}"), b"x" * 10**6)
    os.close(writer)


def test_missing_parent_folders_are_made_private(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    make_private_folder(tmp_path / "runs" / "lift")
    make_private_folder(tmp_path / "runs" / "lift")
    modes = [path.stat().st_mode & 0o777 for path in (tmp_path, *tmp_path.rglob("*"))]
    assert modes == [0o755, 0o700, 0o700]
    with pytest.raises(FileExistsError):
        make_private_folder(tmp_path / "runs", exist_ok=False)


def refused(holder: Holder | None) -> GraspError:
    return Refused("somebody" if holder is None else f"{holder.pid}: {holder.command}", "wait")


def test_second_process_is_refused_with_the_holder_and_later_gets_the_lock(tmp_path: Path) -> None:
    file = tmp_path / "cell.lock"
    with locked(file, 0o600, refused):
        assert file.stat().st_mode & 0o777 == 0o600
        with pytest.raises(Refused, match=f"^{os.getpid()}: .*"), locked(file, 0o600, refused):
            raise AssertionError("held twice")
        file.unlink()  # by somebody who believes that it was left behind
        with pytest.raises(Refused, match="somebody"), locked(file, 0o600, refused):
            raise AssertionError("held twice")
    assert not file.exists()
    with locked(file, 0o644, refused):
        assert file.stat().st_mode & 0o777 == 0o644


def test_a_full_disk_is_not_writable(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, before[1]))  # EFBIG, as ENOSPC
    try:
        assert "cannot be written in" in why_not_writable(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert why_not_writable(tmp_path) == ""


def test_unwritable_cache_folder_is_replaced_by_one_of_the_temporary_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ours = tmp_path / f"grasp-cache-{os.getuid()}"
    for home, numba in (("/dev/null/home", "~/x"), (str(tmp_path), "/dev/null/numba")):
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
        monkeypatch.setenv("HOME", home)
        monkeypatch.setenv("NUMBA_CACHE_DIR", numba)
        use_writable_cache()
        assert os.environ.get("XDG_CACHE_HOME") == (None if home == str(tmp_path) else str(ours))
        assert "NUMBA_CACHE_DIR" not in os.environ
    ours.chmod(0o777)  # somebody else could put code there
    monkeypatch.setenv("HOME", "/dev/null/home")
    use_writable_cache()
    assert "XDG_CACHE_HOME" not in os.environ
