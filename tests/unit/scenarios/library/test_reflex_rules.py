"""Each rule of the reflex, in single steps with given states and slip."""

from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.errors import UsageError
from drivers.interfaces import PERIOD_NS, ArmState, TactileFrame, Vector3
from grasp.control.commands import CloseToLimit, HoldFingers, MoveFingers, OpenFingers
from grasp.control.controller_settings import ControllerSettings
from grasp.control.states import State
from grasp.policy_reflex import AT_REST, PolicyCommand
from tests.unit.grasp.builders import gripper
from tests.unit.scenarios.library.reflex_scene import (
    ALL_REST,
    ASIDE,
    DOWN,
    GRIP,
    HOLDS,
    MOVES,
    READ,
    REST,
    THUMB_LATCHED,
    THUMB_MOVES,
    TOUCHES,
    UP,
    Scene,
    move,
)


@pytest.fixture
def grip(monkeypatch: pytest.MonkeyPatch) -> Scene:
    """A grip at rest, which is not held yet."""
    return Scene(monkeypatch)


@pytest.fixture
def held(grip: Scene) -> Scene:
    """A held object that was lifted by 2 cm."""
    assert grip.step(steps=HOLDS).held
    grip.step(height_m=0.02)
    return grip


@pytest.fixture
def empty(monkeypatch: pytest.MonkeyPatch) -> Scene:
    """A half-closed hand that touches nothing."""
    return Scene(monkeypatch, AT_REST)


def test_a_closing_of_the_policy_is_no_slip(held: Scene) -> None:
    closing = held.step(move(57, 55, 55), positions=(56, 55, 55), detections=THUMB_MOVES)
    for at in range(57, 61):
        closing = held.step(move(at + 5, 55, 55), slip=1.0, positions=(at, 55, 55))
        assert closing.slip.masked and not closing.slip.registered
    still_masked = held.step(detections=ALL_REST, steps=10)
    assert still_masked.slip.masked and still_masked.state is State.HOLD
    assert held.step(steps=8).state is State.COMPENSATE  # it slips after the mask, too


def test_only_fingers_that_move_and_have_not_come_to_rest_mask_slip(held: Scene) -> None:
    assert held.step(detections=THUMB_MOVES, slip=1.0, steps=2).state is State.COMPENSATE


def test_slip_while_a_hand_at_rest_reports_another_count_is_answered(held: Scene) -> None:
    held.step(slip=1.0)
    assert held.step(positions=(56, 55, 55)).state is State.COMPENSATE


def test_the_detector_begins_again_at_contact_and_once_the_pads_have_settled(grip: Scene) -> None:
    s = ControllerSettings()
    grip.step(steps=HOLDS)
    contact_ns, settled_ns = (t_ns for t_ns in grip.resets if t_ns > 0)
    assert settled_ns - contact_ns == pytest.approx(s.settle_s * 1e9)
    assert grip.t_ns - settled_ns == pytest.approx(s.baseline_s * 1e9, abs=2 * PERIOD_NS)


def test_a_second_slip_is_answered_as_the_first(held: Scene) -> None:
    for thumb, force_n in ((57, 4.0), (64, 5.0)):
        assert isinstance(held.step(slip=1.0, steps=2).hand, CloseToLimit)
        held.close_thumb(thumb, force_n)
        assert held.step(slip=0.0, steps=100).state is State.HOLD


def test_slip_closes_the_hand_to_the_limit_and_stops_the_arm(held: Scene) -> None:
    admitted = held.step(move(0, 0, 0), arm=ASIDE, slip=1.0, steps=2)
    assert admitted.state is State.COMPENSATE and admitted.arm_velocity_mps == AT_REST
    assert admitted.arm_acceleration_mps2 == 8.0
    assert isinstance(admitted.hand, CloseToLimit) and admitted.hand.force_limit_n == 10.0
    assert held.step(arm=DOWN).arm_velocity_mps == DOWN


def test_a_fault_stops_the_arm_of_an_empty_hand(empty: Scene) -> None:
    assert empty.step(arm=UP).arm_velocity_mps == UP
    fault = empty.step(arm=UP, positions=(120, 55, 55))
    assert fault.state is State.FAULT
    assert fault.arm_velocity_mps == AT_REST and fault.arm_acceleration_mps2 == 1.0
    assert empty.step(move(55, 80, 80)).hand is None


