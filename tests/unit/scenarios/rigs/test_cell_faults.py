"""Fault requests of an emulated cell, without a cell."""

from unittest.mock import Mock

import pytest

from drivers.robotiq.emulator import WireFaults
from drivers.ur.emulator.controller import PROFILES, Controller
from scenarios.rigs.cell_faults import CELL_FAULTS, CellFaults


class Gripper:
    def __init__(self) -> None:
        self.faults = WireFaults()
        self.model = Mock()


def arm(profile: str) -> Mock:
    """An arm at rest with its own controller."""
    motion = Mock(moving=False, tripped=False)
    motion.update.return_value = ""
    settings = Mock(controller=PROFILES[profile], unlock_delay_s=5.0)
    return Mock(controller=Controller(settings, motion, 0))


def test_every_listed_fault_is_accepted_and_its_effect_is_returned() -> None:
    faults = CellFaults(Mock(), arm("e-series"), Gripper())  # type: ignore[arg-type]
    for name, kind in CELL_FAULTS.items():
        effect = faults.order({"name": name, "after_s": 0.5}, 0)
        assert effect.startswith(name) and effect.endswith(f" in 0.5 s: {kind.effect}")


@pytest.mark.parametrize(
    ("request_", "error"),
    [
        ({"name": "dance"}, "unknown fault 'dance': one of gripper_drop, "),
        ({"name": ["x"]}, "unknown fault"),
        ({"name": "unplug", "times": 2}, "takes no times: unplug: the fingertips"),
        ({"name": "gripper_fault", "code": 16}, r"code=14 \(0 to 15\)"),
        ({"name": "arm_freeze", "seconds": "long"}, r"Expected `float`.* seconds=0.1 \(s, to 60\)"),
        ({"name": "arm_freeze", "after_s": -1}, "arm_freeze"),
    ],
)
def test_wrong_fault_request_is_refused_with_the_allowed_settings(
    request_: dict[str, object], error: str
) -> None:
    faults = CellFaults(Mock(), arm("cb3"), Gripper())  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=error):
        faults.order(request_, 0)


def test_fault_of_the_arm_is_applied_in_its_next_cycle() -> None:
    faults = CellFaults(Mock(), Mock(), None)
    assert faults.wait_applied_to_arm(0.0)  # nothing was ordered
    faults.order({"name": "emergency_stop"}, 0)
    faults.order({"name": "unplug"}, 0)
    assert not faults.wait_applied_to_arm(0.0)
    faults.apply_due_to_arm()
    assert faults.wait_applied_to_arm(0.0)
    faults.order({"name": "emergency_stop", "after_s": 1.0}, 0)
    assert faults.wait_applied_to_arm(0.0)  # not due yet
    faults.apply_due(1_000_000_000)
    assert not faults.wait_applied_to_arm(0.0)
