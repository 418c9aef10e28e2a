"""Exchange and driver with an old status, a lost write, or no status yet."""

import numpy as np
import pytest

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.interfaces import Detection
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.exchange import Exchange
from drivers.robotiq.hand_state import AT_TARGET_NOTE, finger_state, hold_targets, no_motion_reason
from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings
from drivers.robotiq.protocol import AxisCommand, AxisStatus, StatusRegisters
from drivers.robotiq.settings import DriverSettings
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.conftest import Transport
from tests.unit.drivers.robotiq.gripping import ALL, FAST, MS, QUICK, THUMB, gripped
from tests.unit.drivers.robotiq.hand import command

LEAST = 0.022


def action_byte(made) -> str:
    """Byte 0 (rACT, rMOD, rGTO) of the last write."""
    return made.frames[-1][:2]


def moved_finger_a(words: tuple[int, ...], moved: int) -> tuple[int, ...]:
    """A status with finger A moved by so many counts."""
    return (*words[:2], words[2] + (moved << 8), *words[3:])


# The exchange by itself


def exchange(active: bool = True, log=None) -> tuple[Exchange, Transport]:
    wire = Transport(GripperModel(QUICK, 0, active=active))
    return Exchange(wire, DriverSettings(), log), wire


def test_the_first_request_is_written_once_the_status_reports_an_active_hand() -> None:
    for active in [True, False]:
        made, _ = exchange(active)
        made.request(command(60, 60, 60))
        made.poll(0)
        assert made.statistics.writes == active, active


def test_nothing_is_written_before_a_valid_status() -> None:
    made, wire = exchange()
    wire.garbage = [(), ()]
    made.request(command(60, 60, 60))
    assert made.poll(0) is None
    assert made.statistics.writes == 0


def test_a_repeated_request_is_written_again_after_a_lost_link() -> None:
    made, wire = exchange()
    made.request(command(60, 60, 60))
    for t_ns in range(0, 100 * MS, 10 * MS):
        made.poll(t_ns)
    assert made.confirmed and made.statistics.writes == 1
    wire.down = True
    with pytest.raises(LinkLost):
        made.poll(100 * MS)
    wire.down = False
    made.request(command(60, 60, 60))
    for t_ns in (110 * MS, 120 * MS):
        made.poll(t_ns)
    assert made.statistics.writes == 2


def test_a_write_is_acknowledged_after_its_exchange(rig) -> None:
    made = rig()
    assert made.driver.acknowledged
    made.driver.move_to((60, 60, 60), FAST, 10.0)
    assert not made.driver.acknowledged
    made.step(2)
    assert made.driver.acknowledged


def test_an_ignored_command_is_written_again_when_it_is_requested_again(rig) -> None:
    made = rig()
    made.model.ignores_writes = True
    made.driver.move_to((60, 60, 60), FAST, 10.0)
    made.step(5)
    made.model.ignores_writes = False
    made.driver.move_to((60, 60, 60), FAST, 10.0)
    made.settle()
    assert made.driver.statistics.writes == 2
    assert made.state.positions == (60, 60, 60)


def test_writes_keep_the_minimum_interval(rig) -> None:
    made = rig()
    for count in range(20):
        made.driver.move_to((100 + count,) * 3, FAST, 10.0)
        made.advance(2)
        made.driver.poll(made.now_ns)
    gaps = [b - a for a, b in zip(made.written_ns, made.written_ns[1:], strict=False)]
    assert min(gaps) == 10 * MS
    made.step(2)
    assert made.written[-1].fingers[0].position == 119, "the newest command wins"


def test_an_existing_major_fault_is_raised_by_the_first_exchange() -> None:
    model = GripperModel(QUICK, 0, active=True)
    model.inject_fault(0x0F)
    model.advance(10 * MS, FingerLoads(np.zeros(3), np.zeros(3)))
    driver = RobotiqDriver(Transport(model), DriverSettings(), PAPER)
    with pytest.raises(DeviceFault, match="release completed"):
        driver.poll(10 * MS)
    with pytest.raises(Refused, match="gripper fault: automatic release completed"):
        driver.open(FAST)


def test_a_hand_that_faulted_during_activation_can_be_activated_again(rig) -> None:
    made = rig(hand=HandSettings(activation_s=1.0), active=False)
    made.driver.activate()
    made.step(20)
    made.model.inject_fault(0x0D)
    with pytest.raises(DeviceFault, match="activation fault"):
        made.step(5)
    made.step(5)
    assert made.driver.activate().effective


