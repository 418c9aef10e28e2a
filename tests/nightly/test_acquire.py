"""Acquisition through real protocols: a cell in another process, ur_rtde and USB transfers."""

from pathlib import Path

import numpy as np
import pytest

from detector.recordings import read
from drivers.ur import driver
from scenarios.acquire import acquire
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.press import motion

pytest.importorskip("rtde_control")


@pytest.mark.timeout(180)
@pytest.mark.parametrize("direction", ["45", "ccw"])
def test_an_acquisition_on_the_emulated_rig_holds_its_force_and_labels_its_strokes(
    tmp_path: Path, direction: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "DRIVE_TIMEOUT_S", 0.2)  # a busy machine renews a drive late
    config = load_acquire_config("planar", "emulated", None, ())
    finished = acquire.run(
        config, motion(direction, 0.05, 1.0), 0, 5.0, tmp_path, False, lambda tick: None
    )
    parts = [read(path) for path in finished.recordings]  # several where the machine stood still
    slip = np.concatenate([r.slip for r in parts])
    assert len(slip) == finished.samples == 500
    assert finished.failure is None
    assert finished.force_mean_n == pytest.approx(5.0, rel=0.2)
    assert 0.1 < slip.mean() < 0.9
    assert all(r.slip_true is not None for r in parts)
    assert finished.slip_true
    velocity = np.concatenate([r.velocity_mps for r in parts if r.velocity_mps is not None])
    spin = np.concatenate([r.spin_radps for r in parts if r.spin_radps is not None])
    if direction == "45":
        moving = velocity[slip]
        assert np.median(moving[:, 0] / moving[:, 1]) == pytest.approx(1.0, abs=0.1)
    else:
        assert abs(spin).max() == pytest.approx(1.0, abs=0.1)
