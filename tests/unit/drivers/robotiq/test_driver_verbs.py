"""Driver core: start, activation, and the bytes of each verb."""

import pytest

from drivers.errors import Refused
from drivers.interfaces import Detection
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model.gripper import GripperModel, HandSettings, ModelTransport
from drivers.robotiq.model.hand import Request
from drivers.robotiq.protocol import (
    AxisCommand,
    CommandRegisters,
)
from drivers.robotiq.settings import DriverSettings
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.gripping import ALL, FAST, MS, QUICK, THUMB, gripped

# What was written


def test_state_reports_the_written_bytes_and_their_acknowledgement_time(rig) -> None:
    made = rig()
    assert (made.state.written, made.state.written_ns) == ("", 0)
    made.driver.move_to((40, 50, 60), FAST, 10.0)
    made.step(60)
    whole, first_ns = made.frames[-1], made.written_ns[-1]
    assert (made.state.written, made.state.written_ns) == (whole, first_ns)
    made.driver.close_to_limit(10.0, THUMB, (255, 255, 255), FAST)
    assert made.state.written == whole, "not written yet"
    made.step()
    short = made.state.written  # the register with rACT is confirmed and therefore not written
    assert short == "00" + "ffff00" + "32ff00" + "3cff00" + "00000000"
    assert (made.frames[-1], made.written_ns[-1]) == ("0904" + short, made.state.written_ns)


def test_fingers_that_do_not_close_get_the_least_force(rig) -> None:
    made = rig()
    made.step(5)
    made.driver.close_to_limit(60.0, THUMB, (255, 255, 255), FAST)
    made.step()
    registers = bytes.fromhex(made.state.written)[-13:]  # target, speed and force of A, B and C
    a, b, c = (registers[i] for i in (2, 5, 8))
    assert a > 0
    assert (b, c) == (0, 0)


# Start and activation


def test_there_is_no_state_and_no_verb_before_the_first_exchange() -> None:
    model = GripperModel(QUICK, 0)
    driver = RobotiqDriver(ModelTransport(model), DriverSettings(), PAPER)
    assert driver.state is None
    for verb in (driver.activate, driver.hold, lambda: driver.open(FAST)):
        with pytest.raises(Refused, match="no status"):
            verb()


def test_connecting_writes_nothing(rig) -> None:
    made = rig(active=False)
    made.step(20)
    assert made.frames == []
    assert made.driver.statistics.reads == 21


def test_activation_resets_waits_sets_ract_and_polls(rig) -> None:
    made = rig(hand=QUICK, active=False)
    applied = made.driver.activate()
    assert applied.effective
    made.step(2)
    assert not made.state.fresh
    made.step(30)
    assert made.frames == ["00" * 16, "01" + "00" * 15]
    assert made.state.active and made.state.fresh and made.state.at_rest


def test_activating_an_active_hand_writes_nothing(rig) -> None:
    made = rig(active=True)
    made.step(20)
    applied = made.driver.activate()
    made.step(20)
    assert (applied.effective, made.frames) == (False, [])
    assert "already active" in applied.note
    least = PAPER.speed_mps(0), PAPER.least_force_n
    assert (applied.speed_mps, applied.force_n) == least
    assert applied.targets_counts == made.state.positions
    made.driver.move_to((50, 60, 70), FAST, 10.0)
    made.settle()
    assert made.driver.activate().targets_counts == (50, 60, 70)


def test_activation_started_by_another_client_is_awaited_and_not_restarted(rig) -> None:
    made = rig(hand=QUICK, active=False)
    made.model.write(0, CommandRegisters(activate=True).to_registers(), made.now_ns)
    made.step(3)
    assert not made.state.active
    made.driver.activate()
    made.step(30)
    assert made.frames == ["01" + "00" * 15]
    assert made.state.active


def test_motion_is_refused_until_active(rig) -> None:
    made = rig(active=False)
    for verb in (
        lambda: made.driver.open(FAST),
        lambda: made.driver.move_to((9, 9, 9), FAST, 10.0),
        lambda: made.driver.close_to_limit(10.0, ALL, (255,) * 3, FAST),
    ):
        with pytest.raises(Refused, match="not activated"):
            verb()
    made.driver.activate()
    with pytest.raises(Refused, match="under way"):
        made.driver.open(FAST)
    assert not made.driver.activate().effective


# Bytes of the verbs


