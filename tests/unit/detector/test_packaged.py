"""Packaged networks: they load, run, and have complete cards."""

import numpy as np
import pytest

from detector.loading import DETECTORS, load_detector, memory_of
from detector.network_file import packaged_networks, read_network, weights_path
from grasp.settings import names
from scenarios.campaign.config import load_config
from scenarios.trial.execution import patience_s


def test_every_packaged_detector_has_a_settings_file() -> None:
    assert set(names("detectors")) == set(DETECTORS)
    assert {"tcn", "gru", "tcn-paper"} <= set(packaged_networks())


def test_packaged_network_runs_with_three_fingers() -> None:
    for name in packaged_networks():
        card = read_network(weights_path(name)).card
        assert card.name == name, name
        assert card.data_digest, name
        assert weights_path(name).stat().st_size < 1_000_000, name
        detector = load_detector(name, {}, 3)
        p = [detector.update(np.zeros((3, 6), np.int16)) for _ in range(120)]
        assert np.all((np.array(p) >= 0) & (np.array(p) <= 1)), name


def counts(seed: int, samples: int) -> np.ndarray:
    """Counts of strong vibration (samples, 3, 6)."""
    return np.random.default_rng(seed).integers(-300, 100, (samples, 3, 6)).astype(np.int16)


def output_after(name: str, before: np.ndarray, same: np.ndarray) -> np.ndarray:
    detector = load_config("can", "simulated", name, None, ()).make_detector(3)
    for frame in before:
        detector.update(frame)
    for frame in same:
        output = detector.update(frame)
    return output


def test_output_depends_on_the_memory_only() -> None:
    pasts, same = (counts(1, 150), counts(2, 150) // 50), counts(3, 250) // 50
    for name in DETECTORS:
        memory = load_config("can", "simulated", name, None, ()).make_detector(3).memory
        if memory == 0:  # unbounded
            assert name not in {"tcn", "tcn-paper", "freq-cnn-paper"}
            continue
        one, other = (output_after(name, past, same[:memory]) for past in pasts)
        assert one == pytest.approx(other, abs=1e-5), name
        one, other = (output_after(name, past, same[: memory // 2]) for past in pasts)
        assert (one != other).all(), name


def test_patience_for_continued_slip_is_at_least_the_memory() -> None:
    for name in DETECTORS:
        for patience in [0.05, 2.0]:
            words = (f"controller.limit_patience_s={patience}",)
            config = load_config("can", "simulated", name, None, words).for_lift()
            memory_s = 0.01 * config.make_detector(3).memory
            assert patience_s(config) == max(patience, memory_s), (name, patience)


def test_memory_follows_the_window_that_was_set() -> None:
    config = load_config("can", "simulated", "energy", None, ("energy.window=30",))
    assert memory_of("energy", config.energy) == config.make_detector(3).memory == 31
