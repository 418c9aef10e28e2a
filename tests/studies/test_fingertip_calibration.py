"""The calibration of the fingertip: the search gets nearer, and its result is a settings file."""

from pathlib import Path

import numpy as np
import pytest

from detector.recordings import Metadata, Recording, read_csv, write
from scenarios.acquire.config import with_values
from scenarios.campaign.config import load_config
from studies import fingertip_calibration as calibration
from studies.fingertip_calibration import BOUNDS, STUDY, VALIDATION_SEED, Setup, Task

REAL = Path(__file__).parents[3] / "shared" / "data" / "takktile_felt.csv"
METADATA = Metadata(
    set="slide", split="train", surface="planar", motion="primary", speed_mps=0.05,
    spin_radps=0.0, direction="0", seed=1,
)  # fmt: skip


HIDDEN = with_values(Setup(), {"fingertip.depth_mm": 5.0, "strokes.texture_rms_mm": 0.12})


def test_search_reduces_the_misfit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "ROUNDS", ((3, 8, 3), (1, 4, 4)))
    real = calibration.mean(calibration.recording_statistics(HIDDEN, 4, 7))
    middle = 0.5 * np.log(np.array(list(BOUNDS.values()))).sum(axis=1)
    before, after = (
        calibration.misfit(real, calibration.mean(calibration.recording_statistics(setup, 6, 7)))
        for setup in (calibration.setup_at(middle), calibration.fit(real, 0))
    )
    assert after < 0.9 * before


def test_table_ends_with_a_settings_file(tmp_path: Path) -> None:
    t_s, counts, slip = calibration.simulate(HIDDEN, 1, 7)
    write(tmp_path / "real.npz", Recording(t_s, counts[0][:, None], slip, None, "", METADATA))
    row = STUDY.trial(Task(str(tmp_path / "real.npz"), check=True, simulations=2, seed=0))
    settings = STUDY.table([row]).split("```toml\n")[1].split("```")[0]
    (tmp_path / "mine.toml").write_text(settings.replace("depth_mm = 3.15", "depth_mm = 5.5"))
    config = load_config("can", "simulated", "energy", tmp_path / "mine.toml")
    assert config.fingertip.depth_mm == 5.5
    assert "# strokes: skew = 2.49" in settings


@pytest.mark.skipif(not REAL.exists(), reason="the authors' recording is not distributed")
def test_built_in_fingertip_separates_slip_and_rest_like_the_real_recording() -> None:
    recording = read_csv(REAL)
    real = calibration.signal_statistics(recording.t_s, recording.counts[:, 0], recording.slip)
    assert real["AUC of energy"] == pytest.approx(0.906, abs=0.002)
    simulated = calibration.mean(calibration.recording_statistics(Setup(), 48, VALIDATION_SEED))
    assert simulated["AUC of energy"] == pytest.approx(real["AUC of energy"], abs=0.03)
    assert calibration.misfit(real, simulated) < 1.0
