"""`grasp calibrate fingertip`: what it writes and what it leaves alone."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from detector.recordings import Metadata, Recording, write
from grasp.cli import exits, fingertip
from grasp.cli.main import main
from scenarios.acquire import fingertip_fit

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


def test_judgement_for_a_person_leaves_out_the_ratio_to_a_figure_that_is_nought(
    clip: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    row = {"simulated": 0.2, "low": 0.1, "high": 0.3, "within_aim": True}
    rows = [SimpleNamespace(name="kurtosis", real=0.4, **row),
            SimpleNamespace(name="hiss", real=0.0, **row)]  # fmt: skip
    for name, found in {"figures": None, "mean": None, "misfit": 1.5, "compare": rows}.items():
        monkeypatch.setattr(fingertip_fit, name, lambda *_, found=found: found)
    assert main([*CHECK, "--recording", str(clip)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("ratio") and lines[1].split()[-1] == "0.50"
    assert lines[2].split() == ["hiss", "0", "0.2", "0.1", "0.3"]
    assert {len(line) for line in lines[:3]} == {len(lines[0])}
    assert "misfit 1.50 (1: on average just within the aims)" in lines


def test_nothing_but_a_fit_of_its_own_is_written_over(
    clip: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = clip.read_bytes()
    assert main(["calibrate", "fingertip", "--recording", str(clip), "--out", str(clip)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert clip.read_bytes() == before


def test_check_that_is_to_write_fitted_values_is_refused(clip: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.toml"
    assert main([*CHECK, "--recording", str(clip), "--out", str(out)]) == 2
    assert not out.exists()


@pytest.mark.parametrize("error", [
    RuntimeError("cannot cache function 'f': no locator available for file 'laws.py'"), EOFError(),
])  # fmt: skip
def test_compiled_functions_that_can_be_kept_nowhere_are_told_with_what_to_do(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = "/usr/lib/python3/site-packages/numba/core/caching.py"
    scope: dict[str, Any] = {"error": error}
    exec(compile("def fails(args): raise error", file, "exec"), scope)
    monkeypatch.setattr(fingertip, "calibrate", scope["fails"])
    assert main([*CHECK, "--recording", "clip.csv"]) == exits.USAGE
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err
