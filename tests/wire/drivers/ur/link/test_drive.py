"""Drives through ur_rtde: velocity and spin are reached, and a stop ends them."""

import pytest

from tests.wire.drivers.ur.link.test_client import connect  # noqa: F401


def drive_until(arm, velocity, spin, condition):
    def renewed():
        arm.driver.drive(velocity, spin, 1.0)
        return condition()

    arm.poll_until(renewed)


def test_a_drive_moves_and_turns_the_tool_and_a_move_follows_it(emulate, host, connect):  # noqa: F811
    emulate()
    arm = connect()
    drive_until(arm, (0.02, 0.0, 0.0), 0.5, lambda: arm.state.angle_rad > 0.2)
    assert arm.state.velocity_mps == pytest.approx((0.02, 0.0, 0.0), abs=1e-3)
    assert arm.state.spin_radps == pytest.approx(0.5, abs=0.02)
    drive_until(arm, (0.0, 0.02, 0.0), -0.5, lambda: arm.state.angle_rad < 0.1)
    arm.driver.stop(1.0)
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.state.spin_radps == pytest.approx(0.0, abs=0.01)
    angle = arm.state.angle_rad
    arm.rise(0.02)
    arm.poll_until(lambda: not arm.state.moving)
    assert arm.risen_m() == pytest.approx(0.02, abs=1e-3)
    assert arm.state.angle_rad == pytest.approx(angle, abs=0.01)
