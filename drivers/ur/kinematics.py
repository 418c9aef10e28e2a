"""Kinematics of the UR10 (CB3): forward, Jacobian, numerical inverse, and UR's pose vectors.

Denavit-Hartenberg parameters: Universal Robots, "DH parameters for calculations of kinematics and
dynamics", UR10 of the CB series. Lengths in metres, angles in radians. A pose is a position and a
rotation vector, as in URScript; a frame is a homogeneous 4 x 4 matrix.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.float64]
Joints = tuple[float, ...]
Pose = tuple[float, ...]

JOINTS = 6
A_M = (0.0, -0.612, -0.5723, 0.0, 0.0, 0.0)
D_M = (0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922)
_ALPHA_COS_SIN = ((0.0, 1.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0))

ELBOW_UP: Joints = (3.01, -1.72, 2.36, -2.21, -1.57, -1.70)  # tool down, half a metre ahead

_DAMPING = 1e-6  # of the normal equations; negligible away from singularities
_TOLERANCE_M = 1e-9  # and rad
_MAX_STEP = 0.5  # rad or m in one iteration
_ITERATIONS = 60
_EPSILON = 1e-12
# The wrist centre lies d6 behind the flange and D_M[3] beside the plane of the links.
_REACH_M = math.hypot(A_M[1] + A_M[2] - D_M[4], D_M[3]) + 1e-6
_MIN_RADIUS_M = D_M[3] - 1e-6
JOINT_SPEEDS = (2.0944, 2.0944, 3.1416, 3.1416, 3.1416, 3.1416)  # rad/s, UR10 user manual
JOINT_RANGE = 2.0 * math.pi  # rad either way, UR10 user manual
_SLACK = 1.02  # tolerance of joint speeds, for rounding
ZERO_JOINTS: Joints = (0.0,) * JOINTS


def frames(q: Sequence[float]) -> list[Frame]:
    """Base frame and the frames behind joints 1 to 6; the last one is the tool flange."""
    found = [np.eye(4)]
    for angle, a, d, (ca, sa) in zip(q, A_M, D_M, _ALPHA_COS_SIN, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        link = np.array(
            (
                (c, -s * ca, s * sa, a * c),
                (s, c * ca, -c * sa, a * s),
                (0.0, sa, ca, d),
                (0.0, 0.0, 0.0, 1.0),
            )
        )
        found.append(found[-1] @ link)
    return found


def forward(q: Sequence[float]) -> Frame:
    """Tool flange in the base frame."""
    return frames(q)[-1]


def jacobian(q: Sequence[float]) -> NDArray[np.float64]:
    """Flange velocity (m/s, then rad/s, base frame) per joint speed (rad/s), 6 x 6."""
    return _jacobian(frames(q))


def _jacobian(chain: list[Frame]) -> NDArray[np.float64]:
    tip = chain[-1][:3, 3]
    axes = np.array([frame[:3, 2] for frame in chain[:-1]])
    arms = np.array([tip - frame[:3, 3] for frame in chain[:-1]])
    return np.vstack((_cross(axes, arms).T, axes.T))


def _cross(a: Frame, b: Frame) -> Frame:
    """Row-wise cross product; numpy.cross takes several times as long on six rows."""
    turned: Frame = a[:, (1, 2, 0)] * b[:, (2, 0, 1)] - a[:, (2, 0, 1)] * b[:, (1, 2, 0)]
    return turned


def inverse(target: Frame, near: Sequence[float]) -> Joints | None:
    """Joint angles of a flange frame, by damped least squares from ``near``; None if not reached.

    Nakamura and Hanafusa, "Inverse kinematic solutions with singularity robustness", 1986.
    """
    x, y, z = (target[:3, 3] - D_M[5] * target[:3, 2]).tolist()
    if not (math.hypot(x, y, z - D_M[0]) <= _REACH_M and math.hypot(x, y) >= _MIN_RADIUS_M):
        return None
    q = np.array(near, dtype=float)
    for _ in range(_ITERATIONS):
        chain = frames(q.tolist())
        error = _difference(target, chain[-1])
        if float(np.abs(error).max()) < _TOLERANCE_M:
            return tuple(q.tolist())
        j = _jacobian(chain)
        step = j.T @ np.linalg.solve(j @ j.T + _DAMPING * np.eye(6), error)
        largest = float(np.abs(step).max())
        q += step * min(1.0, _MAX_STEP / largest) if largest else step
    return None


def _difference(target: Frame, present: Frame) -> NDArray[np.float64]:
    """Translation and rotation vector, base frame, from present to target."""
    turn = rotation_vector(target[:3, :3] @ present[:3, :3].T)
    return np.concatenate((target[:3, 3] - present[:3, 3], turn))


def rotation_vector(rotation: Frame) -> tuple[float, float, float]:
    """Rotation vector of a rotation matrix, angle within 0 to pi; well conditioned at both ends."""
    w, x, y, z = _quaternion(rotation.tolist())
    size = math.sqrt(x * x + y * y + z * z)
    if size < _EPSILON:
        return 2.0 * x, 2.0 * y, 2.0 * z
    scale = 2.0 * math.atan2(size, w) / size
    return x * scale, y * scale, z * scale


def _quaternion(m: list[list[float]]) -> tuple[float, float, float, float]:
    """Unit quaternion with w >= 0, by its largest component (Shepperd 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = m
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)  # 4 w2, 4 x2, ...
    largest = max(range(4), key=squares.__getitem__)
    rows = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )
    scale = 0.5 / math.sqrt(squares[largest])
    w, x, y, z = (part * scale for part in rows[largest])
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


