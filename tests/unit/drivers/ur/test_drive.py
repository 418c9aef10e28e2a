"""Drives of the arm: they must be renewed, and cannot leave the workspace without renewal."""

import math

import pytest

from drivers.errors import Refused
from drivers.ur.driver import MAX_TURN_RAD, ArmDriver
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings, ArmSettings

MS = 1_000_000
START = (0.5, 0.1, 0.3)
BOX = 0.05


@pytest.fixture
def model() -> ArmModel:
    return ArmModel(ArmModelSettings(), 0)


@pytest.fixture
def driver(model: ArmModel) -> ArmDriver:
    driver = ArmDriver(model, ArmSettings())
    driver.poll(0)
    return driver


def test_a_drive_is_executed_and_shown_in_the_state(driver: ArmDriver) -> None:
    for t in range(10, 700, 10):
        driver.drive((0.02, 0.0, 0.0), 0.5, 1.0)
        driver.poll(t * MS)
    assert driver.state is not None
    assert driver.state.velocity_mps == pytest.approx((0.02, 0.0, 0.0))
    assert driver.state.spin_radps == pytest.approx(0.5)
    assert driver.state.angle_rad > 0.1
    assert driver.state.moving


def test_a_drive_that_is_not_renewed_is_stopped(driver: ArmDriver, model: ArmModel) -> None:
    driver.drive((0.02, 0.0, 0.0), 0.5, 1.0)
    for t in range(10, 110, 10):
        driver.poll(t * MS)
    assert model.at(109 * MS).velocity_mps == pytest.approx((0.02, 0.0, 0.0))
    for t in range(110, 800, 10):
        driver.poll(t * MS)
    assert driver.state is not None
    assert not driver.state.moving
    assert driver.state.spin_radps == 0.0


def test_a_drive_outside_a_limit_is_refused_by_key_and_nothing_moves(driver, model):
    for velocity, spin, acceleration, key in [
        ((0.26, 0.0, 0.0), 0.0, 1.0, "max_speed_mps"),
        ((math.nan, 0.0, 0.0), 0.0, 1.0, "max_speed_mps"),
        ((0.0, 0.0, 0.0), -1.6, 1.0, "limit of spin"),
        ((0.0, 0.0, 0.0), math.nan, 1.0, "limit of spin"),
        ((0.01, 0.0, 0.0), 0.0, 0.0, "max_acceleration_mps2"),
        ((0.01, 0.0, 0.0), 0.0, 1.3, "max_acceleration_mps2"),
        ((0.0, 0.0, -0.2), 0.0, 1.0, "workspace"),
    ]:
        with pytest.raises(Refused, match=key):
            driver.drive(velocity, spin, acceleration)
        assert not model.at(1_000 * MS).moving, (velocity, spin, acceleration, key)


def test_no_drive_before_the_first_sample(model: ArmModel) -> None:
    with pytest.raises(Refused, match="not known"):
        ArmDriver(model, ArmSettings()).drive((0.01, 0.0, 0.0), 0.0, 1.0)


@pytest.mark.parametrize("what", ["speed", "spin"])
def test_a_drive_not_renewed_at_the_worst_moment_stays_within_limits(driver, model, what):
    """The drive is renewed until it is refused, and then no more."""
    speed, spin = (0.1, 0.0) if what == "speed" else (0.0, 1.0)
    t = 0
    with pytest.raises(Refused):
        for t in range(10, 60_000, 10):
            driver.poll(t * MS)
            driver.drive((speed, 0.0, 0.0), spin, 0.5)
    for later in range(t + 10, t + 3_000, 10):
        driver.poll(later * MS)
    end = model.read((t + 3_000) * MS)
    assert not end.moving
    slack = 0.03  # allowance for a controller cycle and the command latency
    assert end.position_m[0] - START[0] <= BOX + slack * speed
    assert abs(end.angle_rad) <= MAX_TURN_RAD + slack * abs(spin)
    assert end.position_m[0] - START[0] > 0.5 * BOX or what == "spin"
