"""Data sets that are not all there, folders of several, and labelled recordings by their folder."""

import json
from pathlib import Path

import pytest

from detector.recordings import write
from drivers.errors import BadFile
from grasp.cli.main import main
from scenarios.acquire.datasets.build import INDEX
from scenarios.benchmark.data_sets import require_whole
from tests.unit.detector.toys import toy, toys

THERE = 9
GO_ON = "`grasp dataset build` goes on with it"


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


def test_nothing_learns_from_a_data_set_that_is_not_all_there(tmp_path: Path) -> None:
    whole, half = built(tmp_path / "whole", THERE), built(tmp_path / "half", 84)
    require_whole([whole])
    with pytest.raises(BadFile, match="half: 9 of 84 recordings are there") as refused:
        require_whole([whole, half])
    assert GO_ON in refused.value.remedy
    (half / INDEX).unlink()
    require_whole([whole, half])


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


def test_a_folder_of_data_sets_or_one_within_another_is_refused_with_their_names(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "several"
    first, second = built(folder / "deep" / "a", THERE), built(folder / "b", 84)
    with pytest.raises(BadFile, match="holds 2 data sets") as refused:
        require_whole([folder])
    assert all(str(each) in str(refused.value.remedy) for each in (first, second))
    outer = built(tmp_path / "outer", THERE)
    built(outer / "deep" / "inner", THERE)
    with pytest.raises(BadFile, match="another data set"):
        require_whole([outer])
