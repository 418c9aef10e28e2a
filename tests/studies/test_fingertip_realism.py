"""The two-sample test separates different distributions, and not equal ones."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import Metadata, Recording, write
from studies import fingertip_realism
from studies.fingertip_realism import STUDY, Task, separate, windows_of
from studies.runner import main

STROKE, PAUSE = 60, 40  # samples
METADATA = Metadata(
    set="slide", split="train", surface="planar", motion="primary", speed_mps=0.05,
    spin_radps=0.0, direction="0", seed=1,
)  # fmt: skip


def recording(seed: int, size: float = 10.0, smooth: int = 1) -> Recording:
    """Four strokes and five pauses: wandering taxels in strokes, noise in pauses."""
    rng = np.random.default_rng(seed)
    slip = np.array(([False] * PAUSE + [True] * STROKE) * 4 + [False] * PAUSE)
    steps = rng.standard_normal((len(slip), 6)) * np.linspace(1.0, 0.1, 6) * size
    kernel = np.ones(smooth) / np.sqrt(smooth)
    steps = np.stack([np.convolve(column, kernel, "same") for column in steps.T], axis=1)
    counts = np.cumsum(np.where(slip[:, None], steps, 0.0), axis=0)
    counts += 0.1 * size * rng.standard_normal(counts.shape)
    metadata = msgspec.structs.replace(METADATA, seed=seed)
    whole = counts.round().astype(np.int16)[:, None]
    return Recording(np.arange(len(slip)) * 0.01, whole, slip, None, "", metadata)


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"CONTROLS": 2, "KERNELS": 60, "RESAMPLES": 50}.items():
        monkeypatch.setattr(fingertip_realism, name, value)


@pytest.mark.parametrize("state", ["rest", "slip"])
def test_equal_distributions_are_not_separated_and_different_ones_are(state: str) -> None:
    made = [(k, recording(k)) for k in range(16)]
    pieces = [(k, windows_of(r.counts[:, 0], r.slip, state)) for k, r in made]
    task = Task("", "", "", state, 0)
    alike, other = (
        separate(windows_of(r.counts[:, 0], r.slip, state), pieces, task)
        for r in (recording(99), recording(99, 40.0, 4))
    )
    assert alike.auc < 0.75
    assert alike.low <= alike.auc <= alike.high
    assert max(other.control) < 0.85 < other.auc
    assert other.rank == 100.0


def test_a_small_set_gives_table_and_chart(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    write(tmp_path / "real.npz", recording(99))
    folder = tmp_path / "set"
    folder.mkdir()
    for k in range(5):
        write(folder / f"{k}.npz", recording(k))
    words = ["--recording", str(tmp_path / "real.npz"), "--data", str(folder), "--jobs", "1"]
    main("fingertip_realism", STUDY, [*words, "--out", str(tmp_path / "out")])
    assert "| all | slip | " in (tmp_path / "out" / "table.md").read_text()
    assert (tmp_path / "out" / "chart.svg").exists()
