"""Driver core: freshness of the state, contact, closing."""

import pytest

from drivers.errors import DeviceFault
from drivers.interfaces import Detection
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model.gripper import HandSettings
from drivers.robotiq.settings import DriverSettings
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.gripping import ALL, FAST, MS, RIGID, THUMB, gripped
from tests.unit.drivers.robotiq.hand import QUICK

# Freshness


def test_a_state_is_stale_from_the_verb_on_until_the_echo(rig) -> None:
    made = rig()
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    assert made.state.at_rest
    made.driver.move_to((80, 80, 80), FAST, 10.0)
    assert not made.state.fresh, "before it is even written"
    made.driver.poll(made.now_ns + 1)
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


def test_an_echo_of_the_command_before_last_does_not_confirm_the_last(rig) -> None:
    made = rig(hand=HandSettings(tick_phase_s=0.0))
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    made.driver.move_to((80, 80, 80), FAST, 10.0)
    made.step()
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.driver.poll(made.now_ns + 1 * MS)
    made.driver.move_to((80, 80, 80), FAST, 30.0)
    made.step()
    assert not made.state.fresh, "80 is echoed, but from the first request"


# Closing, latch


def test_closing_the_thumb_alone_holds_the_others_where_they_are(rig, springs) -> None:
    made = rig(springs=springs([RIGID] * 3, [0.074, 0.2, 0.2]))
    made.driver.move_to((90, 95, 96), FAST, 10.0)
    made.settle()
    applied = made.driver.close_to_limit(10.0, THUMB, (255, 255, 255), FAST)
    assert applied.targets_counts == (255, 95, 96)
    made.settle()
    assert made.state.positions[1:] == (95, 96)
    assert made.state.fingers[0].detection is Detection.CONTACT_CLOSING
    assert 9.9 < made.peak_n[0] < 14


def test_a_second_close_at_equal_force_is_reported_as_ineffective(rig, springs) -> None:
    made = gripped(rig, springs)
    applied = made.driver.close_to_limit(10.0, ALL, (250, 250, 250), FAST)
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
    assert not made.driver.close_to_limit(10.0, ALL, (255, 255, 255), FAST).effective


def test_a_close_at_higher_force_is_effective(rig, springs) -> None:
    made = gripped(rig, springs)
    before = made.peak_n.copy()
    applied = made.driver.close_to_limit(30.0, ALL, (255, 255, 255), FAST)
    assert applied.effective and applied.force_n <= 30.0
    made.settle()
    assert (made.peak_n > before + 10).all()


def test_a_close_right_after_open_does_not_trust_the_stale_contact(rig, springs) -> None:
    made = gripped(rig, springs)
    made.driver.open(FAST)
    assert made.driver.close_to_limit(10.0, ALL, (255, 255, 255), FAST).effective


def test_an_existing_grip_has_unknown_force_and_counts_as_latched(rig, springs) -> None:
    made = gripped(rig, springs)
    other = RobotiqDriver(made.transport, DriverSettings(), PAPER)
    other.poll(made.now_ns)
    assert not other.close_to_limit(20.0, ALL, (255, 255, 255), FAST).effective


def test_a_limit_more_open_than_the_finger_never_opens_it(rig) -> None:
    made = rig()
    made.driver.move_to((100, 100, 100), FAST, 10.0)
    made.settle()
    applied = made.driver.close_to_limit(10.0, ALL, (90, 50, 100), FAST)
    assert applied.targets_counts == (100, 100, 100)
    assert not applied.effective
    made.step(20)
    assert made.state.positions == (100, 100, 100)


def test_a_target_already_reached_is_ineffective_even_at_the_software_limit(rig) -> None:
    made = rig()
    made.driver.open(FAST)
    made.settle()
    assert made.driver.open(FAST).note == "already at the target"
    assert made.driver.move_to((60, 60, 60), FAST, 10.0).effective


def test_holding_a_finger_that_rests_beside_its_target_does_not_make_it_creep(rig) -> None:
    made = rig()
    made.driver.move_to((100, 100, 100), FAST, 10.0)
    made.settle()
    beside = list(made.model.read(made.now_ns))
    beside[3] += 1  # position of finger B
    made.transport.garbage = [beside]
    made.step()
    assert made.state.positions == (100, 101, 100)
    assert made.driver.hold().targets_counts == (100, 100, 100)
    closing = made.driver.close_to_limit(10.0, THUMB, (120, 0, 0), FAST)
    assert closing.targets_counts == (120, 100, 100)


@pytest.mark.parametrize("off", [-3, 3])
def test_holding_finger_with_a_wrong_position_and_a_wrong_echo_keeps_its_target(rig, off) -> None:
    made = rig()
    made.driver.move_to((100, 100, 100), FAST, 10.0)
    made.settle()

    def misreported(words):
        echo, position = words[3] >> 8, words[3] & 0xFF  # of finger B
        return (*words[:3], (echo - off) << 8 | position + off, *words[4:])

    made.model.misreport(misreported)
    with pytest.raises(DeviceFault, match="targets"):  # as another client's
        made.step(20)
    assert made.state.positions == (100, 100 + off, 100) and not made.state.fresh
    closing = made.driver.close_to_limit(10.0, THUMB, (120, 0, 0), FAST)
    assert closing.targets_counts == (120, 100, 100)


def test_hold_on_a_frozen_status_stops_the_fingers_without_moving_them_back(rig) -> None:
    for since in ["before the motion", "in the motion"]:
        made = rig()
        if since == "before the motion":
            _freeze_status(made)
        made.driver.move_to((200, 200, 200), FAST, 10.0)
        made.step(100)
        if since == "in the motion":
            _freeze_status(made)
        made.step(200)
        before = made.model.travel_m
        made.driver.hold()
        made.step(100)
        stopped = made.model.travel_m
        made.step(1000)
        assert (stopped >= before).all(), since
        assert (made.model.travel_m == stopped).all(), since


def test_hold_and_repeated_requests_on_a_frozen_status_do_not_activate_the_hand(rig) -> None:
    made = rig(hand=QUICK)
    made.step(100)
    made.driver.move_to((200, 200, 200), FAST, 10.0)
    made.step(100)
    _freeze_status(made)
    made.model.power_cycle()
    made.step(200)
    stood = made.model.travel_m.copy()
    for _ in range(3):
        made.driver.hold()
        made.step(100)
        made.driver.close_to_limit(10.0, ALL, (250, 250, 250), FAST)
        made.step(100)
    assert (made.model.travel_m == stood).all()
    assert not made.model.ready


def _freeze_status(made) -> None:
    kept = made.model.read(made.now_ns)
    made.model.misreport(lambda words: kept)
