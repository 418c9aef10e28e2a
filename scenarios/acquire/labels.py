"""From the samples of a session to a recording with the paper's labels (section III-B), and how far
what is touched has moved against the fingertips since it last rested."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from detector.recordings import MAX_MISSED, Metadata, Recording, missed_samples
from drivers.interfaces import ArmState
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import PressPhase
from scenarios.acquire.session import Sample
from scenarios.world.settings import GROSS_SLIP_MPS, GROSS_TURN_RADPS

UNTOUCHED = (PressPhase.APPROACH, PressPhase.OFF)
LEAST_SAMPLES = 2  # of a recording
# It rests while it has stayed within REST_M for REST_S: 0.7 mm/s of creep is rest, the 3 mm/s of
# the label `slip` are not. Elastic motion of the pads counts, there and back; what stands still
# somewhere else is at rest again.
REST_M, REST_S = 0.0001, 0.15
TURN_LEVER_M = GROSS_SLIP_MPS / GROSS_TURN_RADPS  # a rotation counts as slip by the paper's label
MOST_AGES = 64  # samples within REST_S, at the quickest rate there is
Floats = NDArray[np.float64]


def parts_of(samples: Sequence[Sample]) -> list[Sequence[Sample]]:
    """A session's samples, cut where more in a row are missing than a recording may lack; what is
    too short for a recording is left out."""
    times = np.array([sample.t_ns * 1e-9 for sample in samples])
    ends = np.flatnonzero(missed_samples(times) > MAX_MISSED) + 1
    edges = [0, *ends.tolist(), len(samples)]
    parts = [samples[first:end] for first, end in pairwise(edges)]
    return [part for part in parts if len(part) >= LEAST_SAMPLES]


def recording(
    samples: Sequence[Sample], config: AcquireConfig, metadata: Metadata, source: str
) -> Recording:
    """Labelled frames of the pressed fingertip."""
    velocity = np.array([_on_fingertip(sample.arm, config) for sample in samples])
    spin = np.array([sample.arm.spin_radps for sample in samples])
    truth = [sample.truth for sample in samples if sample.truth is not None]
    true: dict[str, NDArray[Any]] = {}
    if len(truth) == len(samples):
        speed = np.array([t.contact_speed_mps for t in truth])
        turn = np.array([t.contact_turn_radps for t in truth])
        true = {
            "slip_true": slip_label(speed, turn), "contact_speed_mps": speed.astype(np.float32),
            "contact_turn_radps": turn.astype(np.float32),
        }  # fmt: skip
    t_s = np.array([(sample.t_ns - samples[0].t_ns) * 1e-9 for sample in samples])
    touched = np.array([sample.phase not in UNTOUCHED for sample in samples])
    return Recording(
        t_s=t_s, source=source, metadata=metadata,
        counts=np.stack([sample.frame.counts[config.finger] for sample in samples])[:, None, :],
        slip=slip_label(np.hypot(velocity[:, 0], velocity[:, 1]), abs(spin)),
        velocity_mps=velocity.astype(np.float32), spin_radps=spin.astype(np.float32),
        moved_m=moved(t_s, _places(samples), touched).astype(np.float32), **true,
    )  # fmt: skip


def _places(samples: Sequence[Sample]) -> Floats:
    """Where the fingertip is on what it presses, (n, 3), m: x, y, and how far it has turned."""
    return np.array([
        (*sample.arm.position_m[:2], TURN_LEVER_M * sample.arm.angle_rad) for sample in samples
    ])  # fmt: skip


def slip_label(speed_mps: Floats, turn_radps: Floats) -> NDArray[np.bool_]:
    """(n,) bool: faster than either bound (paper, section III-B)."""
    out: NDArray[np.bool_] = (speed_mps > GROSS_SLIP_MPS) | (turn_radps > GROSS_TURN_RADPS)
    return out


def _on_fingertip(arm: ArmState, config: AcquireConfig) -> tuple[float, float]:
    """The arm's velocity along x and y of the fingertip, m/s."""
    x, y = arm.velocity_mps[0], -arm.velocity_mps[1]
    angle = arm.angle_rad + math.radians(config.control.fingertip_x_deg)
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * y, -s * x + c * y


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
