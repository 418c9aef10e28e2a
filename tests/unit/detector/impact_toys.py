"""Recordings of a hand that is struck: what each impact moved is in the metadata."""

import msgspec
import numpy as np

from detector.recordings import Act, Recording
from tests.unit.detector.toys import toy

PERIOD_S = 0.01


def struck(*impacts: tuple[float, float], n: int = 900, fingers: int = 3) -> Recording:
    """``impacts``: when, s, and how far each moves what is held, m; motion begins 30 ms later, and
    lasts for 20 ms."""
    alone = toy(1, "validation", n)
    assert alone.metadata is not None
    slides = np.zeros(n, bool)
    acts = []
    for t_s, moved_m in impacts:
        first = round(t_s / PERIOD_S) + 3
        slides[first : first + 2] = moved_m > 0.0
        acts.append(Act(t_s=t_s - 0.001, kind="near", direction="top", moved_m=moved_m))
    metadata = msgspec.structs.replace(alone.metadata, set="disturbances", acts=tuple(acts))
    return msgspec.structs.replace(
        alone, counts=np.repeat(alone.counts, fingers, axis=1), slip=slides & False,
        slip_true=slides, metadata=metadata,
    )  # fmt: skip
