"""How good a network is on recordings it has not learnt from: events first, then likelihood."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from detector.decision import RuleSettings
from detector.recordings import MOVED_M, LabelName, Recording
from detector.scores.evaluation import Streamed
from detector.scores.sweep import MISS_MS, best, rules, sweep
from detector.training.architecture import Architecture
from detector.training.score import Score

WINDOWS_AT_ONCE = 512
BUDGETS = (0.5, 1.0, 2.0, 4.0)  # parts of the one asked for
NEWTON_STEPS, RIDGE, LEAST_SLOPE = 25, 1e-6, 0.05


def odds_of(
    network: nn.Module, arch: Architecture, recordings: Sequence[Recording]
) -> list[NDArray[np.float64]]:
    """Log-odds (n, fingers) of whole recordings, each from a reset, as the runtime streams them."""
    network.eval()
    found = []
    with torch.inference_mode():
        for recording in recordings:
            counts = torch.from_numpy(recording.counts.astype(np.float32)).permute(1, 0, 2)
            odds = network(counts) if arch.streaming else _windowed(network, counts, arch.window)
            found.append(odds.T.double().numpy())
    network.train()
    return found


def _windowed(network: nn.Module, counts: torch.Tensor, window: int) -> torch.Tensor:
    """(fingers, n) from (fingers, n, 6); the first frame stands for those before it."""
    before = counts[:, :1].expand(-1, window - 1, -1)
    windows = torch.cat([before, counts], dim=1).unfold(1, window, 1).transpose(2, 3)
    flat = windows.reshape(-1, window, windows.shape[3])
    parts = [network(part, last=True)[:, 0] for part in flat.split(WINDOWS_AT_ONCE)]
    return torch.cat(parts).reshape(len(counts), -1)


def score(
    odds: Sequence[NDArray[np.float64]],
    recordings: Sequence[Recording],
    label: LabelName,
    shift: float,
    budget_per_min: float,
    moved_m: float = MOVED_M,
) -> Score:
    """Events of the quickest rules within the budgets, likelihood and accuracy of the samples."""
    streams = [
        Streamed(r, 1.0 / (1.0 + np.exp(-(o + shift))), np.empty(0), label, moved_m)
        for r, o in zip(recordings, odds, strict=True)
    ]
    # the fingers of a hand together, as it is learnt
    wanted = ("consecutive", "mean", 2, RuleSettings().release)
    tried = [
        r for r in rules(RuleSettings()) if (r.kind, r.fusion, r.consecutive, r.release) == wanted
    ]
    points = sweep(streams, tried)
    chosen = [best(points, part * budget_per_min) for part in BUDGETS]
    delays = [point.mean_delay_ms if point else MISS_MS for point in chosen]
    z = np.concatenate([o.mean(axis=1) + shift for o in odds])
    y = np.concatenate([s.labels for s in streams])
    return Score(
        delay_ms=float(np.mean(delays)),
        loss=likelihood(z, y),
        accuracy=float(((z > 0) == y).mean()),
    )


def likelihood(odds: NDArray[np.float64], labels: NDArray[np.bool_]) -> float:
    """Mean negative log-likelihood of labels (n,) under log-odds (n,)."""
    return float(np.logaddexp(0.0, np.where(labels, -odds, odds)).mean())


def calibration(odds: NDArray[np.float64], labels: NDArray[np.bool_]) -> tuple[float, float]:
    """Temperature and shift that make the labels likeliest: (odds + shift) / temperature.

    Platt 1999, by Newton's method. The shift carries the share of slip among these labels, which
    training on weighed classes has taken away.
    """
    x = np.column_stack([odds, np.ones_like(odds)])
    w = np.zeros(2)
    for _ in range(NEWTON_STEPS):
        p = 0.5 * (1.0 + np.tanh(x @ w / 2.0))
        curvature = (x * (p * (1.0 - p))[:, None]).T @ x + RIDGE * np.eye(2)
        w -= np.linalg.solve(curvature, x.T @ (p - labels))
    slope = max(float(w[0]), LEAST_SLOPE)
    return 1.0 / slope, float(w[1]) / slope