def test_a_command_is_sent_once_and_only_to_a_hand_that_confirmed_the_last(empty: Scene) -> None:
    assert empty.step(move(60, 60, 60), fresh=False).hand is None
    assert empty.step(move(60, 60, 60), fresh=True).hand == move(60, 60, 60)
    assert empty.step(move(60, 60, 60)).hand is None
    assert empty.step(move(61, 60, 60)).hand == move(61, 60, 60)


def test_a_thumb_latched_below_the_limit_can_close_further(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    held = Scene(monkeypatch, limit_n=20.0)
    held.step(steps=HOLDS)
    held.step(move(60, 55, 55, force_n=12.0), slip=0.0)
    held.step(detections=THUMB_LATCHED, steps=2)
    assert isinstance(held.step(slip=1.0, steps=2).hand, CloseToLimit)


def test_a_thumb_latched_at_the_limit_cannot_and_the_arm_may_only_lower(held: Scene) -> None:
    held.step(move(60, 55, 55))
    held.step(detections=THUMB_LATCHED, steps=2)
    assert held.step(arm=UP, slip=1.0, steps=2).hand is None
    exhausted = held.step(arm=ASIDE, steps=200)
    assert exhausted.exhausted and exhausted.hand is None
    over = held.step(arm=ASIDE, slip=0.0, steps=100)
    assert over.state is State.HOLD and over.exhausted and over.arm_velocity_mps == AT_REST
    assert held.step(arm=(0.1, 0.1, -0.1)).arm_velocity_mps == DOWN


def test_in_contact_only_the_thumb_closes_and_a_held_object_is_not_opened(grip: Scene) -> None:
    assert grip.step(move(70, 80, 50)).hand == move(55, 55, 50)  # the force was not read yet
    assert grip.step(move(50, 80, 55)).hand == move(50, 55, 55)  # not held yet: it may open
    grip.step(steps=HOLDS)
    kept = grip.step(move(48, 80, 50))
    assert kept.hand is None and "opening" in kept.refused[0]
    assert grip.step(move(70, 80, 50)).hand == move(57, 55, 55)  # 0.7 of the room to 10 N


def test_fingers_stay_where_they_are_commanded_unless_they_still_move(held: Scene) -> None:
    assert held.step(move(60, 80, 50), requested=(56, 56, 56)).hand == move(57, 56, 56)
    assert held.step(move(57, 80, 51), detections=(MOVES,) * 3).hand == move(57, 55, 55)


def test_a_velocity_drives_the_arm_and_none_stops_it_once(empty: Scene) -> None:
    drives, stops = list[Any](), list[float]()
    arm: Any = SimpleNamespace(
        state=ArmState(0, 0, AT_REST, AT_REST, True), stop=stops.append,
        drive=lambda *values: drives.append(values),
    )  # fmt: skip
    hand: Any = None  # it has no command
    empty.step(arm=UP).send(hand, arm)
    still = empty.step()
    still.send(hand, arm)
    arm.state = ArmState(0, 0, AT_REST, AT_REST, False)
    still.send(hand, arm)
    assert drives == [(UP, 0.0, 0.5)] and stops == [0.5]


def test_before_the_grasp_the_thumb_closes_by_one_count_after_each_reading(grip: Scene) -> None:
    for at, force_n in enumerate((2.0, 4.0, 6.0, 8.0), 55):
        grip.close_thumb(at, force_n)
        assert grip.step(move(70, 55, 55)).hand in (None, move(at, 55, 55))
        grip.step(steps=READ)
        more = grip.step(move(70, 55, 55)).hand
        assert more == (move(at + 1, 55, 55) if force_n < 8.0 else None)  # 2 N a count


def test_a_closing_for_slip_ends_at_the_measured_bound(held: Scene) -> None:
    first = held.step(slip=1.0, steps=2).hand
    assert isinstance(first, CloseToLimit) and first.ends_counts[0] == 57
    held.close_thumb(57, 8.0)  # 3 N a count: no room is left
    assert {type(held.step().hand) for _ in range(100)} == {type(None)}
    assert held.step(steps=20).exhausted


def test_a_closing_for_slip_goes_on_where_a_stage_leaves_room(held: Scene) -> None:
    held.step(slip=1.0, steps=2)
    held.close_thumb(57, 4.0)  # 1 N a count: room for 6 counts and the overshoot
    hands = [held.step().hand for _ in range(60)]
    assert {hand.ends_counts[0] for hand in hands if isinstance(hand, CloseToLimit)} == {64}


def test_b_and_c_that_met_an_object_close_again_only_after_the_hand_has_opened(
    empty: Scene,
) -> None:
    assert empty.step(move(60, 80, 80), force_n=(0.5, 0.0, 0.0)).hand == move(55, 55, 55)
    assert empty.step(move(61, 80, 80), force_n=AT_REST).hand == move(61, 55, 55)
    empty.step(move(50, 50, 50))
    assert empty.step(move(60, 80, 80)).hand == move(60, 80, 80)


def test_the_thumb_of_a_hand_stronger_than_the_limit_waits_for_b_and_c(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    strong = Scene(monkeypatch, AT_REST, limit_n=5.0)
    assert strong.step(move(70, 70, 55)).hand == move(55, 70, 55)
    assert strong.step(move(70, 55, 55)).hand == move(70, 55, 55)
    assert strong.step(move(71, 71, 71), force_n=(0.0, 0.5, 0.5)).hand == move(71, 55, 55)


def test_the_first_closing_of_a_hand_stronger_than_the_limit_is_one_count_by_a_guess(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    strong = Scene(monkeypatch, limit_n=8.0)
    strong.step(steps=HOLDS)
    first = strong.step(slip=1.0, steps=2).hand
    assert isinstance(first, CloseToLimit) and first.ends_counts[0] == 56
    assert first.force_limit_n == 10.0  # the least of this hand


def test_opening_is_refused_only_where_an_object_is_held(empty: Scene) -> None:
    opening = empty.step(move(0, 0, 0))
    assert opening.hand == move(0, 0, 0) and opening.refused == ()


def test_contact_by_the_hand_alone_stops_fingers_b_and_c(empty: Scene) -> None:
    assert empty.step(move(60, 80, 80)).hand == move(60, 80, 80)
    touching = empty.step(move(60, 81, 81), detections=(REST, TOUCHES, REST))
    assert touching.hand == move(60, 55, 55)


@pytest.mark.parametrize("force_n", [(2.0, 0.0, 0.0), (0.0, 1.0, 1.0)])
def test_the_arm_stands_still_only_once_both_sides_touch(empty: Scene, force_n: Vector3) -> None:
    one_side = empty.step(arm=UP, force_n=force_n, steps=HOLDS)
    assert one_side.arm_velocity_mps == UP and not one_side.held
    both = empty.step(arm=UP, force_n=GRIP, detections=THUMB_MOVES)
    assert both.arm_velocity_mps == AT_REST and "motion of the arm" in both.refused[0]


def test_the_arm_only_lowers_while_the_fingers_move(held: Scene) -> None:
    assert held.step(arm=ASIDE).arm_velocity_mps == ASIDE
    assert held.step(arm=ASIDE, detections=THUMB_MOVES).arm_velocity_mps == AT_REST
    assert held.step(arm=(0.1, 0.0, -0.1)).arm_velocity_mps == DOWN


def test_fingers_that_move_begin_the_wait_again(grip: Scene) -> None:
    grip.step(steps=HOLDS - 10)
    assert grip.step(move(50, 50, 50)).hand == move(50, 50, 50)  # which may open it
    assert not grip.step(steps=HOLDS - 10).held
    assert grip.step(detections=THUMB_MOVES).state is State.CLOSE
    assert not grip.step(detections=ALL_REST, steps=HOLDS - 10).held
    assert grip.step(steps=10).held


def test_a_release_ends_a_slip_response_and_the_hold(held: Scene) -> None:
    held.step(slip=1.0, steps=2)
    released = held.step(OpenFingers(0.1), slip=0.0)
    assert released.hand == OpenFingers(0.1)
    assert not released.held and not released.slip.registered
    assert held.step(steps=HOLDS).held and held.step(arm=DOWN).arm_velocity_mps == AT_REST


def test_a_closed_hand_goes_down_slowly_until_it_has_lifted_an_object(empty: Scene) -> None:
    slow = empty.step(arm=DOWN)
    assert slow.arm_velocity_mps == pytest.approx((0.0, 0.0, -0.0217), abs=1e-4)
    assert slow.refused == ("descent: at most 22 mm/s until an object is lifted",)
    assert empty.step(arm=DOWN, positions=(50, 50, 50)).arm_velocity_mps == slow.arm_velocity_mps
    touching = empty.step(arm=(0.1, 0.0, -0.1), force_n=(0.0, 1.0, 0.0), steps=10)
    assert touching.arm_velocity_mps == AT_REST and touching.arm_acceleration_mps2 == 8.0
    assert empty.step(force_n=GRIP, steps=HOLDS).held
    assert empty.step(arm=DOWN, height_m=0.009).arm_velocity_mps == AT_REST
    assert empty.step(arm=DOWN, height_m=0.011).arm_velocity_mps == DOWN
    assert empty.step(arm=DOWN, height_m=-0.1).arm_velocity_mps == DOWN


def test_an_open_hand_goes_down_as_wanted(empty: Scene) -> None:
    opened = empty.step(move(80, 80, 80), arm=DOWN, positions=(20, 20, 20), force_n=GRIP)
    assert opened.arm_velocity_mps == DOWN


def test_the_arm_is_no_faster_than_its_limit(empty: Scene) -> None:
    fast = empty.step(arm=(3.0, 0.0, 4.0))
    assert fast.arm_velocity_mps == pytest.approx((0.15, 0.0, 0.2))
    assert fast.refused == ("velocity of 5 m/s: the arm's limit is 0.25 m/s",)


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (np.zeros((3, 6)), "type float64"),
        (np.full((3, 6), np.nan), "type float64"),
        (np.zeros((6, 3), np.int16), r"shape \(6, 3\)"),
        (np.zeros(18, np.int16), r"shape \(18,\)"),
        (np.zeros((3, 0), np.int16), r"shape \(3, 0\)"),
        (np.zeros((3, 7), np.int16), r"shape \(3, 7\)"),
        (np.full((3, 6), 70_000), "from 70000 to 70000"),
        (np.full((3, 6), -1024), "from -1024 to -1024"),
        ([[1, 2], [3]], r"type object"),
        (None, r"type object and shape \(\)"),
    ],
)
def test_counts_that_are_none_are_refused(empty: Scene, wrong: NDArray[Any], problem: str) -> None:
    state = ArmState(0, 0, AT_REST, AT_REST, False)
    hold, zero = PolicyCommand(hand=HoldFingers()), np.zeros((3, 6), np.int16)
    frame = TactileFrame(0, 0, 0, wrong, zero, zero, zero)
    for tactile in (wrong, frame):
        with pytest.raises(UsageError, match=problem) as caught:
            empty.reflex.step(tactile, gripper(), state, hold, t_ns=0)
        assert "integers of shape (3, 6) from -1023 to 1023" in caught.value.remedy
    with pytest.raises(UsageError, match=problem):
        empty.reflex.step(TactileFrame(0, 0, 0, zero, wrong, zero, zero), gripper(), state, hold)


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ({"arm": None}, "at `arm`"),
        ({"gripper": None}, "at `gripper`"),
        ({"arm": ArmState(0, 0, None, AT_REST, False)}, "at `arm.position_m`"),  # type: ignore[arg-type]
        ({"arm": ArmState(0, 0, (0.0, 0.0), AT_REST, False)}, "of length 3, got 2"),  # type: ignore[arg-type]
        ({"arm": ArmState(0, 0, AT_REST, object(), False)}, "tolist"),  # type: ignore[arg-type]
        ({"gripper": msgspec.structs.replace(gripper(), fingers=())}, "of length 3, got 0"),
        ({"gripper": msgspec.structs.replace(gripper(), t_ns=None)}, "at `gripper.t_ns`"),
        ({"t_ns": 0.5}, "got `float` - at `time`"),
        ({"t_ns": 2**63}, "at `time`"),
        ({"gripper": msgspec.structs.replace(gripper(), took_ns=10**400)}, "serialize ints"),
        ({"gripper": msgspec.structs.replace(gripper(), fault_text="\ud800")}, "surrogates"),
        ({"t_ns": -1}, "the time went back"),
    ],
)
def test_a_state_or_a_time_that_is_none_is_refused_and_changes_nothing(
    grip: Scene, wrong: dict[str, Any], problem: str
) -> None:
    grip.step(steps=HOLDS - 5)
    arm = ArmState(grip.t_ns, 0, AT_REST, AT_REST, False)
    given = {"gripper": gripper(grip.t_ns), "arm": arm, "t_ns": grip.t_ns + PERIOD_NS, **wrong}
    with pytest.raises(UsageError, match=problem):
        grip.reflex.step(grip.counts(), wanted=PolicyCommand(hand=HoldFingers()), **given)
    assert not grip.last.held and grip.step(steps=5).held


