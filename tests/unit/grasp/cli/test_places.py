"""What verbs share: where nothing can be written is told before anything moves or is computed, and
settings of one's own go by the same options everywhere."""

import argparse
from pathlib import Path

import pytest

from drivers.errors import UsageError
from grasp.cli.commands import build_parser
from grasp.cli.main import main
from grasp.cli.options import (
    check_writable,
    file_to_write,
    file_with_folders,
    folder_to_fill,
    picture,
)
from grasp.cli.parser import Parser

WRITTEN = ("--out", "--write", "--figure")
MAKE_FOLDERS = (file_with_folders, folder_to_fill)


def options(verb: Parser) -> dict[str, argparse.Action]:
    return {word: action for action in verb.arguments() for word in action.option_strings}


def test_a_place_that_cannot_be_written_is_refused_as_a_word_of_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    for name in ("a", "a.svg"):
        (tmp_path / name).mkdir()
    before = sorted(tmp_path.rglob("*"))
    asked = 0
    for verb in build_parser().leaves():
        found = options(verb)
        for option in found.keys() & WRITTEN:
            kind = found[option].type
            name = "a.svg" if kind is picture else "a"
            places = [tmp_path / "file" / name]
            places += [] if kind in MAKE_FOLDERS else [tmp_path / "nowhere" / name]
            places += [] if kind is folder_to_fill else [tmp_path / name]
            for place in places:
                assert main([*verb.prog.split()[1:], option, str(place)]) == 2
                told = capsys.readouterr().err
                assert f"argument {option}: '{place}': " in told and told.count("\n") == 1
                asked += 1
    assert asked > 30
    assert sorted(tmp_path.rglob("*")) == before


def test_a_place_that_can_be_written_is_left_as_it_was(tmp_path: Path) -> None:
    new, there = tmp_path / "new", tmp_path / "there"
    there.write_text("kept")
    assert file_to_write(str(new)) == new
    assert file_to_write(str(there)) == there
    assert file_with_folders(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"
    assert folder_to_fill(str(tmp_path)) == tmp_path
    assert file_to_write("/dev/stdout") == Path("/dev/stdout")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert there.read_text() == "kept"


def test_a_name_that_no_disk_takes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="File name too long"):
        file_to_write(str(tmp_path / ("x" * 300)))
    with pytest.raises(UsageError, match="there is no folder"):
        check_writable(tmp_path / "nowhere" / "a")
