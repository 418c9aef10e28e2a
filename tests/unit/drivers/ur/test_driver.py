"""Arm driver: limits before anything is sent, staleness, protective stops."""

import math

import msgspec
import pytest

from drivers.errors import DeviceFault, Refused, Stale
from drivers.ur.driver import ArmDriver
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings, ArmSettings

MS = 1_000_000
X, Y, Z = START = (0.5, 0.1, 0.3)


class Wire:
    """An arm model that records the commands and can stop reporting."""

    def __init__(self) -> None:
        self.model = ArmModel(ArmModelSettings(), 0)
        self.sent: list[tuple[object, ...]] = []
        self.frozen = None

    def move_l(self, *move: object) -> bool:
        self.sent.append(("move", *move))
        return self.model.move_l(*move)

    def stop_l(self, *stop: object) -> None:
        self.sent.append(("stop", *stop))
        self.model.stop_l(*stop)

    def set_payload(self, mass_kg: float) -> None:
        self.sent.append(("payload", mass_kg))

    def read(self, now_ns: int):
        return self.frozen or self.model.read(now_ns)


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.fixture
def driver(wire: Wire) -> ArmDriver:
    driver = ArmDriver(wire, ArmSettings())
    driver.poll(0)
    return driver


def poll_until(driver: ArmDriver, start_ms: int, end_ms: int) -> None:
    for t in range(start_ms, end_ms, 10):
        driver.poll(t * MS)


def test_the_arm_counts_as_moving_from_the_command_on(wire, driver):
    driver.poll(6 * MS)
    driver.move_to((X, Y, Z + 0.1), 0.1, 0.5)  # starts at 8 ms: the sample of 8 ms shows no speed
    assert driver.state.moving
    for t in (7, 8, 15, 100):
        driver.poll(t * MS)
        assert driver.state.moving


def test_a_stopped_move_is_over_although_its_target_was_not_reached(wire, driver):
    driver.move_to((X, Y, Z + 0.4), 0.1, 0.5)
    poll_until(driver, 10, 400)
    driver.stop(1.0)
    driver.poll(400 * MS)
    assert driver.state.moving
    poll_until(driver, 410, 600)
    assert not driver.state.moving


def test_a_move_outside_a_limit_is_refused_by_key_and_never_sent(wire, driver):
    for position, speed, acceleration, key in [
        ((X, Y, Z + 0.1), 0.2501, 0.5, "max_speed_mps"),
        ((X, Y, Z + 0.1), 0.0, 0.5, "max_speed_mps"),
        ((X, Y, Z + 0.1), -0.1, 0.5, "max_speed_mps"),
        ((X, Y, Z + 0.1), math.nan, 0.5, "max_speed_mps"),
        ((X, Y, Z + 0.1), 0.1, 1.21, "max_acceleration_mps2"),
        ((X, Y, Z + 0.1), 0.1, 0.0, "max_acceleration_mps2"),
        ((X, Y, Z + 0.5001), 0.1, 0.5, "max_jump_m"),
        ((X, Y, math.nan), 0.1, 0.5, "max_jump_m"),
        ((X + 0.0501, Y, Z), 0.1, 0.5, "workspace"),
        ((X, Y - 0.0501, Z), 0.1, 0.5, "workspace"),
        ((X, Y, Z - 0.0101), 0.1, 0.5, "workspace"),
    ]:
        with pytest.raises(Refused, match=key) as caught:
            driver.move_to(position, speed, acceleration)
        assert caught.value.remedy.startswith("allowed:"), (position, speed, acceleration, key)
        assert wire.sent == [], (position, speed, acceleration, key)
        assert not driver.state.moving, (position, speed, acceleration, key)


def test_a_move_exactly_at_the_limits_is_sent(wire, driver):
    driver.move_to((X, Y, Z + 0.5), 0.25, 1.2)
    assert len(wire.sent) == 1


