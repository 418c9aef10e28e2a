"""What is ordered to go wrong in an emulated cell, without a cell."""

from unittest.mock import Mock

import pytest

from drivers.robotiq.emulator import WireFaults
from drivers.ur.emulator.controller import PROFILES, Controller
from scenarios.rigs.cell_faults import KNOWN, CellFaults


class Gripper:
    def __init__(self) -> None:
        self.faults = WireFaults()
        self.model = Mock()


def arm(profile: str) -> Mock:
    """One that stands, with a controller of its own."""
    motion = Mock(moving=False, tripped=False)
    motion.update.return_value = ""
    settings = Mock(controller=PROFILES[profile], unlock_delay_s=5.0)
    return Mock(controller=Controller(settings, motion, 0))


def test_every_fault_that_is_told_of_is_taken_and_answered_in_words() -> None:
    faults = CellFaults(Mock(), arm("e-series"), Gripper())  # type: ignore[arg-type]
    for name, known in KNOWN.items():
        told = faults.order({"name": name, "after_s": 0.5}, 0)
        assert told.startswith(name) and told.endswith(f" in 0.5 s: {known.does}")


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
def test_fault_that_is_none_is_refused_with_what_it_takes(
    request_: dict[str, object], error: str
) -> None:
    faults = CellFaults(Mock(), arm("cb3"), Gripper())  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=error):
        faults.order(request_, 0)


def test_fault_of_the_arm_has_struck_after_its_next_cycle_and_not_before() -> None:
    faults = CellFaults(Mock(), Mock(), None)
    assert faults.struck(0.0)  # nothing was ordered
    faults.order({"name": "emergency_stop"}, 0)
    faults.order({"name": "unplug"}, 0)
    assert not faults.struck(0.0)
    faults.strike_arm()
    assert faults.struck(0.0)
    faults.order({"name": "emergency_stop", "after_s": 1.0}, 0)
    assert faults.struck(0.0)  # it is told when it comes
    faults.strike(1_000_000_000)
    assert not faults.struck(0.0)
