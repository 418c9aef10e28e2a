"""Values of options are checked before anything moves or is computed: numbers by their bounds,
files by whether they can be written."""

import argparse
import os
import pwd
from pathlib import Path

import pytest

from drivers.errors import UsageError
from grasp.cli import options
from grasp.cli.commands import build_parser
from grasp.cli.main import _checked, main
from grasp.cli.output import progress
from grasp.files import write_whole

Capture = pytest.CaptureFixture[str]
WRITTEN = ("--out", "--figure")
MAKE_FOLDERS = (options.file_with_folders, options.folder_to_fill)
READERS = (*MAKE_FOLDERS, options.file_to_write)


def test_every_number_of_the_command_line_has_bounds() -> None:
    asked = set()
    for leaf in build_parser().leaves():
        for action in leaf.arguments():
            if action.type in (None, str, Path, *READERS):
                continue
            assert callable(action.type)
            asked.add(leaf.prog.split()[1])
            below = "-100" if leaf.prog == "grasp arm step" else "-1"  # a step goes either way
            for text in (below, "nan", "1e400", "inf", "9" * 30, "much", ""):
                with pytest.raises((argparse.ArgumentTypeError, ValueError)):
                    action.type(text)
                    pytest.fail(f"{leaf.prog} {action.dest} takes {text}")
    assert {"run", "campaign", "calibrate", "emulate"} <= asked


def test_invalid_values_are_refused_with_the_allowed_range(capsys: Capture) -> None:
    for words, expected in (
        ("run lift --trials 0", "0 is out of range: 1 to 10000"),
        ("run lift --trials x", "'x' is not a whole number, allowed: 1 to 10000"),
        ("run acquire --speed 9", "9 is out of range: 0.004 to 0.2 m/s"),
        ("arm step --x -1e3", "-1e3 is out of range: -5 to 5 mm"),
        ("run lift --object=", "argument --object: the value is empty"),
        ("run acquire --speed nan", "'nan' is not a number, allowed: 0.004 to 0.2 m/s"),
    ):
        assert main(words.split()) == 2, words
        assert expected in capsys.readouterr().err, words


def test_a_path_that_cannot_be_written_is_a_usage_error(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "file").write_text("")
    for name in ("a", "a.svg"):
        (tmp_path / name).mkdir()
    before = sorted(tmp_path.rglob("*"))
    asked = 0
    for leaf in build_parser().leaves():
        found = {word: action for action in leaf.arguments() for word in action.option_strings}
        for option in found.keys() & WRITTEN:
            kind = found[option].type
            name = "a"
            places = [tmp_path / "file" / name]
            places += [] if kind in MAKE_FOLDERS else [tmp_path / "nowhere" / name]
            places += [] if kind is options.folder_to_fill else [tmp_path / name]
            for place in places:
                assert main([*leaf.prog.split()[1:], option, str(place)]) == 2
                message = capsys.readouterr().err
                assert f"argument {option}: '{place}': " in message and message.count("\n") == 1
                asked += 1
    assert asked > 30
    assert sorted(tmp_path.rglob("*")) == before


def test_checking_a_writable_path_changes_nothing(tmp_path: Path) -> None:
    new, there = tmp_path / "new", tmp_path / "there"
    there.write_text("kept")
    assert options.file_to_write(str(new)) == new
    assert options.file_to_write(str(there)) == there
    assert options.file_with_folders(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"
    assert options.folder_to_fill(str(tmp_path)) == tmp_path
    with there.open("a") as file:
        descriptor = Path(f"/dev/fd/{file.fileno()}")
        assert options.file_to_write(str(descriptor)) == descriptor
        write_whole(descriptor, b", and more")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert there.read_text() == "kept, and more"
    with pytest.raises(argparse.ArgumentTypeError, match="File name too long"):
        options.file_to_write(str(tmp_path / ("x" * 300)))
    with pytest.raises(UsageError, match="there is no folder"):
        options.check_writable(tmp_path / "nowhere" / "a")


def test_progress_without_a_terminal_is_a_line_for_each_tenth(capsys: Capture) -> None:
    with progress("draws") as show:
        for done in range(1, 101):
            show(done, 100)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(",")[0] for line in lines] == [
        f"draws: {done} of 100" for done in range(10, 101, 10)
    ]
    assert all(line.endswith(" s left") for line in lines)
    with progress("draws", hidden=True) as show:
        show(1, 1)
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "proposed"),
    [
        ("release --confirm", "did you mean '--confirm-motion'?"),
        ("gripper activate --emp", "did you mean '--empty'?"),
        ("rnu lift", "did you mean 'run'?"),
        ("run lfit", "did you mean 'lift'?"),
        ("run lift --objct can", "did you mean '--object'?"),
    ],
)
def test_shortened_and_misspelt_words_are_refused_with_a_proposal(
    words: str, proposed: str
) -> None:
    with pytest.raises(UsageError) as error:
        build_parser().parse_args(words.split())
    assert proposed in error.value.message


def test_the_home_folder_is_inserted_where_no_shell_does_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    user = pwd.getpwuid(os.getuid())
    other = f"~{user.pw_name}/no", f"{user.pw_dir}/no"
    for word, path in ("~", tmp_path), ("~/x", tmp_path / "x"), other, ("~x.csv", "~x.csv"):
        assert _checked(f"--out={word}") == f"--out={path}", word
    assert main(["report", "x", "--out=~nobody_has_this/x.html"]) == 2
    assert "the home folder is not known" in capsys.readouterr().err
