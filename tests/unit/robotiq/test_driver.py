"""The driver core against the modelled hand: what it writes, what it says, what it refuses."""

from contextlib import suppress

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.interfaces import Detection, Gripper
from drivers.robotiq.driver import DriverSettings, RobotiqDriver
from drivers.robotiq.model import GripperModel, HandSettings, ModelTransport
from drivers.robotiq.protocol import (
    CALIBRATIONS,
    RTU,
    AxisCommand,
    CommandRegisters,
    StatusRegisters,
)

MS = 1_000_000
FAST = 0.11
RIGID = 5000.0
QUICK = HandSettings(activation_s=0.1)
ALL = (True, True, True)
THUMB = (True, False, False)


def gripped(rig, springs, **kwargs):
    """A rig whose three fingers have met rigid objects at force byte 0."""
    made = rig(springs=springs([RIGID] * 3, [0.03] * 3), **kwargs)
    made.driver.close_fast(10.0, ALL, (255, 255, 255), FAST)
    made.settle()
    assert [f.detection for f in made.state.fingers] == [Detection.CONTACT_CLOSING] * 3
    return made


def test_the_driver_is_a_gripper(rig) -> None:
    driver: Gripper = rig().driver
    assert driver.least_force_n == 10.0
    assert driver.m_per_count == 0.00077


# Start and activation


def test_there_is_no_state_and_no_verb_before_the_first_exchange() -> None:
    model = GripperModel(QUICK, 0)
    driver = RobotiqDriver(ModelTransport(model), DriverSettings(), CALIBRATIONS["paper"])
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


def test_an_active_hand_is_taken_over_without_a_byte(rig) -> None:
    made = rig(active=True)
    applied = made.driver.activate()
    made.step(20)
    assert (applied.effective, made.frames) == (False, [])
    assert "already active" in applied.note


def test_activation_begun_by_somebody_else_is_waited_for_not_started_over(rig) -> None:
    made = rig(hand=HandSettings(activation_s=1.0), active=False)
    made.model.write(0, CommandRegisters(activate=True).to_registers(), made.now_ns)
    made.step(10)
    made.driver.activate()
    made.step(100)
    assert made.frames == ["01" + "00" * 15]
    assert made.state.active


def test_activation_that_never_ends_is_a_device_fault_at_the_deadline(rig) -> None:
    made = rig(
        hand=HandSettings(activation_s=30.0),
        active=False,
        settings=DriverSettings(activation_timeout_s=2.0),
    )
    made.driver.activate()
    with pytest.raises(DeviceFault, match="did not complete"):
        made.step(300)
    assert 2_000 * MS < made.now_ns < 2_100 * MS
    made.step(10)


def test_an_activation_fault_of_the_hand_is_raised_once_with_text_and_remedy(rig) -> None:
    made = rig(active=False)
    made.driver.activate()
    made.step(20)
    made.model.inject_fault(0x0D)
    with pytest.raises(DeviceFault, match="activation fault") as raised:
        made.step(5)
    assert "clear the fault" in raised.value.remedy
    made.step(50)
    assert (made.state.fault, made.state.active) == (0x0D, False)


def test_a_booting_hand_is_waited_for(rig) -> None:
    made = rig(hand=HandSettings(activation_s=0.1, boot_s=1.0), active=False)
    made.driver.activate()
    made.step(50)
    assert made.state.fault == 0x09
    assert made.frames == ["00" * 16]
    made.step(100)
    assert made.state.active


def test_activation_is_refused_while_the_fingers_hold_something(rig, springs) -> None:
    made = gripped(rig, springs)
    made.model.inject_fault(0x0A)
    made.step(5)
    with pytest.raises(Refused, match="drop"):
        made.driver.activate()


def test_clear_fault_resets_even_a_holding_hand_and_activation_follows(rig, springs) -> None:
    made = gripped(rig, springs, hand=QUICK)
    made.model.inject_fault(0x0E)
    with pytest.raises(DeviceFault):
        made.step(5)
    with pytest.raises(Refused):
        made.driver.close_fast(10.0, ALL, (255, 255, 255), FAST)
    assert made.driver.clear_fault().effective
    made.step(10)
    assert (made.state.fault, made.state.active) == (0, False)
    assert made.driver.activate().effective
    made.step(40)
    assert made.state.active