def test_activation_ends_at_its_deadline_and_nothing_more_is_written(rig) -> None:
    made = rig(hand=HandSettings(activation_s=30.0), active=False)
    start_ns = made.now_ns
    made.driver.activate()
    with pytest.raises(DeviceFault) as raised:
        made.step(2100)
    assert made.now_ns - start_ns == 20_010 * MS  # the first exchange past it
    assert raised.value.message.endswith("nothing interferes with the fingers")
    made.step(20)
    assert made.frames == ["00" * 16, "01" + "00" * 15]


@pytest.mark.parametrize(("word", "seen"), [(0, "gACT 0, gIMC 0"), (0x0100, "gACT 1, gIMC 0")])
def test_a_device_whose_registers_show_no_activation_does_not_obey(
    rig, word: int, seen: str
) -> None:
    made = rig(active=False)
    made.model.misreport(lambda words: (0,) * 8)
    made.step()
    made.driver.activate()
    made.step(10)
    made.model.misreport(lambda words: (word, *(0,) * 7))
    with pytest.raises(DeviceFault, match=f"the device does not obey .{seen}") as raised:
        made.step(2100)
    assert "address" in raised.value.remedy


def test_a_hand_that_lost_power_during_activation_can_be_activated_again(rig) -> None:
    made = rig(hand=HandSettings(activation_s=0.5), active=False)
    made.driver.activate()
    made.step(20)
    made.model.power_cycle()
    with pytest.raises(DeviceFault, match="did not complete"):
        made.step(2100)
    assert made.driver.activate().effective
    made.step(90)
    assert made.state.active


def test_a_lost_link_ends_an_activation(rig) -> None:
    made = rig(hand=HandSettings(activation_s=5.0), active=False)
    made.driver.activate()
    made.step(10)
    made.transport.down = True
    with pytest.raises(LinkLost):
        made.step()
    made.transport.replace(GripperModel(QUICK, made.now_ns))
    made.transport.down = False
    made.step(3)
    assert made.driver.activate().effective


def test_force_of_a_grip_is_not_known_after_the_link_was_lost(rig, springs) -> None:
    made = gripped(rig, springs)
    made.transport.down = True
    with pytest.raises(LinkLost):
        made.step()
    made.transport.down = False
    made.settle()
    applied = made.driver.close_to_limit(20.0, ALL, (255,) * 3, FAST)
    assert not applied.effective and "latched" in applied.note


def jump_position(made, counts: int) -> None:
    """The status reports finger A at a position so far away, from now on."""
    kept = made.model.read(made.now_ns)
    made.model.misreport(lambda words: moved_finger_a(kept, counts))
    made.step()


def test_hold_stops_the_fingers_after_a_position_jump(
    rig,
) -> None:
    for counts, stays in [(11, "09"), (12, "01")]:
        made = rig()
        made.driver.move_to((60, 60, 60), FAST, 10.0)
        made.settle()
        jump_position(made, counts)
        made.driver.hold()
        made.step(2)
        assert action_byte(made) == stays, (counts, stays)


def test_motion_during_a_late_reply_is_not_a_position_jump(rig) -> None:
    for late_ms in [30, 90]:
        made = rig()
        made.driver.move_to((250, 250, 250), FAST, 10.0)
        made.step(40)
        before = made.state
        made.reply_late(late_ms)
        after = made.state
        assert after.took_ns == late_ms * 1_000_000, late_ms
        assert after.t_ns == before.t_ns, "requested at once"
        assert late_ms < 90 or after.positions[0] - before.positions[0] > 8, "more than a jump"
        made.driver.hold()
        made.step(2)
        assert action_byte(made) == "09", late_ms


def test_positions_are_trusted_again_after_a_lost_link_and_after_activation(rig) -> None:
    made = rig(hand=QUICK)
    jump_position(made, 40)
    made.transport.down = True
    with pytest.raises(LinkLost):
        made.step()
    made.transport.down = False
    made.step(3)
    made.driver.hold()
    made.step(3)
    assert action_byte(made) == "09"
    made = rig(hand=QUICK, active=False)
    jump_position(made, 40)
    made.model.misreport(lambda words: words)
    made.driver.activate()
    while not (made.state.active and made.state.fresh):
        made.step()
    made.driver.hold()
    made.step(3)
    assert action_byte(made) == "09"


# A frozen status


def until_changed(made) -> None:
    """Step until a reported position changes."""
    before = made.state.positions
    while made.state.positions == before:
        made.step()


def freeze_status(made, steps: int) -> tuple[int, ...]:
    """Freeze the status and step; returns the reported positions."""
    kept = made.model.read(made.now_ns)
    made.model.misreport(lambda words: kept)
    made.step(steps)
    return made.state.positions


