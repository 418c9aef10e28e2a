"""Small builders of states that the controller's tests need."""

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import (
    ArmState,
    Counts3,
    Detection,
    FingerState,
    GripperState,
    TactileFrame,
)
from grasp.control.fault import GRIPPER, INTERRUPTED, TRIAL, Fault
from grasp.control.observation import Observation

LOST = (Fault("link_lost", GRIPPER, "unplugged", "plug it in", kind="link_lost"),)
STOP = Fault(INTERRUPTED, TRIAL, "stopped by hand", kind=INTERRUPTED)
REST = Detection.AT_TARGET
MOVING = (Detection.MOVING, REST, REST)  # finger A
Codes = NDArray[np.int16]


def gripper(
    t_ns: int = 0,
    positions: Counts3 = (55, 55, 55),
    detections: tuple[Detection, Detection, Detection] = (REST, REST, REST),
    fresh: bool = True,
    fault: int = 0,
    requested: Counts3 | None = None,
) -> GripperState:
    requests = positions if requested is None else requested
    a, b, c = (
        FingerState(*f) for f in zip(requests, positions, (0, 0, 0), detections, strict=True)
    )
    return GripperState(t_ns, 0, True, fault, "fault" if fault else "", fresh, (a, b, c))


def arm(t_ns: int = 0, height_m: float = 0.0, moving: bool = False, **more: bool) -> ArmState:
    velocity_mps = (0.0, 0.0, 0.05 if moving else 0.0)
    return ArmState(t_ns, 0, (0.3, 0.2, 0.4 + height_m), velocity_mps, moving, **more)


def frame(count: int = 0, stale: bool = False) -> TactileFrame:
    """Every taxel at this many counts; pressing is negative."""
    counts = np.full((3, 6), count, dtype=np.int16)
    rest = np.full((3, 6), 450, dtype=np.int16)
    raw = (rest + counts).astype(np.int16)
    return TactileFrame(0, 0, 0, counts, raw, rest, rest, stale=stale)


def codes(k: int) -> Codes:
    """Codes of normal fingertips: each taxel changes from sample to sample."""
    return (400 + (k + np.arange(18)) % 3).reshape(3, 6).astype(np.int16)


def frame_of(raw: Codes, missed: int = 0) -> TactileFrame:
    """Frame of these codes, with rest codes of 450."""
    return TactileFrame(0, 0, 0, raw - np.int16(450), raw, raw, raw, missed)


def observation(t_ns: int, p: float = 0.0, **changes: object) -> Observation:
    values: dict[str, object] = {
        "t_ns": t_ns,
        "probabilities": np.array([p, 0.0, 0.0]),
        "frame": None,
        "rest_taken": True,
        "gripper": gripper(t_ns),
        "arm": arm(t_ns),
        "estimated_n": (2.0, 1.0, 1.0),
        **changes,
    }
    values.setdefault("responsive_n", values["estimated_n"])
    values.setdefault("faults", values.get("errors", ()))
    return Observation(**values)  # type: ignore[arg-type]
