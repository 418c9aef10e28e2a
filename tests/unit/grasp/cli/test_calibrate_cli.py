"""`grasp calibrate fingertip`: what it writes and what it leaves alone."""

import json
from pathlib import Path

import numpy as np
import pytest

from detector.recordings import Metadata, Recording, write
from grasp.cli.main import main

CHECK = ("calibrate", "fingertip", "--check", "--clips", "2")


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
    assert found["misfit"] > 0.0 and not found["fitted"]


def test_nothing_but_a_fit_of_its_own_is_written_over(
    clip: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = clip.read_bytes()
    assert main(["calibrate", "fingertip", "--recording", str(clip), "--out", str(clip)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert clip.read_bytes() == before