def test_golden_bytes_of_every_motion_verb(rig) -> None:
    made = rig()
    made.driver.move_to((100, 90, 80), FAST, 10.0)
    made.settle()
    made.driver.close_to_limit(10.0, THUMB, (120, 0, 0), FAST)
    made.settle()
    made.driver.hold()
    made.settle()
    made.driver.open(0.022)
    made.settle()
    assert made.frames == [
        "09040064ff005aff0050ff0000000000",
        "09040078ff005aff0050ff0000000000",
        "0904007800005a000050000000000000",
        "09040000000000000000000000000000",
    ]


def test_finger_with_an_uncertain_position_continues_no_faster_than_commanded(rig) -> None:
    made = rig()
    made.driver.close_to_limit(10.0, THUMB, (200, 0, 0), 0.022)
    made.step(40)
    kept = made.model.read(made.now_ns)
    assert made.driver.close_to_limit(10.0, THUMB, (60, 0, 0), FAST).speed_mps > 0.1
    made.driver.close_to_limit(10.0, THUMB, (200, 0, 0), 0.022)
    made.model.misreport(lambda words: kept)
    made.step(20)
    assert made.state.fingers[0].detection is Detection.MOVING
    applied = made.driver.close_to_limit(10.0, THUMB, (60, 0, 0), FAST)
    assert applied.targets_counts[0] == 200, "it may be anywhere on its way there"
    assert applied.speed_mps == 0.022


def test_applied_reports_the_values_of_the_rounded_bytes(rig) -> None:
    made = rig()
    applied = made.driver.move_to((100, 90, 80), 0.0500, 20.0)
    assert applied.targets_counts == (100, 90, 80)
    assert 19.8 < applied.force_n <= 20.0
    assert 0.0496 < applied.speed_mps <= 0.0500
    made.step()
    assert made.written[-1].fingers[0] == Request(100, 81, 51)
    assert made.driver.open(0.001).speed_mps == 0.022, "the least speed is not zero"


def test_a_limit_below_the_least_force_is_refused_before_a_byte_is_written(rig) -> None:
    made = rig(calibration="manual")
    for verb in (
        lambda: made.driver.close_to_limit(10.0, ALL, (255,) * 3, FAST),
        lambda: made.driver.move_to((9, 9, 9), FAST, 10.0),
    ):
        with pytest.raises(Refused, match="15 N"):
            verb()
    made.step(5)
    assert made.frames == []


def test_fingers_moved_by_a_simple_command_do_not_jump_at_the_first_individual_one(rig) -> None:
    made = rig()
    simple = CommandRegisters(activate=True, go_to=True, a=AxisCommand(120, 255, 0))
    made.model.write(0, simple.to_registers(), made.now_ns)
    made.step(300)
    assert made.state.positions == (120, 120, 120)
    made.driver.close_to_limit(10.0, THUMB, (140, 0, 0), FAST)
    made.settle()
    assert made.state.positions == (140, 120, 120)


def test_over_rtu_the_registers_have_other_addresses() -> None:
    model = GripperModel(QUICK, 0, active=True)
    transport = ModelTransport(model, "rtu")
    driver = RobotiqDriver(transport, DriverSettings(link="rtu"), PAPER)
    driver.poll(0)
    driver.move_to((50, 50, 50), FAST, 10.0)
    for tick in range(1, 200):
        driver.poll(tick * 10 * MS)
    assert driver.state is not None and driver.state.positions == (50, 50, 50)


def at(rig, counts: int):
    made = rig(hand=HandSettings(activation_s=0.1))
    made.driver.move_to((counts,) * 3, FAST, 10.0)
    made.settle()
    return made


def test_activation_is_refused_unless_the_hand_is_open_or_may_drop(rig, springs) -> None:
    for case, made, refused in (
        ("contact", gripped(rig, springs), True),
        ("by position", at(rig, 100), True),
        ("open", at(rig, 0), False),
    ):
        made.model.inject_fault(0x0A)
        made.step(5)
        if refused:
            with pytest.raises(Refused, match="drop"):
                made.driver.activate()
        assert made.driver.activate(dropping=refused).effective, case


def test_an_inactive_hand_with_contact_refuses_activation(rig) -> None:
    made = rig(active=False)
    contact, mask = 2, 3  # gDTA: contact while closing
    made.model.misreport(lambda words: (words[0] & ~mask | contact, *words[1:]))
    made.step(3)
    assert not made.state.active
    with pytest.raises(Refused, match="drop"):
        made.driver.activate()
    made.step(3)
    assert made.frames == []


def test_invalid_targets_and_speeds_are_refused(rig) -> None:
    driver = rig().driver
    for targets in ((256, 0, 0), (0, -1, 0), (0, 0)):
        with pytest.raises(Refused, match="not counts"):
            driver.move_to(targets, FAST, 10.0)
    for speed in (0.0, -1.0, float("nan")):
        with pytest.raises(Refused):
            driver.open(speed)