def test_clear_fault_of_a_healthy_hand_does_not_reset_it(rig, springs) -> None:
    made = gripped(rig, springs)
    before = list(made.frames)
    assert not made.driver.clear_fault().effective
    made.step(10)
    assert made.frames == before


def test_motion_is_refused_until_active(rig) -> None:
    made = rig(active=False)
    for verb in (
        lambda: made.driver.open(FAST),
        lambda: made.driver.move_to((9, 9, 9), FAST, 10.0),
        lambda: made.driver.close_fast(10.0, ALL, (255,) * 3, FAST),
        lambda: made.driver.regrasp(10.0),
    ):
        with pytest.raises(Refused, match="not activated"):
            verb()
    made.driver.activate()
    with pytest.raises(Refused, match="under way"):
        made.driver.open(FAST)
    assert not made.driver.activate().effective


def test_hold_never_raises_once_connected(rig) -> None:
    made = rig(active=False)
    assert not made.driver.hold().effective
    made.driver.activate()
    assert not made.driver.hold().effective
    made.step(2)
    assert made.frames == ["00" * 16]


# Bytes of the verbs


def test_golden_bytes_of_every_motion_verb(rig) -> None:
    made = rig()
    made.driver.move_to((100, 90, 80), FAST, 10.0)
    made.settle()
    made.driver.close_fast(10.0, THUMB, (120, 0, 0), FAST)
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


def test_applied_tells_what_the_bytes_say_after_rounding(rig) -> None:
    made = rig()
    applied = made.driver.move_to((100, 90, 80), 0.0500, 20.0)
    assert applied.targets_counts == (100, 90, 80)
    assert 19.8 < applied.force_n <= 20.0
    assert 0.0496 < applied.speed_mps <= 0.0500
    made.step()
    assert made.written[-1].a == AxisCommand(100, 81, 51)
    assert made.driver.open(0.001).speed_mps == 0.022, "the least speed is not zero"


@pytest.mark.parametrize("targets", [(256, 0, 0), (0, -1, 0), (0, 0)])
def test_targets_that_are_no_counts_are_refused(rig, targets) -> None:
    with pytest.raises(Refused, match="not counts"):
        rig().driver.move_to(targets, FAST, 10.0)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_speeds_that_are_no_speed_are_refused(rig, speed) -> None:
    with pytest.raises(Refused):
        rig().driver.open(speed)


def test_a_limit_below_the_least_force_is_refused_before_a_byte_is_written(rig) -> None:
    made = rig(calibration="manual")
    for verb in (
        lambda: made.driver.close_fast(10.0, ALL, (255,) * 3, FAST),
        lambda: made.driver.move_to((9, 9, 9), FAST, 10.0),
        lambda: made.driver.regrasp(10.0),
    ):
        with pytest.raises(Refused, match="15 N"):
            verb()
    made.step(5)
    assert made.frames == []


def test_the_same_command_is_written_once(rig) -> None:
    made = rig()
    for _ in range(50):
        made.driver.move_to((200, 200, 200), FAST, 10.0)
        made.step()
    assert made.driver.statistics.writes == 1


def test_writes_keep_ten_milliseconds_apart_and_the_newest_command_wins(rig) -> None:
    made = rig()
    for count in range(20):
        made.driver.move_to((100 + count,) * 3, FAST, 10.0)
        made.advance(2)
        made.driver.pump(made.now_ns)
    gaps = [b - a for a, b in zip(made.written_ns, made.written_ns[1:], strict=False)]
    assert min(gaps) >= 10 * MS
    made.step(2)
    assert made.written[-1].a.position == 119


def test_the_mode_of_an_adopted_hand_is_kept(rig) -> None:
    made = rig()
    pinch = CommandRegisters(activate=True, mode=1)
    made.model.write(0, pinch.to_registers(), made.now_ns)
    made.step(400)
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.step(20)
    assert made.written[-1].mode == 1
    assert made.state.active, "no mode change was provoked"


def test_a_hand_in_scissor_mode_is_not_commanded(rig) -> None:
    made = rig()
    made.model.write(0, CommandRegisters(activate=True, mode=3).to_registers(), made.now_ns)
    made.step(400)
    with pytest.raises(Refused, match="scissor"):
        made.driver.open(FAST)


