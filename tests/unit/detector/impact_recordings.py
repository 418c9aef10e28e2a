"""Recordings of a hand with impacts listed in the metadata."""

import msgspec
import numpy as np

from detector.recordings import AppliedDisturbance, Recording
from tests.unit.detector.toy_recordings import toy

PERIOD_S = 0.01


def impact_recording(*impacts: tuple[float, float], n: int = 900, fingers: int = 3) -> Recording:
    """``impacts``: time, s, and lasting displacement, m, of each; motion starts 30 ms after the
    impact and lasts 20 ms."""
    alone = toy(1, "validation", n)
    assert alone.metadata is not None
    slides = np.zeros(n, bool)
    disturbances = []
    for t_s, moved_m in impacts:
        first = round(t_s / PERIOD_S) + 3
        slides[first : first + 2] = moved_m > 0.0
        disturbances.append(
            AppliedDisturbance(t_s=t_s - 0.001, kind="near", direction="top", moved_m=moved_m)
        )
    metadata = msgspec.structs.replace(
        alone.metadata, set="disturbances", disturbances=tuple(disturbances)
    )
    return msgspec.structs.replace(
        alone, counts=np.repeat(alone.counts, fingers, axis=1), slip=slides & False,
        slip_true=slides, metadata=metadata,
    )  # fmt: skip
