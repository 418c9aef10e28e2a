"""Artificial recordings: strong coloured noise as slip, weak noise as rest."""

import numpy as np

from detector.recordings import Metadata, Recording, Split


def toy(seed: int, split: Split, n: int = 900, loudness: float = 8.0) -> Recording:
    """One finger with three loaded taxels, strokes of half a second."""
    rng = np.random.default_rng(seed)
    slip = np.zeros(n, bool)
    at = int(rng.integers(110, 160))
    while at < n:
        slip[at : at + 50] = True
        at += 50 + int(rng.integers(60, 160))
    wander = np.cumsum(rng.normal(0, 1, (n, 6)) * np.where(slip, loudness, 1.0)[:, None], axis=0)
    base = np.array([-300, -200, -100, 0, 0, 0]) + rng.normal(0, 30, 6)
    loaded = np.array([1, 1, 1, 0.05, 0.05, 0.05])
    counts = np.clip(np.rint(base + wander * loaded + rng.normal(0, 0.6, (n, 6))), -500, 200)
    metadata = Metadata(
        set="slide", split=split, surface="planar", motion="primary", speed_mps=0.05,
        spin_radps=0.0, direction="0", seed=seed,
    )  # fmt: skip
    return Recording(
        np.arange(n) * 0.01, counts.astype(np.int16)[:, None, :], slip, slip, f"toy {seed}",
        metadata,
    )  # fmt: skip


def toys(split: Split, how_many: int, first: int) -> list[Recording]:
    return [toy(first + i, split) for i in range(how_many)]
