"""Driver core: faults, lost links, malformed replies, and the force limit under any commands."""

from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model.gripper import GripperModel, ModelTransport
from drivers.robotiq.model.hand import decode
from drivers.robotiq.protocol import (
    CommandRegisters,
)
from drivers.robotiq.settings import DriverSettings
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.gripping import ALL, FAST, MS, QUICK

# Faults, link, malformed replies


def test_a_major_fault_is_raised_once_per_onset_and_shown_in_the_state(rig) -> None:
    made = rig()
    for _ in range(2):
        made.model.inject_fault(0x0F)
        with pytest.raises(DeviceFault, match="release completed"):
            made.step(3)
        made.step(20)
        assert "release completed" in made.state.fault_text
        assert not made.state.active
        made.driver.activate()
        made.step(40)


def test_another_reported_mode_is_a_fault_and_is_not_commanded(rig) -> None:
    """A mode change would open the fingers even while they hold an object."""
    made = rig()
    made.driver.move_to((60, 60, 60), 0.02, 15.0)
    made.step(200)
    made.model.misreport(lambda words: (words[0] ^ 0x0200, *words[1:]))
    with pytest.raises(DeviceFault, match=r"another client changed .* rMOD 1, expected 0"):
        made.step()
    made.step()  # once
    made.driver.move_to((80, 80, 80), 0.02, 15.0)
    made.step(200)
    assert min(made.state.positions) > 70


def test_malformed_replies_are_counted_and_the_last_state_is_kept(rig) -> None:
    for reply in [(), (1, 2, 3), (0,) * 9, (70000,) * 8, (-1,) * 8]:
        made = rig()
        before = made.state
        made.transport.garbage = [reply]
        made.step()
        assert made.driver.statistics.rejected == 1, reply
        assert made.state == before, reply
        made.step()
        assert made.state.seq == before.seq + 1, reply


def lose_link(made, steps: int = 5) -> None:
    made.transport.down = True
    for _ in range(steps):
        with pytest.raises(LinkLost):
            made.step()


def test_after_a_lost_link_the_motion_is_replaced_by_hold(rig) -> None:
    made = rig()
    made.driver.move_to((230, 230, 230), FAST, 20.0)
    made.step(30)
    lose_link(made)
    made.transport.down = False
    made.step()
    assert made.driver.statistics.resynced == made.driver.statistics.reconnects == 1
    assert made.driver.statistics.link_losses == 1
    here = made.state.positions
    made.step()
    holding = made.written[-1]
    assert tuple(finger.position for finger in holding.fingers) == here
    assert {(finger.speed, finger.force) for finger in holding.fingers} == {(0, 0)}
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
    assert [command.fingers[0].position for command in made.written].count(230) == 1
    assert made.written[-1].fingers[0].position < 230


