"""The truth that heads are judged by, from what a recording holds."""

import math

import msgspec
import numpy as np
import pytest

from detector.recordings import Metadata, Recording
from detector.scores.motion import (
    SPAN,
    TURN_LEVER_M,
    UPWARDS,
    left_behind,
    motion_of,
    opposed,
    sector_of,
    speed_of,
    turning_of,
)

N = 20


def recording(fingers: int, velocity: tuple[float, float], spin: float) -> Recording:
    metadata = Metadata(
        set="slide", split="test", surface="planar", motion="none", speed_mps=0.0, spin_radps=0.0,
        direction="", seed=0, parameters={UPWARDS: 90.0},
    )  # fmt: skip
    return Recording(
        np.arange(N) * 0.01, np.zeros((N, fingers, 6), np.int16), np.ones(N, bool), None, "made",
        metadata, velocity_mps=np.tile(np.float32(velocity), (N, 1)),
        spin_radps=np.full(N, spin, np.float32),
    )  # fmt: skip


def test_motion_is_the_mean_of_the_last_fifty_milliseconds() -> None:
    made = recording(1, (0.0, 0.0), 0.0)
    velocity = np.zeros((N, 2), np.float32)
    velocity[10] = (0.05, 0.0)
    motion = motion_of(msgspec.structs.replace(made, velocity_mps=velocity))
    assert motion is not None
    assert motion[:, 0, 0] == pytest.approx(
        [0.05 / SPAN if 10 <= t < 15 else 0.0 for t in range(N)]
    )


def test_the_other_fingers_feel_the_thumb_s_motion_mirrored_at_what_is_upwards() -> None:
    motion = motion_of(recording(3, (0.01, 0.02), 0.4))
    assert motion is not None
    lever = 0.4 * TURN_LEVER_M
    assert motion[-1] == pytest.approx(
        np.array([(0.01, 0.02, lever), (-0.01, 0.02, -lever), (-0.01, 0.02, -lever)]), abs=1e-8
    )


def test_mirroring_twice_is_none() -> None:
    motion = np.random.default_rng(0).normal(size=(5, 3))
    assert opposed(opposed(motion, 0.7), 0.7) == pytest.approx(motion)


def test_a_recording_that_does_not_say_how_it_moved_has_no_motion() -> None:
    made = recording(3, (0.01, 0.0), 0.0)
    assert motion_of(msgspec.structs.replace(made, velocity_mps=None)) is None
    bare = msgspec.structs.replace(made.metadata, parameters={})
    assert motion_of(msgspec.structs.replace(made, metadata=bare)) is None


def test_over_what_goes_down_all_fingertips_slide_upwards_on_their_pads() -> None:
    assert left_behind(recording(3, (0.0, 0.0), 0.0)) == 2
    assert left_behind(recording(1, (0.0, 0.0), 0.0)) == -1  # pressed: there is no up


def test_directions_are_eight_and_a_turn_counts_by_its_lever() -> None:
    angles = np.radians([0, 20, 25, 90, 180, -90, -45])
    motion = 0.02 * np.stack([np.cos(angles), np.sin(angles), np.zeros(7)], axis=1)
    assert sector_of(motion).tolist() == [0, 0, 1, 2, 4, 6, 7]
    assert speed_of(motion) == pytest.approx(np.full(7, 0.02))
    turns = np.array([(0.01, 0.0, -0.011), (0.01, 0.0, 0.009)])
    assert turning_of(turns).tolist() == [True, False]
    assert speed_of(turns)[0] == pytest.approx(math.hypot(0.01, 0.011))
