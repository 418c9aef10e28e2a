"""Acquisition through real protocols: a cell in another process, ur_rtde and USB transfers."""

from pathlib import Path

import numpy as np
import pytest

from detector.recordings import read
from scenarios import acquire
from scenarios.acquisition.config import load_acquire_config
from scenarios.acquisition.press import motion

pytest.importorskip("rtde_control")

# a busy machine must not end the session: it stands still for longer than a laboratory's would
PATIENT = ("tactile.stale_after_missed=20", "arm.stale_after_s=1.0", "ur.heartbeat_timeout_s=2.0",
           "ur.watchdog_hz=1.0", "arm.drive_timeout_s=0.2")  # fmt: skip


@pytest.mark.timeout(180)
@pytest.mark.parametrize("direction", ["45", "ccw"])
def test_an_acquisition_on_the_emulated_rig_holds_its_force_and_labels_its_strokes(
    tmp_path: Path, direction: str
) -> None:
    config = load_acquire_config("planar", "emulated", None, PATIENT)
    finished = acquire.run(
        config, motion(direction, 0.05, 1.0), 0, 5.0, tmp_path, False, lambda tick: None
    )
    r = read(finished.recording)
    assert len(r.t_s) == 500
    assert finished.force_mean_n == pytest.approx(5.0, rel=0.2)
    assert 0.1 < r.slip.mean() < 0.9
    assert r.slip_true is not None
    assert r.slip_true.any()
    assert r.velocity_mps is not None
    assert r.spin_radps is not None
    if direction == "45":
        moving = r.velocity_mps[r.slip]
        assert np.median(moving[:, 0] / moving[:, 1]) == pytest.approx(1.0, abs=0.1)
    else:
        assert abs(r.spin_radps).max() == pytest.approx(1.0, abs=0.1)