def test_verbs_on_a_lost_link_neither_raise_nor_are_sent_later(rig) -> None:
    made = rig()
    made.step(2)
    lose_link(made)
    for verb in (
        lambda: made.driver.move_to((90, 90, 90), FAST, 10.0),
        lambda: made.driver.open(FAST),
        made.driver.hold,
        made.driver.activate,
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


def test_an_unrequested_reset_drops_the_last_request(rig) -> None:
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


FIRST = 2  # polls after which a status has been read


def hide_a_reset(made, boot_s: float = 0.0) -> None:
    """The hand loses power, and its status does not show that for one exchange."""
    kept = made.model.read(made.now_ns)
    made.model.power_cycle(boot_s)
    made.model.misreport(lambda words: kept)
    made.step()
    made.model.misreport(lambda words: words)


def test_unrequested_activation_is_reset_at_once_and_reported_as_a_fault(rig) -> None:
    made = rig()
    made.step(FIRST)
    made.driver.move_to((90, 90, 90), FAST, 10.0)
    hide_a_reset(made)
    with pytest.raises(DeviceFault, match="lost its activation"):
        made.step(3)
    made.step(300)
    assert made.written[-1].activate is False
    assert not made.state.active
    assert not made.model.moving


MOTION_VERBS = {
    "move_to": lambda driver: driver.move_to((90, 90, 90), FAST, 10.0),
    "close_to_limit": lambda driver: driver.close_to_limit(10.0, ALL, (200, 200, 200), FAST),
    "open": lambda driver: driver.open(FAST),
    "hold": lambda driver: driver.hold(),
}


def test_a_command_to_a_hand_that_has_just_lost_power_moves_nothing(rig) -> None:
    """Also when the status shows the reset late, and when the write waits for the hand to boot."""
    for name, verb in MOTION_VERBS.items():
        for hidden, boot_s in ((False, 0.0), (True, 0.0), (True, 0.5)):
            made, case = rig(hand=QUICK), (name, hidden, boot_s)
            made.driver.move_to((60, 60, 60), FAST, 10.0)
            made.settle()
            before, travel_m = len(made.written), made.model.travel_m.copy()
            verb(made.driver)
            if hidden:
                hide_a_reset(made, boot_s)
            else:
                made.model.power_cycle()
            made.step(300)
            assert (made.model.travel_m == travel_m).all(), case
            assert hidden or len(made.written) == before, case
            assert not made.state.active, case
            assert made.driver.activate().effective, case


def test_a_status_within_one_refresh_is_not_read_again_before_a_write(rig) -> None:
    made = rig()
    made.step(FIRST)
    reads = made.driver.statistics.reads
    made.driver.move_to((90, 90, 90), FAST, 10.0)
    made.driver.poll(made.now_ns + 5 * MS)
    assert len(made.written) == 1
    assert made.driver.statistics.reads == reads + 1


# The cap

CAPS = st.sampled_from([5.0, 10.0, 10.2, 14.0, 15.0, 33.0, 60.0, 100.0, float("nan")])
COUNTS = st.tuples(*[st.integers(0, 255)] * 3)
FLAGS = st.tuples(*[st.booleans()] * 3)
VERBS = st.one_of(
    st.tuples(st.just("open")),
    st.tuples(st.just("hold")),
    st.tuples(st.just("activate")),
    st.tuples(st.just("move_to"), COUNTS, CAPS),
    st.tuples(st.just("close_to_limit"), CAPS, FLAGS, COUNTS),
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
        case ("close_to_limit", cap, closing, limits):
            driver.close_to_limit(cap, closing, limits, FAST)
            return cap
        case (name,):
            return 0.0 if getattr(driver, name)().effective else -1.0
    return 0.0


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(VERBS, st.integers(0, 12)), max_size=15))
def test_no_sequence_of_verbs_ever_writes_a_force_above_the_limit(script) -> None:
    paper = PAPER
    hand = GripperModel(QUICK, 0, active=True)
    transport = ModelTransport(hand)
    down = False
    caps = [0.0]
    image = [0] * 8

    class Wire:
        def write(self, first, registers, now_ns) -> None:
            if down:
                raise LinkLost("no answer", "check")
            assert (first, len(registers)) in ((0, 8), (1, 7))
            image[first:] = registers
            command = decode(image)
            allowed = max(paper.least_force_n, caps[-1])
            assert all(
                paper.force_n(axis.force) <= allowed for axis in (*command.fingers, command.scissor)
            )
            transport.write(first, registers, now_ns)

        def read(self, first, count, now_ns):
            if down:
                raise LinkLost("no answer", "check")
            return transport.read(first, count, now_ns)

    driver = RobotiqDriver(Wire(), DriverSettings(), paper)
    now_ns = 0
    driver.poll(now_ns)
    for verb, polls in script:
        if verb[0] == "fault":
            hand.inject_fault(verb[1])
        elif verb[0] == "link":
            down = verb[1]
        else:
            with suppress(Refused):
                cap = apply_verb(driver, verb)
                if cap >= 0:
                    caps.append(cap)
        for _ in range(polls):
            now_ns += 10 * MS
            with suppress(LinkLost, DeviceFault):
                driver.poll(now_ns)