# 0.11 s at 28.6 counts a second, and how late it is
def test_hold_targets_the_reported_position_until_the_status_is_old(rig) -> None:
    for steps, reach in [(10, 0), (11, 4 + 2)]:
        made = rig()
        made.driver.close_to_limit(10.0, THUMB, (200, 0, 0), LEAST)
        made.step(40)
        until_changed(made)
        here = freeze_status(made, steps)
        assert made.state.fingers[0].detection is Detection.MOVING, (steps, reach)
        applied = made.driver.hold()
        assert applied.targets_counts[0] == here[0] + reach, (steps, reach)
        made.step(2)
        assert action_byte(made) == "09", (steps, reach)


def test_unconfirmed_fingers_are_stopped_while_the_status_changes(rig) -> None:
    for steps, stays in [(10, "01"), (11, "09")]:
        made = rig()
        made.driver.close_to_limit(10.0, THUMB, (200, 0, 0), LEAST)
        made.step(40)
        until_changed(made)
        made.driver.move_to((220, 0, 0), LEAST, 10.0)
        freeze_status(made, steps)
        assert not made.state.fresh, (steps, stays)
        made.driver.hold()
        made.step(2)
        assert action_byte(made) == stays, (steps, stays)


def moved_by_another_client(rig):
    made = rig()
    made.model.write(0, command(200, 200, 200, speed=0).to_registers(), made.now_ns)
    made.step(30)
    freeze_status(made, 30)
    return made


def jumped_after_activation(rig):
    made = rig(hand=QUICK, active=False)
    made.driver.activate()
    made.step(40)
    jump_position(made, 40)
    made.step(30)
    return made


def test_uncommanded_fingers_with_uncertain_positions_hold_and_close_as_requested(rig) -> None:
    for uncertain in [moved_by_another_client, jumped_after_activation]:
        made = uncertain(rig)
        assert made.driver.hold().targets_counts == made.state.positions, uncertain
        made = uncertain(rig)
        assert made.driver.close_to_limit(10.0, THUMB, (255, 0, 0), FAST).speed_mps > 0.1, uncertain


# From registers to fingers


def test_a_hand_without_a_request_is_stationary_unless_it_activates_or_changes_mode() -> None:
    for initialization, detection in [
        (0, Detection.AT_TARGET),
        (1, Detection.MOVING),
        (2, Detection.MOVING),
        (3, Detection.AT_TARGET),
    ]:
        status = StatusRegisters(active=True, initialization=initialization)
        state = finger_state(AxisStatus(detection=0), status)
        assert state.detection is detection, initialization


def finger(at: int, detection: int, requested: int = 0):
    status = StatusRegisters(active=True, initialization=3, go_to=True)
    axis = AxisStatus(position=at, detection=detection, echo=requested)
    return finger_state(axis, status)


def test_hold_keeps_a_target_within_one_count_of_the_position() -> None:
    for at, kept in [(61, 60), (62, 62), (59, 60), (58, 58)]:
        resting = [finger(at, list(Detection).index(Detection.AT_TARGET))] * 3
        assert hold_targets(resting, command(60, 60, 60).axes[:3]) == (kept,) * 3, (at, kept)


def test_hold_keeps_the_target_of_a_finger_that_reports_to_be_there() -> None:
    for requested, at, kept in [
        (60, 65, 60),
        (60, 55, 60),  # encoder error
        (50, 65, 65),  # status of another request
    ]:
        resting = [finger(at, list(Detection).index(Detection.AT_TARGET), requested)] * 3
        assert hold_targets(resting, command(60, 60, 60).axes[:3]) == (kept,) * 3, (
            requested,
            at,
            kept,
        )


def test_hold_never_moves_the_target_of_a_finger_in_contact_farther() -> None:
    for at, kept in [(55, 55), (60, 60), (66, 60)]:
        latched = [finger(at, list(Detection).index(Detection.CONTACT_CLOSING))] * 3
        assert hold_targets(latched, command(60, 60, 60).axes[:3]) == (kept,) * 3, (at, kept)


def test_hold_stops_an_opening_finger_that_still_reports_contact() -> None:
    """Except when its target is within the position error."""
    for target, kept in [(0, 60), (43, 60), (44, 44)]:
        latched = [finger(60, list(Detection).index(Detection.CONTACT_CLOSING))] * 3
        targets = hold_targets(latched, command(target, target, target).axes[:3])
        assert targets == (kept,) * 3, (target, kept)


def test_a_finger_in_contact_commanded_to_its_position_is_at_its_target() -> None:
    latched = finger(60, list(Detection).index(Detection.CONTACT_CLOSING))
    assert no_motion_reason(latched, AxisCommand(60, 255, 0), None, 0) == AT_TARGET_NOTE
