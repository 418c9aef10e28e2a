"""From the samples of a session to a recording with the paper's labels (section III-B)."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from detector.recordings import MAX_MISSED, Metadata, Recording, missed_samples
from drivers.interfaces import ArmState
from scenarios.acquire.config import AcquireConfig, SamplingSettings
from scenarios.acquire.press import PressPhase
from scenarios.acquire.rest import TURN_LEVER_M, moved
from scenarios.acquire.session import Sample

UNTOUCHED = (PressPhase.APPROACH, PressPhase.OFF)
LEAST_SAMPLES = 2  # of a recording


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
    speed, turn, slides = None, None, None
    if len(truth) == len(samples):
        speed = np.array([t.contact_speed_mps for t in truth])
        turn = np.array([t.contact_turn_radps for t in truth])
        slides = slip_label(speed, turn, config.sampling)
    t_s = np.array([(sample.t_ns - samples[0].t_ns) * 1e-9 for sample in samples])
    touched = np.array([sample.phase not in UNTOUCHED for sample in samples])
    return Recording(
        t_s=t_s,
        counts=np.stack([sample.frame.counts[config.finger] for sample in samples])[:, None, :],
        slip=slip_label(np.hypot(velocity[:, 0], velocity[:, 1]), abs(spin), config.sampling),
        slip_true=slides,
        source=source,
        metadata=metadata,
        contact_speed_mps=None if speed is None else speed.astype(np.float32),
        contact_turn_radps=None if turn is None else turn.astype(np.float32),
        velocity_mps=velocity.astype(np.float32),
        spin_radps=spin.astype(np.float32),
        moved_m=moved(t_s, _places(samples), touched).astype(np.float32),
    )


def _places(samples: Sequence[Sample]) -> NDArray[np.float64]:
    """Where the fingertip is on what it presses, (n, 3), m: x, y, and how far it has turned."""
    return np.array([
        (*sample.arm.position_m[:2], TURN_LEVER_M * sample.arm.angle_rad) for sample in samples
    ])  # fmt: skip


def slip_label(
    speed_mps: NDArray[np.float64], turn_radps: NDArray[np.float64], sampling: SamplingSettings
) -> NDArray[np.bool_]:
    """(n,) bool: faster than either bound (paper, section III-B)."""
    out: NDArray[np.bool_] = (speed_mps > sampling.slip_mps) | (turn_radps > sampling.slip_radps)
    return out


def _on_fingertip(arm: ArmState, config: AcquireConfig) -> tuple[float, float]:
    """The arm's velocity along x and y of the fingertip, m/s."""
    x, y = arm.velocity_mps[0], -arm.velocity_mps[1]
    angle = arm.angle_rad + math.radians(config.control.fingertip_x_deg)
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * y, -s * x + c * y
