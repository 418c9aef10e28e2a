"""Recordings with the paper's labels (section III-B) from the samples of a session, and the
displacement of the touched object since it was last at rest."""

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
MIN_SAMPLES = 2  # of a recording
# An object is at rest if it stayed within REST_M for REST_S: creep of 0.7 mm/s is rest, the 3 mm/s
# of the label `slip` are not. Elastic motion of the pads counts as motion.
REST_M, REST_S = 0.0001, 0.15
TURN_LEVER_M = GROSS_SLIP_MPS / GROSS_TURN_RADPS  # from radians to metres, by the paper's label
MAX_AGE = 64  # samples within REST_S, at the highest sample rate
Floats = NDArray[np.float64]


def split_at_gaps(samples: Sequence[Sample]) -> list[Sequence[Sample]]:
    """The samples of a session, split where too many are missing for one recording; parts that are
    too short are left out."""
    times = np.array([sample.t_ns * 1e-9 for sample in samples])
    ends = np.flatnonzero(missed_samples(times) > MAX_MISSED) + 1
    edges = [0, *ends.tolist(), len(samples)]
    parts = [samples[first:end] for first, end in pairwise(edges)]
    return [part for part in parts if len(part) >= MIN_SAMPLES]


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
        moved_m=distance_moved(t_s, _positions(samples), touched).astype(np.float32),
        labelled=True, **true,
    )  # fmt: skip


def _positions(samples: Sequence[Sample]) -> Floats:
    """Position of the fingertip on the surface (n, 3), m: x, y, and angle times TURN_LEVER_M."""
    return np.array([
        (*sample.arm.position_m[:2], TURN_LEVER_M * sample.arm.angle_rad) for sample in samples
    ])  # fmt: skip


def slip_label(speed_mps: Floats, turn_radps: Floats) -> NDArray[np.bool_]:
    """Label (n,): above the bound of speed or of rotation (paper, section III-B)."""
    label: NDArray[np.bool_] = (speed_mps > GROSS_SLIP_MPS) | (turn_radps > GROSS_TURN_RADPS)
    return label


def _on_fingertip(arm: ArmState, config: AcquireConfig) -> tuple[float, float]:
    """Velocity of the arm along x and y of the fingertip, m/s."""
    x, y = arm.velocity_mps[0], -arm.velocity_mps[1]
    angle = arm.angle_rad + math.radians(config.control.fingertip_x_deg)
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * y, -s * x + c * y


def distance_moved(t_s: Floats, positions_m: Floats, touched: NDArray[np.bool_]) -> Floats:
    """Distance (n,), m, from the last position at rest, from positions (n, d), angles times
    TURN_LEVER_M. The first sample, and samples without contact, count as rest."""
    rests = _at_rest(t_s, positions_m) | ~touched
    rests[0] = True
    last = np.maximum.accumulate(np.where(rests, np.arange(len(t_s)), 0))
    return _lengths(positions_m - positions_m[last])


def _at_rest(t_s: Floats, positions_m: Floats) -> NDArray[np.bool_]:
    """Samples (n,) at which the position stayed within REST_M for REST_S, or since the start."""
    furthest = np.zeros(len(t_s))
    for age in range(1, min(MAX_AGE, len(t_s))):
        recent = t_s[age:] - t_s[:-age] <= REST_S
        if not recent.any():
            break
        distance = _lengths(positions_m[age:] - positions_m[:-age])
        furthest[age:] = np.maximum(furthest[age:], np.where(recent, distance, 0.0))
    return furthest <= REST_M


def _lengths(vectors: Floats) -> Floats:
    lengths: Floats = np.sqrt((vectors**2).sum(axis=1))
    return lengths