def test_fingers_left_by_a_simple_command_do_not_jump_when_taken_over(rig) -> None:
    made = rig()
    simple = CommandRegisters(activate=True, go_to=True, a=AxisCommand(120, 255, 0))
    made.model.write(0, simple.to_registers(), made.now_ns)
    made.step(300)
    assert made.state.positions == (120, 120, 120)
    made.driver.close_fast(10.0, THUMB, (140, 0, 0), FAST)
    made.settle()
    assert made.state.positions == (140, 120, 120)


def test_over_rtu_the_registers_have_other_addresses() -> None:
    model = GripperModel(QUICK, 0, active=True)
    transport = ModelTransport(model, RTU)
    driver = RobotiqDriver(transport, DriverSettings(link="rtu"), CALIBRATIONS["paper"])
    driver.pump(0)
    driver.move_to((50, 50, 50), FAST, 10.0)
    for tick in range(1, 200):
        driver.pump(tick * 10 * MS)
    assert driver.state is not None and driver.state.positions == (50, 50, 50)


# Freshness


def test_a_state_is_stale_from_the_verb_on_until_the_echo(rig) -> None:
    made = rig()
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    assert made.state.at_rest
    made.driver.move_to((80, 80, 80), FAST, 10.0)
    assert not made.state.fresh, "before it is even written"
    made.driver.pump(made.now_ns + 1)
    stale = made.state
    assert not stale.fresh and not stale.at_rest
    assert stale.fingers[0].detection is Detection.AT_TARGET, "of the motion before"
    made.step()
    assert made.state.fresh
    assert made.state.fingers[0].requested_counts == 80
    assert made.state.fingers[0].detection is Detection.MOVING


def test_an_unchanged_position_waits_two_refreshes_because_no_echo_changes(rig) -> None:
    made = rig()
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    made.driver.move_to((50, 50, 50), FAST, 30.0)
    fresh = []
    for _ in range(4):
        made.step()
        fresh.append(made.state.fresh)
    assert fresh == [False, False, True, True]


def test_an_echo_of_the_command_before_last_proves_nothing(rig) -> None:
    made = rig(hand=HandSettings(tick_phase_s=0.0))
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    made.driver.move_to((80, 80, 80), FAST, 10.0)
    made.step()
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.driver.pump(made.now_ns + 1 * MS)
    made.driver.move_to((80, 80, 80), FAST, 30.0)
    made.step()
    assert not made.state.fresh, "80 is echoed, but from the first request"


def test_a_command_is_confirmed_by_the_echo_not_by_the_position(rig) -> None:
    made = rig()
    made.driver.open(FAST)
    made.settle()
    assert made.state.positions == (6, 6, 6), "the software limit, though 0 was asked"
    assert made.state.at_rest


def test_a_ready_hand_without_a_motion_command_is_at_rest(rig) -> None:
    made = rig()
    made.step(3)
    assert made.state.at_rest


def test_states_are_numbered_and_timed(rig) -> None:
    made = rig()
    before = made.state
    made.step()
    assert made.state.seq == before.seq + 1
    assert made.state.t_ns == made.now_ns
    assert made.state.age_ns(made.now_ns + 5) == 5


# Closing, latch, regrasp


def test_closing_the_thumb_alone_holds_the_others_where_they_are(rig, springs) -> None:
    made = rig(springs=springs([RIGID] * 3, [0.074, 0.2, 0.2]))
    made.driver.move_to((90, 95, 96), FAST, 10.0)
    made.settle()
    applied = made.driver.close_fast(10.0, THUMB, (255, 255, 255), FAST)
    assert applied.targets_counts == (255, 95, 96)
    made.settle()
    assert made.state.positions[1:] == (95, 96)
    assert made.state.fingers[0].detection is Detection.CONTACT_CLOSING
    assert 9.9 < made.peak_n[0] < 14


def test_a_second_close_at_equal_force_is_reported_as_ineffective(rig, springs) -> None:
    made = gripped(rig, springs)
    applied = made.driver.close_fast(10.0, ALL, (250, 250, 250), FAST)
    assert not applied.effective
    assert "latched" in applied.note
    travel = made.model.travel_m
    made.step(30)
    assert (made.model.travel_m == travel).all(), "and indeed nothing moved"