def test_states_of_numpy_numbers_are_taken(empty: Scene) -> None:
    fingers = [msgspec.structs.replace(f, detection=3) for f in gripper().fingers]
    hand = msgspec.structs.replace(gripper(), fingers=fingers, t_ns=np.int64(0))
    arm = ArmState(0, 0, np.zeros(3), (np.float32(0), 0, 0), np.bool_(False))  # type: ignore[arg-type]
    counts, hold = np.zeros((3, 6), np.int16), PolicyCommand(hand=HoldFingers())
    admitted = empty.reflex.step(counts, hand, arm, hold, t_ns=np.int64(0))  # type: ignore[arg-type]
    assert admitted.faults == () and empty.reflex.last_step is not None
    assert empty.reflex.last_step.observation.arm == ArmState(0, 0, AT_REST, AT_REST, False)


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (PolicyCommand(hand=MoveFingers((60, 60, 60), 0.022, float("nan"))), "force_n: nan"),
        (PolicyCommand(hand=MoveFingers((60, 60, 60), float("inf"), 10.0)), "speed_mps: inf"),
        (PolicyCommand(hand=MoveFingers((60, 60, 60), -0.022, 10.0)), "speed_mps: -0.022"),
        (PolicyCommand(hand=MoveFingers((60, 60, 60), 0.022, 10**400)), "force_n: 1000"),
        (PolicyCommand(hand=MoveFingers((60, 60, 256), 0.022, 10.0)), "targets_counts: ("),
        (
            PolicyCommand(hand=HoldFingers(), arm_velocity_mps=(0.0, 0.0, float("nan"))),
            "arm_velocity_mps: (",
        ),
        (
            PolicyCommand(hand=HoldFingers(), arm_velocity_mps=np.zeros(3)),  # type: ignore[arg-type]
            "arm_velocity_mps: array([",
        ),
        (
            PolicyCommand(hand=HoldFingers(), arm_velocity_mps=[0, 0, 0]),  # type: ignore[arg-type]
            "arm_velocity_mps: [0, 0, 0] is not a tuple of three",
        ),
        (
            PolicyCommand(hand=MoveFingers([60, 60, 60], 0.022, 10.0)),  # type: ignore[arg-type]
            "targets_counts: [60, 60, 60] is not a tuple of three",
        ),
        (
            PolicyCommand(hand=MoveFingers((60, 60), 0.022, 10.0)),  # type: ignore[arg-type]
            "targets_counts: (60, 60)",
        ),
        (
            PolicyCommand(
                hand=MoveFingers((60, np.zeros(2), None), 0.022, 10.0)  # type: ignore[arg-type]
            ),
            "targets_counts: (60, array(",
        ),
        (PolicyCommand(hand=OpenFingers(float("nan"))), "speed_mps: nan"),
        (PolicyCommand(hand=None), "hand: None"),  # type: ignore[arg-type]
        ([0.0, 0.1], "[0.0, 0.1] is not a PolicyCommand"),
    ],
)
def test_an_invalid_command_is_named_and_holds_hand_and_arm(
    empty: Scene, wrong: PolicyCommand, name: str
) -> None:
    admitted = empty.send(wrong)
    assert admitted.hand is None and admitted.arm_velocity_mps == AT_REST
    (refusal,) = admitted.refused
    assert refusal.startswith(name) and refusal.endswith(": hand and arm hold")


def test_counts_with_the_opposite_sign_are_a_fault(grip: Scene) -> None:
    grip.sign = 1.0
    assert grip.step(steps=30).faults == ()
    (fault,) = grip.step(steps=2).faults
    assert fault.code == "fingertips_unpressed"
