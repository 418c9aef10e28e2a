"""What verbs share: where nothing can be written is told before anything moves or is computed, and
settings of one's own go by the same options everywhere."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.errors import UsageError
from grasp.cli.main import build_parser, main
from grasp.cli.parser import Parser
from grasp.cli.pictures import picture
from grasp.cli.places import file_to_write, file_with_folders, folder_to_fill, must_be_writable
from grasp.cli.report import _html
from scenarios.rigs import doctor

WRITTEN = ("--out", "--write", "--figure")
MAKE_FOLDERS = (file_with_folders, folder_to_fill)


def verbs(parser: Parser) -> Iterator[Parser]:
    within = parser.verbs()
    for verb in dict.fromkeys(within.values()):
        yield from verbs(verb)
    if not within:
        yield parser


def options(verb: Parser) -> dict[str, argparse.Action]:
    return {word: action for action in verb.arguments() for word in action.option_strings}


VERBS = {verb.prog: verb for verb in verbs(build_parser())}
PLACES = [
    (words, option, options(verb)[option])
    for words, verb in VERBS.items()
    for option in WRITTEN
    if option in options(verb)
]


def test_verbs_that_write_are_found() -> None:
    assert len(PLACES) > 15
    assert {"grasp calibrate hand", "grasp run lift", "grasp tactile rest"} <= {
        p[0] for p in PLACES
    }


@pytest.mark.parametrize(
    ("words", "option", "action"), PLACES, ids=[f"{p[0]} {p[1]}" for p in PLACES]
)
def test_a_place_that_cannot_be_written_is_refused_as_a_word_of_the_command_line(
    words: str, option: str, action: argparse.Action, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "file").write_text("")
    name = "a.svg" if action.type is picture else "a.html" if action.type is _html else "a"
    places = [tmp_path / "file" / name]
    if action.type not in MAKE_FOLDERS:
        places.append(tmp_path / "nowhere" / name)
    if action.type is not folder_to_fill:
        (tmp_path / name).mkdir()
        places.append(tmp_path / name)
    before = sorted(tmp_path.rglob("*"))
    for place in places:
        assert main([*words.split()[1:], option, str(place)]) == 2
        told = capsys.readouterr().err
        assert f"argument {option}: '{place}': " in told and told.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("place", ["/proc/nobody", "/proc"])
def test_a_folder_in_which_no_file_can_be_made_is_refused_whatever_its_mode_says(
    place: str,
) -> None:
    for read in (file_with_folders, folder_to_fill):
        with pytest.raises(argparse.ArgumentTypeError, match="cannot be written"):
            read(f"{place}/x")


@pytest.mark.parametrize(
    "words", ["lift", "lift --first --dry-run --rig hardware", "tap --dry-run --rig hardware",
              "lift --rig hardware --confirm-motion", "acquire", "lift --json"]
)  # fmt: skip
def test_default_folder_of_recordings_is_asked_before_anything_is_opened(
    words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As one that is named: a run from /proc had ended so once the devices were connected."""
    monkeypatch.chdir("/proc")
    assert main(["run", *words.split()]) == 2
    told = "".join(capsys.readouterr())
    assert "argument --runs: 'runs': cannot be written in /proc" in told
    assert told.count("\n") == 1


def test_doctor_fails_where_no_run_can_be_recorded_unless_another_folder_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "JITTER_S", 0.05)
    monkeypatch.setattr(doctor, "_detectors", lambda *asked: [])
    monkeypatch.chdir("/proc")
    assert main(["doctor"]) == 2
    told = capsys.readouterr().out
    assert "FAIL  disk" in told and "'runs': cannot be written in /proc" in told
    assert "record elsewhere with --runs" in told
    assert main(["doctor", "--runs", str(tmp_path / "new")]) == 0
    assert "GB free here" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


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
        must_be_writable(tmp_path / "nowhere" / "a")


@pytest.mark.parametrize("words", VERBS)
def test_a_verb_that_takes_files_of_settings_takes_single_ones_too(words: str) -> None:
    taken = options(VERBS[words])
    assert ("--config" in taken) == ("--set" in taken)
    if "--config" in taken:  # several: none replaces another without a word
        assert isinstance(taken["--config"], argparse._AppendAction)  # noqa: SLF001


@pytest.mark.parametrize("words", ["runs", "report RUN", "export RUN", "campaign summary FILE"])
@pytest.mark.parametrize("given", ["--config lab.toml", "--set a.b=1", "--set=a.b=1"])
def test_a_verb_that_shows_what_was_made_says_why_it_takes_no_settings(
    words: str, given: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words.split(), *given.split()]) == 2
    assert "keeps the settings that it was made with" in capsys.readouterr().err
