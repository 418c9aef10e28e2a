"""Kinematics of the UR10 against closed forms, finite differences and round trips."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from drivers.ur import kinematics

angle = st.floats(-math.pi, math.pi)
joints = st.tuples(*[angle] * 6)
rotation_vectors = st.tuples(*[st.floats(-1.8, 1.8)] * 3)


def test_forward_kinematics_of_the_stretched_arm():
    """All joints at zero: the arm lies along -x, by sums of link lengths."""
    flange = kinematics.forward([0.0] * 6)
    assert flange[:3, 3] == pytest.approx((-0.612 - 0.5723, -0.163941 - 0.0922, 0.1273 - 0.1157))
    assert flange[:3, :3] == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), abs=1e-12)


@given(joints)
def test_jacobian_against_finite_differences(q):
    h = 1e-6
    found = kinematics.jacobian(q)
    for joint in range(6):
        up, down = list(q), list(q)
        up[joint] += h
        down[joint] -= h
        a, b = kinematics.forward(down), kinematics.forward(up)
        turn = kinematics.rotation_vector(b[:3, :3] @ a[:3, :3].T)
        expected = np.concatenate((b[:3, 3] - a[:3, 3], turn)) / (2.0 * h)
        assert found[:, joint] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "pose",
    [(0.9, 0.9, 0.9, 1, 2, 3), (0.5, 0.1, 1.6, 0, 0, 0), (0.1, 0.1, 0.5, math.pi, 0, 0),
     (math.nan, 0, 0, 0, 0, 0), (1e300, 0, 0, 0, 0, 0)],
)  # fmt: skip
def test_unreachable_poses_have_no_inverse(pose):
    assert kinematics.inverse(kinematics.frame(pose), kinematics.ELBOW_UP) is None


@given(st.floats(0.4, 0.8), st.floats(-0.3, 0.4), st.floats(0.1, 0.6))
def test_inverse_kinematics_in_the_working_space(x, y, z):
    goal = kinematics.frame((x, y, z, math.pi, 0.0, 0.0))
    found = kinematics.inverse(goal, kinematics.ELBOW_UP)
    assert found is not None
    assert kinematics.forward(found) == pytest.approx(goal, abs=1e-8)


@given(rotation_vectors)
def test_rotation_vector_round_trip(vector):
    there = kinematics.rotation(vector)
    assert there @ there.T == pytest.approx(np.eye(3), abs=1e-12)
    back = kinematics.rotation_vector(there)
    assert math.hypot(*back) <= math.pi + 1e-12
    assert kinematics.rotation(back) == pytest.approx(there, abs=1e-9)