def test_hold_after_contact_keeps_the_grip_and_remembers_the_latch(rig, springs) -> None:
    made = gripped(rig, springs)
    travel = made.model.travel_m
    made.driver.hold()
    made.settle()
    assert (made.model.travel_m == travel).all()
    assert not made.driver.close_fast(10.0, ALL, (255, 255, 255), FAST).effective


def test_a_close_at_higher_force_is_effective(rig, springs) -> None:
    made = gripped(rig, springs)
    before = made.peak_n.copy()
    applied = made.driver.close_fast(30.0, ALL, (255, 255, 255), FAST)
    assert applied.effective and applied.force_n <= 30.0
    made.settle()
    assert (made.peak_n > before + 10).all()


def test_a_close_right_after_open_does_not_trust_the_stale_contact(rig, springs) -> None:
    made = gripped(rig, springs)
    made.driver.open(FAST)
    assert made.driver.close_fast(10.0, ALL, (255, 255, 255), FAST).effective


def test_a_grip_taken_over_has_unknown_force_and_counts_as_latched(rig, springs) -> None:
    made = gripped(rig, springs)
    other = RobotiqDriver(made.transport, DriverSettings(), CALIBRATIONS["paper"])
    other.pump(made.now_ns)
    assert not other.close_fast(20.0, ALL, (255, 255, 255), FAST).effective


def test_a_limit_behind_a_finger_never_opens_it(rig) -> None:
    made = rig()
    made.driver.move_to((100, 100, 100), FAST, 10.0)
    made.settle()
    applied = made.driver.close_fast(10.0, ALL, (90, 50, 100), FAST)
    assert applied.targets_counts == (100, 100, 100)
    assert not applied.effective
    made.step(20)
    assert made.state.positions == (100, 100, 100)


def test_a_target_already_reached_is_ineffective_even_at_the_software_limit(rig) -> None:
    made = rig()
    made.driver.open(FAST)
    made.settle()
    assert made.driver.open(FAST).note == "already there"
    assert made.driver.move_to((60, 60, 60), FAST, 10.0).effective


def test_hold_in_motion_stops_at_the_positions_read(rig) -> None:
    made = rig()
    made.driver.move_to((200, 200, 200), FAST, 10.0)
    made.step(100)
    positions = made.state.positions
    assert made.driver.hold().targets_counts == positions
    made.settle()
    assert made.state.positions == positions


def test_holding_a_finger_that_rests_beside_its_target_does_not_make_it_creep(rig) -> None:
    made = rig()
    made.driver.move_to((100, 100, 100), FAST, 10.0)
    made.settle()
    beside = list(made.model.read(made.now_ns))
    status = StatusRegisters.from_registers(beside)
    moved = msgspec.structs.replace(
        status, b=msgspec.structs.replace(status.b, position=status.b.position + 1)
    )
    made.transport.garbage = [moved.to_registers()]
    made.step()
    assert made.state.positions == (100, 101, 100)
    assert made.driver.hold().targets_counts == (100, 100, 100)


def test_regrasp_clears_and_sets_rgto_and_pushes_again(rig, springs) -> None:
    made = gripped(rig, springs)
    made.springs.touch += 0.0015
    slack = made.springs.force_n(made.model.travel_m)
    start = len(made.written)
    applied = made.driver.regrasp(10.0)
    assert applied.effective
    made.settle()
    assert [command.go_to for command in made.written[start:]] == [False, True]
    apart = made.written_ns[start + 1] - made.written_ns[start]
    assert apart >= 20 * MS, "rGTO is down for two refreshes"
    assert (made.springs.force_n(made.model.travel_m) > slack + 2).all()
    assert made.driver.statistics.regrasps == 1


def test_regrasps_are_rationed_in_time_and_number(rig, springs) -> None:
    made = gripped(rig, springs, settings=DriverSettings(regrasp_budget=2))
    assert made.driver.regrasp(10.0).effective
    assert "under way" in made.driver.regrasp(10.0).note
    made.settle()
    early = made.driver.regrasp(10.0)
    assert not early.effective and "rate limit" in early.note
    made.step(60)
    assert made.driver.regrasp(10.0).effective
    made.step(100)
    spent = made.driver.regrasp(10.0)
    assert not spent.effective and "budget" in spent.note
    assert made.driver.statistics.regrasps == 2


