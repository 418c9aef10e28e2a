"""How a fingertip truly moved over what it touched: what heads learn, and are judged by.

Motion is the mean of the last 50 ms, for a sample is a few milliseconds old and a blow is over
within two of them. A turn counts by the lever of the paper's label (3 mm/s over 0.2 rad/s).
"""

import math

import numpy as np
from numpy.typing import NDArray

from detector.motion import SECTORS
from detector.recordings import Recording

Floats = NDArray[np.float64]
SPAN = 5  # samples that a motion is the mean of
TURN_LEVER_M = 0.003 / 0.2
UPWARDS = "fingertip.slip_direction_deg"  # of a recording's parameters
HAND_FINGERS = 3


def motion_of(recording: Recording) -> Floats | None:
    """Truth (n, fingers, 3): velocity along x and y of each fingertip, and its spin times the
    lever, m/s, mean of the last SPAN samples; zeros in the first few.

    The recorded velocity is the thumb's; the other two face it, and theirs is mirrored at the line
    that is upwards. None where the recording has no velocity, or does not say which way is up.
    """
    if recording.velocity_mps is None or recording.spin_radps is None:
        return None
    each = np.column_stack([recording.velocity_mps, TURN_LEVER_M * recording.spin_radps])
    sums = np.cumsum(each.astype(np.float64), axis=0)
    thumb = np.zeros_like(sums)
    thumb[SPAN:] = (sums[SPAN:] - sums[:-SPAN]) / SPAN
    if recording.fingers == 1:
        return thumb[:, None]
    known = recording.metadata.parameters if recording.metadata else {}
    if UPWARDS not in known or recording.fingers != HAND_FINGERS:
        return None
    mirrored = opposed(thumb, math.radians(known[UPWARDS]))
    return np.stack([thumb, mirrored, mirrored], axis=1)


def left_behind(recording: Recording) -> int:
    """Which of eight directions all fingertips slide over an object that goes straight down; -1
    where the recording does not say which way is up."""
    known = recording.metadata.parameters if recording.metadata else {}
    if recording.fingers != HAND_FINGERS or UPWARDS not in known:
        return -1
    up = math.radians(known[UPWARDS])
    return int(sector_of(np.array([math.cos(up), math.sin(up), 0.0])))


def opposed(motion: Floats, up_rad: float) -> Floats:
    """Motion (n, 3) of a fingertip as one that faces it has it."""
    up = np.array([math.cos(up_rad), math.sin(up_rad)])
    along = motion[:, :2] @ up
    return np.column_stack([2.0 * np.outer(along, up) - motion[:, :2], -motion[:, 2]])


def speed_of(motion: Floats) -> Floats:
    """Speed (...) of motions (..., 3), m/s."""
    out: Floats = np.sqrt((motion**2).sum(axis=-1))
    return out


def turning_of(motion: Floats) -> NDArray[np.bool_]:
    """Whether each of motions (..., 3) turns more than it slides."""
    out: NDArray[np.bool_] = abs(motion[..., 2]) > np.hypot(motion[..., 0], motion[..., 1])
    return out


def sector_of(motion: Floats) -> NDArray[np.intp]:
    """Which of eight directions each of motions (..., 3) has: 0 along x, 2 along y."""
    angle = np.arctan2(motion[..., 1], motion[..., 0])
    return np.rint(angle * SECTORS / (2.0 * math.pi)).astype(np.intp) % SECTORS
