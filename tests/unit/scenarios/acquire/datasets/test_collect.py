"""Collecting recordings of a lab into a data set for training and tuning."""

from pathlib import Path

import pytest

from detector.recordings import read_dataset, write
from grasp.cli.main import main
from tests.unit.detector.toy_recordings import toy

ROWS = "t_s,p0,p1,p2,p3,p4,p5,slip\n" + "".join(f"{k / 100},{-k},0,0,0,0,0,0\n" for k in range(9))


@pytest.fixture
def sources(tmp_path: Path) -> list[str]:
    """Two acquisitions, one of them split, and a CSV file."""
    for seed, name in enumerate(("one/samples.npz", "two/samples-1.npz", "two/samples-2.npz")):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        write(path, toy(seed, "train"))
    (tmp_path / "else.csv").write_text(ROWS)
    return [str(tmp_path / name) for name in ("one", "two", "else.csv")]


def test_each_recording_has_one_split_and_every_split_has_recordings(
    sources: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "set"
    assert main(["dataset", "collect", *sources, "--out", str(out)]) == 0
    assert "2 for train, 1 for validation, 1 for test" in capsys.readouterr().out
    sizes = [len(read_dataset(out, split)) for split in ("train", "validation", "test")]
    assert sizes == [2, 1, 1] and len(read_dataset(out)) == 4
    assert main(["detector", "tune", "energy", "--data", str(out), "--budget", "60"]) == 0


def test_duplicate_recordings_are_refused(
    sources: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Otherwise one recording could be in the training and the test split."""
    (tmp_path / "link").symlink_to(tmp_path / "one")
    problems = {
        tmp_path / "one" / "samples.npz": "is given twice, by itself or in its folder",
        tmp_path / "link": "is the same recording as",
    }
    for again, problem in problems.items():
        assert (
            main(["dataset", "collect", *sources, str(again), "--out", str(tmp_path / "set")]) == 2
        )
        assert problem in capsys.readouterr().err
