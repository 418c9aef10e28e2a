"""Data sets that are not all there, folders of several, and labelled recordings by their folder."""

import json
import shutil
from pathlib import Path

import pytest

from detector.recordings import write
from drivers.errors import BadFile
from grasp.cli.main import main
from scenarios.acquire.datasets.build import INDEX
from scenarios.benchmark.data_sets import read_set, require_whole
from tests.unit.detector.toys import toy, toys

THERE = 9
GO_ON = "`grasp dataset build` goes on with it"
VERBS = [
    ["dataset", "describe"],
    ["detector", "evaluate", "energy", "--data"],
    ["detector", "tune", "energy", "--budget", "60", "--data"],
]


def filled(folder: Path) -> Path:
    """As somebody put it together: recordings, and nothing that says how many."""
    for split in ("train", "validation", "test"):
        for recording in toys(split, THERE // 3, 0):  # type: ignore[arg-type]
            path = folder / split / f"{recording.source}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, recording)
    return folder


def built(folder: Path, of: int) -> Path:
    """As `grasp dataset build` left it, which was to make so many."""
    filled(folder)
    index = {"digest": "0", "commit": "0", "recordings": of, "dataset": {}}
    (folder / INDEX).write_text(json.dumps(index))
    return folder


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[1])
def test_what_is_not_there_of_a_data_set_is_told_in_one_line(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, half = built(tmp_path / "whole", THERE), built(tmp_path / "half", 84)
    assert main([*verb, str(whole)]) == 0
    assert "are there" not in capsys.readouterr().err
    assert main([*verb, str(half)]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "are there" in line]
    assert [line.strip() for line in told] == [f"{half}: 9 of 84 recordings are there: {GO_ON}"]


def test_nothing_learns_from_a_data_set_that_is_not_all_there(tmp_path: Path) -> None:
    whole, half = built(tmp_path / "whole", THERE), built(tmp_path / "half", 84)
    require_whole([whole])
    with pytest.raises(BadFile, match="half: 9 of 84 recordings are there") as refused:
        require_whole([whole, half])
    assert GO_ON in refused.value.remedy
    (half / INDEX).unlink()
    require_whole([whole, half])


@pytest.mark.parametrize("index", ["", "[]", "{}", '{"recordings": "many"}'])
def test_a_data_set_that_does_not_say_how_much_it_is_is_taken_as_it_is(
    index: str, tmp_path: Path
) -> None:
    folder = filled(tmp_path)
    if index:
        (folder / INDEX).write_text(index)
    told: list[str] = []
    require_whole([folder])
    assert len(read_set(folder, tell=told.append)) == THERE and told == []
    assert len(read_set(folder, "test")) == THERE // 3


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[1])
def test_a_folder_of_data_sets_is_refused_with_their_names(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One that was collected, which has no index, beside those that were built."""
    names = [built(tmp_path / "deep" / "a", THERE), built(tmp_path / "b", 84), tmp_path / "own"]
    filled(tmp_path / "own")
    listed = " ".join(sorted(str(path) for path in names))
    assert main([*verb, str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"grasp: {tmp_path}: holds 3 data sets (name them: {listed})"
    shutil.rmtree(tmp_path / "b")
    shutil.rmtree(tmp_path / "own")
    assert main([*verb, str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"holds a data set (name it: {names[0]})")
    with pytest.raises(BadFile, match="holds a data set"):
        require_whole([tmp_path])


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[1])
def test_a_data_set_with_another_one_in_it_is_refused(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outer = built(tmp_path, THERE)
    inner = built(tmp_path / "deep" / "inner", THERE)
    assert main([*verb, str(outer)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"grasp: {outer}: has another data set in it, {inner} (move that one out)"
    with pytest.raises(BadFile, match="another data set"):
        require_whole([outer])


def test_an_acquisition_is_scored_by_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whole, or cut where too many samples were missing."""
    words = ["detector", "evaluate", "energy", "--recording"]
    for number, name in enumerate(("samples-1.npz", "samples-2.npz"), 1):
        write(tmp_path / name, toy(number, "test"))
        assert main([*words, str(tmp_path), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["recordings"] == number


def test_a_folder_or_a_run_without_labels_is_refused_with_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*words: str) -> str:
        assert main(list(words)) == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    evaluate = ["detector", "evaluate", "energy", "--recording"]
    run, mcap = tmp_path / "run", tmp_path / "run" / "recording.mcap"
    run.mkdir()
    mcap.write_bytes(b"\x89MCAP0\r\n")
    assert "run has no labelled samples" in refused(*evaluate, str(run))
    assert "of `grasp run acquire`, samples*.npz beside" in refused(*evaluate, str(mcap))
    write(run / "samples.npz", toy(1, "test"))
    collect = ["dataset", "collect", str(mcap), "--out", str(tmp_path / "out")]
    for words in ([*evaluate, str(mcap)], collect):
        line = refused(*words)
        assert "recording of a run, which has no labels" in line
        assert f"its labelled samples are {run / 'samples.npz'}" in line
    assert "give it with --data" in refused(*evaluate, str(filled(tmp_path / "own")))
