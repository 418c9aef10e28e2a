"""How far what is touched has moved against the fingertips since it last rested.

It rests while it has stayed within ``REST_M`` of where it is for ``REST_S``: 0.7 mm/s of creep is
rest, the 3 mm/s of the label `slip` are not. Elastic motion of the pads counts, there and back;
what stands still somewhere else is at rest again.
"""

import numpy as np
from numpy.typing import NDArray

from scenarios.world.contact_settings import GROSS_SLIP_MPS, GROSS_TURN_RADPS

REST_M = 0.0001
REST_S = 0.15
TURN_LEVER_M = GROSS_SLIP_MPS / GROSS_TURN_RADPS  # a rotation counts as slip by the paper's label
MOST_AGES = 64  # samples within REST_S, at the quickest rate there is

Floats = NDArray[np.float64]


def moved(t_s: Floats, places_m: Floats, touched: NDArray[np.bool_]) -> Floats:
    """(n,) m from where it last rested. places_m (n, d): where it is, turns by TURN_LEVER_M; what
    is not touched rests wherever it is, and so does whatever a recording begins with."""
    rests = _rests(t_s, places_m) | ~touched
    rests[0] = True
    last = np.maximum.accumulate(np.where(rests, np.arange(len(t_s)), 0))
    return _lengths(places_m - places_m[last])


def _rests(t_s: Floats, places_m: Floats) -> NDArray[np.bool_]:
    """(n,) has it stayed within REST_M for REST_S, or since the recording began?"""
    furthest = np.zeros(len(t_s))
    for age in range(1, min(MOST_AGES, len(t_s))):
        recent = t_s[age:] - t_s[:-age] <= REST_S
        if not recent.any():
            break
        way = _lengths(places_m[age:] - places_m[:-age])
        furthest[age:] = np.maximum(furthest[age:], np.where(recent, way, 0.0))
    return furthest <= REST_M


def _lengths(vectors: Floats) -> Floats:
    out: Floats = np.sqrt((vectors**2).sum(axis=1))
    return out
