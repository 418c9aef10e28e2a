"""Variants of the paper's network: equal budgets, one difference each, a tiny grid."""

from pathlib import Path

import pytest

from detector.network_file import read_network
from detector.recordings import write
from studies import network_variants as study
from studies.runner import main
from tests.unit.detector.toy_recordings import toys


def test_every_window_has_the_same_budget_of_samples() -> None:
    for window in (10, 50, 100):
        s = study.settings_of(study.Variant(window), 100, 0)
        assert s.batch * (s.warm + s.crop) == study.SAMPLES_PER_STEP
        assert s.warm + s.crop == s.window == window


@pytest.mark.train
def test_variants_are_trained_scored_and_plotted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    for recording in [*toys("train", 3, 0), *toys("validation", 2, 20), *toys("test", 2, 40)]:
        write(tmp_path / f"{recording.source}.npz", recording)
    out = tmp_path / "out"
    words = ["--data", str(tmp_path), "--variants", "window-10", "no-layer-norm", "--steps", "2",
             "--seeds", "1", "--jobs", "1", "--out", str(out)]  # fmt: skip
    assert main("network_variants", study.STUDY, words) == 0
    assert "| window-10 | 0 | 0.0 |" in capsys.readouterr().out
    assert read_network(out / "window-10-0.onnx").card.window == 10
    bare = read_network(out / "no-layer-norm-0.onnx").card
    assert bare.parameters == 10_070 - 8 * 24 - 2 * 48
    assert (out / "chart.svg").exists()
