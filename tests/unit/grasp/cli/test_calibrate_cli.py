"""`grasp world calibrate`: what it writes, what it leaves alone, what it does not compare."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from detector.recordings import Metadata, Recording, write
from grasp.cli.main import main
from scenarios.studies.signal import calibrate

CHECK = ("world", "calibrate", "--check", "--clips", "2")


def stroked(taxels: int = 6, strokes: int = 3) -> Recording:
    """Strokes between pauses, wandering taxels."""
    slip = np.array(([False] * 40 + [True] * 60) * strokes + [False] * 40)
    size = np.where(slip, 20, 2)[:, None]
    steps = np.random.default_rng(1).normal(size=(len(slip), taxels)) * size
    counts = np.clip(np.cumsum(steps, axis=0), -400, 400).round().astype(np.int16)
    metadata = Metadata(
        set="slide", split="train", surface="planar", motion="primary", speed_mps=0.05,
        spin_radps=0.0, direction="0", seed=1,
    )  # fmt: skip
    return Recording(np.arange(len(slip)) / 100.0, counts[:, None], slip, None, "", metadata)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    path = tmp_path / "clip.npz"
    write(path, stroked())
    return path


def test_judgement_in_json_is_one_object_with_every_figure(
    clip: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*CHECK, "--recording", str(clip), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["data_set"]["mean"]) == 6
    assert found["misfit"] > 0.0 and not found["fitted"]


def test_judgement_for_a_person_leaves_out_the_ratio_to_a_figure_that_is_nought(
    clip: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    row = {"simulated": 0.2, "low": 0.1, "high": 0.3, "within_aim": True}
    rows = [SimpleNamespace(name="kurtosis", real=0.4, **row),
            SimpleNamespace(name="hiss", real=0.0, **row)]  # fmt: skip
    levels = SimpleNamespace(**{name: np.arange(6.0) for name in ("mean", "std", "least", "most")})
    for name, found in {"figures": None, "mean": None, "misfit": 1.5, "compare": rows,
                        "data_set_levels": levels}.items():  # fmt: skip
        monkeypatch.setattr(calibrate, name, lambda *_, found=found: found)
    assert main([*CHECK, "--recording", str(clip)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("ratio") and lines[1].split()[-1] == "0.50"
    assert lines[2].split() == ["hiss", "0", "0.2", "0.1", "0.3"]
    assert {len(line) for line in lines[:3]} == {len(lines[0])}
    assert "misfit 1.50 (1: on average just within the aims)" in lines
    assert any(line.startswith("levels a taxel, ") for line in lines)


def test_nothing_but_a_fit_of_its_own_is_written_over(
    clip: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = clip.read_bytes()
    assert main(["world", "calibrate", "--recording", str(clip), "--out", str(clip)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert clip.read_bytes() == before


@pytest.mark.parametrize("wishes", ["--check --out", "--check --data . --figure", "--data . --out"])
def test_what_would_be_left_undone_is_refused_and_leaves_no_file(
    wishes: str, clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "x.svg"
    assert main(["world", "calibrate", "--recording", str(clip), *wishes.split(), str(out)]) == 2
    assert not out.exists()


def test_data_set_of_another_layout_is_refused_by_name(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "eight"
    folder.mkdir()
    write(folder / "a.npz", stroked(taxels=8))
    assert main([*CHECK, "--recording", str(clip), "--data", str(folder)]) == 2
    assert "of 8 taxels, the recording's of 6" in capsys.readouterr().err


def test_set_too_small_to_be_judged_says_so(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "small"
    folder.mkdir()
    write(folder / "a.npz", stroked(strokes=5))
    assert main([*CHECK, "--recording", str(clip), "--data", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert f"judging {folder}: 1 of 1" in err
    assert "few pieces: ranks say little" in out
    assert out.count("too few strokes, pauses or recordings") == 2
