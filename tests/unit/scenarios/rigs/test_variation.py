"""Trials vary with the stated distributions."""

import numpy as np
import pytest

from drivers.errors import ConfigError
from scenarios.rigs.config import VariationSettings
from scenarios.rigs.simulated import TrialSample, sample_trial
from tests.unit.scenarios.conftest import config

MANY = 2000


def samples(settings: VariationSettings, n: int = MANY) -> list[TrialSample]:
    c = config()
    return [sample_trial(settings, c.object, c.hand, np.random.default_rng(k)) for k in range(n)]


def test_every_variation_has_the_spread_that_its_setting_states() -> None:
    c = config()
    s = VariationSettings()
    trials = samples(s)
    spreads = {
        "friction": (np.std([t.body.friction_static / c.object.friction_static for t in trials]),
                     s.friction_cv),
        "mass": (np.std([t.body.mass_kg / c.object.mass_kg for t in trials]), s.mass_cv),
        "height": (np.std([t.body.grip_height_m for t in trials]), s.start_height_m),
        "finger": (np.std([t.finger_offset_m for t in trials]), s.finger_scatter_m),
    }  # fmt: skip
    for name, (found, stated) in spreads.items():
        assert found == pytest.approx(stated, rel=0.08), name
    latency = [t.hand.command_latency_s - c.hand.command_latency_s for t in trials]
    assert min(latency) >= 0.0 and max(latency) <= s.command_latency_s
    assert np.mean(latency) == pytest.approx(s.command_latency_s / 2, rel=0.08)
    force = [t.hand.least_force_n for t in trials]
    assert 10.0 * (1 - s.force_stop_fraction) <= min(force) < max(force) <= 10.0
    assert np.std([t.hand.tick_phase_s for t in trials]) > 0.002


def test_sampled_mass_and_friction_are_positive() -> None:
    with pytest.raises(ConfigError, match="mass_cv"):
        config("variation.mass_cv=0.5")
    widest = config("variation.mass_cv=0.3", "variation.friction_cv=0.3").variation
    for trial in samples(widest, 400):
        assert min(trial.body.mass_kg, trial.body.friction_kinetic) > 0.0
