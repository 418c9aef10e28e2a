"""Incomplete data sets, and labelled recordings by their folder."""

import json
from pathlib import Path

import pytest

from detector.recordings import INDEX, write
from drivers.errors import BadFile
from grasp.cli.main import main
from scenarios.benchmark.data_sets import require_whole
from tests.unit.detector.toy_recordings import toy, toys

PRESENT = 9
CONTINUE = "`grasp dataset build` continues it"


def filled(folder: Path) -> Path:
    """A folder of recordings without an index."""
    for split in ("train", "validation", "test"):
        for recording in toys(split, PRESENT // 3, 0):  # type: ignore[arg-type]
            path = folder / split / f"{recording.source}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path, recording)
    return folder


def built(folder: Path, of: int) -> Path:
    """A folder of `grasp dataset build` with ``of`` planned recordings."""
    filled(folder)
    index = {"digest": "0", "commit": "0", "recordings": of, "dataset": {}}
    (folder / INDEX).write_text(json.dumps(index))
    return folder


def test_incomplete_data_set_is_refused_for_training(tmp_path: Path) -> None:
    whole, half = built(tmp_path / "whole", PRESENT), built(tmp_path / "half", 84)
    require_whole([whole])
    with pytest.raises(BadFile, match="half: 9 of 84 recordings exist") as refused:
        require_whole([whole, half])
    assert CONTINUE in refused.value.remedy
    (half / INDEX).unlink()
    require_whole([whole, half])


def test_acquisition_is_evaluated_by_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one file, or several split where too many samples were missing."""
    words = ["detector", "evaluate", "energy", "--recording"]
    for number, name in enumerate(("samples-1.npz", "samples-2.npz"), 1):
        write(tmp_path / name, toy(number, "test"))
        assert main([*words, str(tmp_path), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["figures"]["recordings"]["value"] == number