def test_regrasp_does_nothing_where_nothing_is_latched(rig, springs) -> None:
    made = rig()
    assert not made.driver.regrasp(10.0).effective
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    assert not made.driver.regrasp(10.0).effective
    held = gripped(rig, springs)
    held.driver.hold()
    held.settle()
    assert not held.driver.regrasp(10.0).effective, "it was told to stay"


def test_a_verb_ends_a_regrasp_that_is_under_way(rig, springs) -> None:
    made = gripped(rig, springs)
    made.driver.regrasp(10.0)
    made.step()
    made.driver.open(FAST)
    made.settle()
    assert made.state.positions == (6, 6, 6)


# Faults, link, garbage


def test_a_major_fault_is_raised_once_per_onset_and_told_in_the_state(rig) -> None:
    made = rig()
    for _ in range(2):
        made.model.inject_fault(0x0F)
        with pytest.raises(DeviceFault, match="release completed"):
            made.step(3)
        made.step(20)
        assert "release completed" in made.state.fault_text
        assert not made.state.active
        made.driver.clear_fault()
        made.step(10)


def test_minor_faults_are_told_not_raised(rig) -> None:
    made = rig()
    made.model.inject_fault(0x0A)
    made.step(5)
    assert made.state.fault == 0x0A
    assert "interference" in made.state.fault_text
    assert made.state.active


@pytest.mark.parametrize("reply", [(), (1, 2, 3), (0,) * 9, (70000,) * 8, (-1,) * 8])
def test_garbage_is_counted_and_the_last_state_grows_old(rig, reply) -> None:
    made = rig()
    before = made.state
    made.transport.garbage = [reply]
    made.step()
    assert made.driver.statistics.rejected == 1
    assert made.state == before
    made.step()
    assert made.state.seq == before.seq + 1


def lose_link(made, steps: int = 5) -> None:
    made.transport.down = True
    for _ in range(steps):
        with pytest.raises(LinkLost):
            made.step()


def test_after_a_lost_link_the_motion_is_replaced_by_hold(rig) -> None:
    made = rig()
    made.driver.move_to((230, 230, 230), FAST, 10.0)
    made.step(30)
    lose_link(made)
    made.transport.down = False
    made.step()
    assert made.driver.statistics.resynced == made.driver.statistics.reconnects == 1
    assert made.driver.statistics.link_losses == 1
    here = made.state.positions
    made.step()
    held = made.written[-1]
    assert (held.a.position, held.b.position, held.c.position) == here
    made.settle()
    assert made.state.positions[0] < 230


def test_a_command_whose_write_was_lost_is_not_sent_again(rig) -> None:
    made = rig()
    made.transport.write_lost = True
    made.driver.move_to((230, 230, 230), FAST, 10.0)
    with pytest.raises(LinkLost):
        made.step()
    made.transport.write_lost = made.transport.down = False
    made.step(3)
    assert [command.a.position for command in made.written].count(230) == 1
    assert made.written[-1].a.position < 230


def test_verbs_while_the_link_is_lost_neither_raise_nor_wait_to_be_sent(rig) -> None:
    made = rig()
    made.step(2)
    lose_link(made)
    for verb in (
        lambda: made.driver.move_to((90, 90, 90), FAST, 10.0),
        lambda: made.driver.open(FAST),
        made.driver.hold,
        made.driver.activate,
        made.driver.clear_fault,
        lambda: made.driver.regrasp(10.0),
    ):
        applied = verb()
        assert not applied.effective and applied.note
    made.transport.down = False
    made.step(10)
    assert made.frames == []


def test_a_hand_that_lost_power_is_never_activated_without_a_verb(rig) -> None:
    made = rig()
    made.driver.move_to((90, 90, 90), FAST, 10.0)
    made.step(20)
    lose_link(made)
    made.transport.replace(GripperModel(QUICK, made.now_ns))
    made.transport.down = False
    written = len(made.written)
    made.step(100)
    assert len(made.written) == written
    assert not made.state.active
    assert made.driver.activate().effective


