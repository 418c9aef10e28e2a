"""From a finished training to its weights file: calibrated, described, written whole."""

import math
from pathlib import Path

import numpy as np

from detector.evaluation import Streamed
from detector.network_file import FORMAT, Mode, NetworkCard
from detector.recordings import Recording
from detector.training.architecture import WINDOW
from detector.training.fit import Training
from detector.training.graph import make_model
from detector.training.networks import parameter_count
from detector.training.validation import likelihood, odds_of, temperature

THRESHOLD = 0.5  # of a calibrated probability: the likelier class


def export(training: Training, validation: list[Recording], path: Path, commit: str) -> NetworkCard:
    """Fit the temperature on validation, write ``path``, give the card."""
    odds = odds_of(training.network, training.arch, validation)
    z = np.concatenate([(o + training.shift).ravel() for o in odds])
    y = np.concatenate([
        np.repeat(Streamed(r, o, np.empty(0), training.settings.label).labels, r.fingers)
        for r, o in zip(validation, odds, strict=True)
    ])  # fmt: skip
    cooled = temperature(z, y)
    figures = {"loss": likelihood(z / cooled, y), "accuracy": float(((z > 0) == y).mean())}
    if training.best is not None and math.isfinite(training.best.delay_ms):
        figures["mean_delay_ms_within_budget"] = training.best.delay_ms
    mode: Mode = "stream" if training.arch.streaming else "window"
    memory = training.arch.receptive_field if training.arch.family == "tcn" else 0
    card = NetworkCard(
        format=FORMAT, name=training.name, mode=mode,
        window=memory if mode == "stream" else WINDOW, threshold=THRESHOLD,
        parameters=parameter_count(training.network),
        mean_counts=training.statistics.mean, std_counts=training.statistics.std,
        change_scale_counts=training.statistics.change_scale,
        temperature=cooled, shift=training.shift, data_digest=training.data_digest,
        label=training.settings.label, augmentation=training.settings.augmentation,
        balance=training.settings.balance, seed=training.settings.seed, commit=commit,
        steps=training.step, training_minutes=round(training.minutes, 2),
        validation=figures,
    )  # fmt: skip
    weights = {k: v.numpy() for k, v in training.network.state_dict().items()}
    partial = path.with_name(f".{path.name}")
    partial.write_bytes(make_model(training.arch, mode, weights, card))
    partial.replace(path)
    return card