def test_the_workspace_is_a_box_around_the_pose_at_start_not_the_present_one(wire):
    driver = ArmDriver(wire, ArmSettings(max_jump_m=1.0))
    driver.poll(0)
    driver.move_to((X, Y, Z + 0.3), 0.25, 1.2)
    poll_until(driver, 10, 2000)
    with pytest.raises(Refused, match=r"0\.6 m breaks .*\(z from start\)") as caught:
        driver.move_to((X, Y, Z + 0.6), 0.25, 1.2)
    assert "-0.01 to 0.5 m" in caught.value.remedy


def test_no_move_before_the_position_is_known(wire):
    with pytest.raises(Refused, match="not known"):
        ArmDriver(wire, ArmSettings()).move_to(START, 0.1, 0.5)
    assert wire.sent == []


@pytest.mark.parametrize("deceleration", [0.0, -1.0, math.nan, math.inf])
def test_a_stop_is_never_refused(wire, driver, deceleration):
    driver.stop(deceleration)
    assert wire.sent == [("stop", 1.2, 0)]


def test_the_deceleration_of_a_stop_is_limited() -> None:
    for most, asked, sent in ((4.0, 8.0, 4.0), (10.0, 8.0, 8.0), (0.5, math.nan, 0.5)):
        wire = Wire()
        ArmDriver(wire, ArmSettings(max_stop_mps2=most)).stop(asked)
        assert wire.sent == [("stop", sent, 0)]


def test_payload_is_limited(wire, driver):
    taken = (0.0, 2.8, 10.0)
    for mass in taken:
        driver.set_payload(mass)
    for mass in (-0.1, 10.1, math.nan):
        with pytest.raises(Refused, match="limit of payload"):
            driver.set_payload(mass)
    assert wire.sent == [("payload", mass) for mass in taken]


def test_the_controllers_own_clock_decides_what_is_stale(wire, driver):
    driver.poll(100 * MS)
    wire.frozen = wire.model.read(100 * MS)
    driver.poll(150 * MS)
    assert driver.state.age_ns(150 * MS) == 50 * MS
    with pytest.raises(Stale, match="clock stands still"):
        driver.poll(151 * MS)
    with pytest.raises(Stale):
        driver.poll(160 * MS)
    wire.frozen = None
    driver.poll(170 * MS)
    assert driver.state.age_ns(170 * MS) == 0


def test_a_protective_stop_is_a_fault_once_an_onset_and_stays_in_the_state(wire, driver):
    driver.move_to((X, Y, Z + 0.4), 0.1, 0.5)
    poll_until(driver, 10, 300)
    wire.model.trip(300 * MS)
    with pytest.raises(DeviceFault, match="protective stop"):
        driver.poll(310 * MS)
    poll_until(driver, 320, 500)
    assert driver.state.stopped_by_safety
    assert not driver.state.moving
    with pytest.raises(Refused, match="protective stop"):
        driver.move_to(START, 0.1, 0.5)
    wire.model.release()
    driver.poll(500 * MS)
    assert not driver.state.stopped_by_safety
    wire.model.trip(505 * MS)
    with pytest.raises(DeviceFault):
        driver.poll(510 * MS)


def test_a_move_that_the_controller_rejects_is_refused(wire, driver):
    wire.model.trip(1 * MS)  # not read by the driver yet
    with pytest.raises(Refused, match="did not accept"):
        driver.move_to((X, Y, Z + 0.1), 0.1, 0.5)
    assert not driver.state.moving


def test_default_limits() -> None:
    assert msgspec.structs.asdict(ArmSettings()) == {
        "max_speed_mps": 0.25, "max_acceleration_mps2": 1.2, "max_stop_mps2": 10.0,
        "workspace_low_m": (-0.05, -0.05, -0.01), "workspace_high_m": (0.05, 0.05, 0.5),
        "max_jump_m": 0.5, "payload_kg": 2.6, "stale_after_s": 0.05,
    }  # fmt: skip