def rotation(vector: Sequence[float]) -> Frame:
    """3 x 3 rotation matrix of a rotation vector (Rodrigues)."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < _EPSILON:
        return np.eye(3)
    x, y, z = x / angle, y / angle, z / angle
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    turned: Frame = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
    return turned


def frame(pose: Sequence[float]) -> Frame:
    matrix = np.eye(4)
    matrix[:3, 3] = pose[:3]
    matrix[:3, :3] = rotation(pose[3:])
    return matrix


def pose(matrix: Frame) -> Pose:
    return (*matrix[:3, 3].tolist(), *rotation_vector(matrix[:3, :3]))


def inverse_frame(matrix: Frame) -> Frame:
    """Inverse of a homogeneous frame."""
    back = np.eye(4)
    back[:3, :3] = matrix[:3, :3].T
    back[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return back


def angle_between(a: Frame, b: Frame) -> float:
    """Angle of the rotation from one frame's orientation to the other's."""
    return math.hypot(*rotation_vector(a[:3, :3].T @ b[:3, :3]))


def limit_violation(q: Sequence[float], qd: Sequence[float]) -> str:
    """Joint that exceeds its range or speed, as text; empty when none does."""
    for joint, (angle, speed, limit) in enumerate(zip(q, qd, JOINT_SPEEDS, strict=True)):
        if abs(angle) > JOINT_RANGE:
            return f"joint {joint} at its limit, {angle:.2f} rad"
        if abs(speed) > limit * _SLACK:
            return f"joint {joint} too fast, {speed:.2f} rad/s"
    return ""


def nearest_turns(q: Sequence[float], near: Sequence[float]) -> Joints:
    """The same posture, each joint shifted by whole turns as close to ``near`` as its range
    allows."""
    return tuple(_whole_turns(angle, other) for angle, other in zip(q, near, strict=True))


def _whole_turns(angle: float, near: float) -> float:
    turn = 2.0 * math.pi
    least = math.ceil((-JOINT_RANGE - angle) / turn)
    most = math.floor((JOINT_RANGE - angle) / turn)
    return angle + turn * min(most, max(least, round((near - angle) / turn)))
