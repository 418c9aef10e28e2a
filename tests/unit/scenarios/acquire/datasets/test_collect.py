"""A lab's own recordings as a data set that training and tuning take."""

from pathlib import Path

import pytest

from detector.recordings import read_dataset, write
from grasp.cli.main import main
from tests.unit.detector.toys import toy

ROWS = "t_s,p0,p1,p2,p3,p4,p5,slip\n" + "".join(f"{k / 100},{-k},0,0,0,0,0,0\n" for k in range(9))


@pytest.fixture
def own(tmp_path: Path) -> list[str]:
    """Two acquisitions, one of them cut in two, and a file from elsewhere."""
    for name in ("one/samples.npz", "two/samples-1.npz", "two/samples-2.npz"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        write(path, toy(len(name), "train"))
    (tmp_path / "else.csv").write_text(ROWS)
    return [str(tmp_path / name) for name in ("one", "two", "else.csv")]


def test_each_recording_is_of_one_split_and_all_splits_are_there(
    own: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "own"
    assert main(["dataset", "collect", *own, "--out", str(out)]) == 0
    assert "2 for train, 1 for validation, 1 for test" in capsys.readouterr().out
    sizes = [len(read_dataset(out, split)) for split in ("train", "validation", "test")]
    assert sizes == [2, 1, 1] and len(read_dataset(out)) == 4
    assert main(["detector", "tune", "energy", "--data", str(out), "--budget", "60"]) == 0


def test_two_recordings_and_a_folder_in_use_are_refused(
    own: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "collect", *own[:1], "--out", str(tmp_path / "few")]) == 2
    assert "1 recordings make no data set" in capsys.readouterr().err
    assert not (tmp_path / "few").exists()
    assert main(["dataset", "collect", *own, "--out", str(tmp_path / "one")]) == 2
    assert "is not empty" in capsys.readouterr().err


def test_fingertips_of_two_layouts_are_refused(
    own: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "else.csv", tmp_path / "own"
    file.write_text(ROWS.replace(",slip", ",p6,slip").replace("0,0\n", "0,0,0\n"))
    assert main(["dataset", "collect", *own, "--out", str(out)]) == 2
    assert "fingertips of 6 and 7 taxels" in capsys.readouterr().err
    assert not out.exists()


def test_a_folder_without_samples_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "collect", str(tmp_path), "--out", str(tmp_path / "own")]) == 2
    assert "no labelled samples" in capsys.readouterr().err
