"""From a finished training to its weights file: calibrated, described, written whole."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from detector.network_file import FORMAT, Mode, NetworkCard, read_network
from detector.recordings import Recording
from detector.training.fit import Training
from detector.training.graph import make_model
from detector.training.networks import parameter_count
from detector.training.validation import calibration, likelihood, odds_of
from detector.training.whole import whole

THRESHOLD = 0.5  # of a calibrated probability: the likelier class


def export(training: Training, validation: list[Recording], path: Path, commit: str) -> NetworkCard:
    """Calibrate on validation, write ``path``, give the card as it is read there.

    Where there are recordings of the paper's kind, the probabilities are true of them: slip as
    common as there. A rule for rarer slip has a higher threshold, see `grasp detector tune`.
    """
    slides = [r for r in validation if r.metadata is None or r.metadata.set == "slide"]
    z, y = _samples(training, slides or validation)
    temperature, shift = calibration(z, y)
    calibrated = (z + shift) / temperature
    figures = {
        "loss": likelihood(calibrated, y),
        "accuracy": float(((calibrated > 0) == y).mean()),
    }
    if training.best is not None and math.isfinite(training.best.delay_ms):
        figures["mean_delay_ms_within_budget"] = training.best.delay_ms
    mode: Mode = "stream" if training.arch.streaming else "window"
    before = training.arch.memory - 1 if training.arch.family == "tcn" else 0
    card = NetworkCard(
        format=FORMAT, name=training.name, mode=mode,
        window=before if mode == "stream" else training.arch.window, threshold=THRESHOLD,
        parameters=parameter_count(training.network),
        mean_counts=training.statistics.mean, std_counts=training.statistics.std,
        change_scale_counts=training.statistics.change_scale,
        temperature=temperature, shift=shift, data_digest=training.data_digest,
        label=training.settings.label, augmentation=training.settings.augmentation,
        balance=training.settings.balance, seed=training.settings.seed, commit=commit,
        steps=training.step, training_minutes=round(training.minutes, 2),
        validation=figures,
    )  # fmt: skip
    weights = {k: v.numpy() for k, v in training.network.state_dict().items()}
    with whole(path) as partial:
        partial.write_bytes(make_model(training.arch, mode, weights, card))
    return read_network(path).card


def _samples(
    training: Training, recordings: list[Recording]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Log-odds and labels (n,) of all samples of all fingers."""
    odds = odds_of(training.network, training.arch, recordings)
    labels = [
        np.repeat(r.label(training.settings.label, training.settings.moved_m), r.fingers)
        for r in recordings
    ]
    return np.concatenate([o.ravel() for o in odds]), np.concatenate(labels)
