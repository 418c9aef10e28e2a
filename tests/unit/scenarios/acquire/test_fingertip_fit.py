"""The fit of the fingertip: strokes like a recording's, comparison, search, and what it writes."""

from pathlib import Path

import numpy as np
import pytest

from detector.recordings import read_csv
from scenarios.acquire import fingertip_fit as fitting
from scenarios.acquire import strokes
from scenarios.acquire.fingertip_fit import FitSetup, Search
from scenarios.acquire.signal_statistics import signal_statistics
from scenarios.acquire.strokes import StrokeSettings
from scenarios.campaign.config import load_config
from scenarios.world.settings import GROSS_SLIP_MPS

FELT = Path(__file__).parents[5] / "shared" / "data" / "takktile_felt.csv"


def test_strokes_go_there_and_back_and_last_as_long_as_asked() -> None:
    s = StrokeSettings()
    t, speed = strokes.stroke_speeds(s)
    slip = np.abs(speed) > GROSS_SLIP_MPS
    starts = np.flatnonzero(slip[1:] & ~slip[:-1])
    ends = np.flatnonzero(~slip[1:] & slip[:-1])
    assert len(starts) == s.strokes
    assert (t[ends] - t[starts]) == pytest.approx(s.stroke_s, abs=0.021)
    assert (t[starts[1:]] - t[ends[:-1]]) == pytest.approx(s.pause_s, abs=0.021)
    assert np.abs(speed).max() == pytest.approx(s.peak_mps, rel=0.01)
    assert abs(speed.sum() * 0.01) < 1e-3  # metres from the start, after an even number


def test_search_ends_nearer_to_the_recording_than_it_began() -> None:
    hidden = FitSetup().changed({"fingertip.depth_mm": 5.0, "strokes.texture_rms_mm": 0.12})
    real = fitting.mean(fitting.figures(hidden, 4, 7))
    told = []
    search = Search(
        wide_rounds=3, wide_tries=8, wide_clips=3, close_rounds=1, close_tries=4, close_clips=4
    )
    found, values = fitting.fit(real, FitSetup(), search, lambda *told_now: told.append(told_now))
    middles = np.array([0.5 * np.log(p.low * p.high) for p in fitting.PARAMETERS])
    began = FitSetup().changed(fitting.named(middles))
    before, after = (
        fitting.misfit(real, fitting.mean(fitting.figures(s, 6, 7))) for s in (began, found)
    )
    assert after < 0.9 * before
    assert told[-1][:2] == (28, 28)
    assert len(values) == len(fitting.PARAMETERS)


def test_fitted_values_are_a_settings_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(fitting.as_toml({"fingertip.depth_mm": 5.5, "strokes.skew": 3.0}, "x.csv"))
    config = load_config("can", "simulated", "energy", file)
    assert config.fingertip.depth_mm == 5.5
    assert "skew" in file.read_text()


@pytest.mark.skipif(not FELT.exists(), reason="the authors' clip is not distributed")
def test_built_in_fingertip_contrasts_slip_and_rest_like_the_authors_clip() -> None:
    felt = read_csv(FELT)
    real = signal_statistics(felt.t_s, felt.counts[:, 0], felt.slip)
    assert real["AUC of energy"] == pytest.approx(0.906, abs=0.002)
    simulated = fitting.mean(fitting.figures(FitSetup(), 48, fitting.JUDGE_SEED))
    assert simulated["AUC of energy"] == pytest.approx(real["AUC of energy"], abs=0.03)
    assert fitting.misfit(real, simulated) < 1.0