def test_a_reset_behind_the_drivers_back_drops_what_was_wanted(rig) -> None:
    made = rig(hand=QUICK)
    made.driver.move_to((90, 90, 90), FAST, 10.0)
    made.settle()
    for registers in (CommandRegisters(), CommandRegisters(activate=True)):
        made.model.write(0, registers.to_registers(), made.now_ns)
        made.step(40)
    assert made.driver.statistics.resynced == 1
    made.driver.move_to((90, 90, 90), FAST, 10.0)
    made.settle()
    assert made.state.positions == (90, 90, 90), "not taken for written already"


# The cap

CAPS = st.sampled_from([5.0, 10.0, 10.2, 14.0, 15.0, 33.0, 60.0, 100.0, float("nan")])
COUNTS = st.tuples(*[st.integers(0, 255)] * 3)
FLAGS = st.tuples(*[st.booleans()] * 3)
VERBS = st.one_of(
    st.tuples(st.just("open")),
    st.tuples(st.just("hold")),
    st.tuples(st.just("activate")),
    st.tuples(st.just("clear_fault")),
    st.tuples(st.just("move_to"), COUNTS, CAPS),
    st.tuples(st.just("close_fast"), CAPS, FLAGS, COUNTS),
    st.tuples(st.just("regrasp"), CAPS),
    st.tuples(st.just("fault"), st.sampled_from([0, 0x0A, 0x0D, 0x0F])),
    st.tuples(st.just("link"), st.booleans()),
)


def apply_verb(driver: RobotiqDriver, verb: tuple) -> float:
    """Issue a verb; returns the cap that it sets, 0 for the least force, -1 when none is set."""
    match verb:
        case ("open",):
            driver.open(FAST)
        case ("move_to", targets, cap):
            driver.move_to(targets, FAST, cap)
            return cap
        case ("close_fast", cap, closing, limits):
            driver.close_fast(cap, closing, limits, FAST)
            return cap
        case ("regrasp", cap):
            return cap if driver.regrasp(cap).effective else -1.0
        case (name,):
            return 0.0 if getattr(driver, name)().effective else -1.0
    return 0.0


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(VERBS, st.integers(0, 12)), max_size=15))
def test_no_sequence_of_verbs_ever_writes_a_force_above_the_cap(script) -> None:
    paper = CALIBRATIONS["paper"]
    hand = GripperModel(QUICK, 0, active=True)
    transport = ModelTransport(hand)
    down = False
    caps = [0.0]

    class Wire:
        def write(self, first, registers, now_ns) -> None:
            if down:
                raise LinkLost("no answer", "check")
            assert (first, len(registers)) == (0, 8)
            command = CommandRegisters.from_registers(registers)
            allowed = max(paper.least_force_n, caps[-1])
            assert all(paper.force_n(axis.force) <= allowed for axis in command.axes)
            transport.write(first, registers, now_ns)

        def read(self, first, count, now_ns):
            if down:
                raise LinkLost("no answer", "check")
            return transport.read(first, count, now_ns)

    driver = RobotiqDriver(Wire(), DriverSettings(), paper)
    now_ns = 0
    driver.pump(now_ns)
    for verb, pumps in script:
        if verb[0] == "fault":
            hand.inject_fault(verb[1])
        elif verb[0] == "link":
            down = verb[1]
        else:
            with suppress(Refused):
                cap = apply_verb(driver, verb)
                if cap >= 0:
                    caps.append(cap)
        for _ in range(pumps):
            now_ns += 10 * MS
            with suppress(LinkLost, DeviceFault):
                driver.pump(now_ns)


@pytest.mark.parametrize("cap", [10.0, 10.19, 10.2, 14.99, 59.99, 60.0, 1e6])
def test_the_force_byte_around_each_boundary_is_within_the_cap(rig, cap) -> None:
    made = rig()
    applied = made.driver.close_fast(cap, ALL, (200, 200, 200), FAST)
    made.step()
    paper = CALIBRATIONS["paper"]
    assert applied.force_n == paper.force_n(made.written[-1].a.force) <= cap


def test_settings_that_would_wear_the_gripper_do_not_load() -> None:
    for bad in ({"regrasp_interval_s": 0.1}, {"write_interval_s": 0.001}, {"link": "udp"}):
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(bad, DriverSettings)
