"""First grasp by touch: what each observation leads to."""

import msgspec

from drivers.interfaces import Counts3, Detection, Vector3
from grasp.control.commands import GripperCommand, HoldFingers, MoveFingers
from grasp.control.controller_settings import ControllerSettings
from grasp.control.grip_measure import Reading
from grasp.control.observation import Observation
from grasp.control.touch import BRACE_COUNTS, CLOSED_COUNTS, OTHERS_COUNTS, SILENT_COUNTS, Touch
from tests.unit.grasp.builders import gripper, observation

SETTINGS = ControllerSettings(first_grasp="touch", first_force_n=2.0, contact_n=0.3)
MOVES = (Detection.MOVING,) * 3
NO_FORCE = (0.0, 0.0, 0.0)


class Hand:
    """A hand that obeys at once, and rests where it was commanded to unless told otherwise."""

    def __init__(self) -> None:
        self.touch = Touch(SETTINGS, 10.0)
        self.t_ns = 0
        self.at: Counts3 = (6, 6, 6)
        self.obey(self.touch.begin(self.seen()))

    def seen(
        self, estimated_n: Vector3 = NO_FORCE, moves: bool = False, **more: object
    ) -> Observation:
        self.t_ns += 10_000_000
        a_n, b_n, c_n = estimated_n
        hand = gripper(self.t_ns, self.at, MOVES) if moves else gripper(self.t_ns, self.at)
        reading = None if moves else Reading(self.at, (a_n, b_n + c_n), False)
        values = {"rise_n": 1.9, "rise_measured": True, "reading": reading, **more}
        return observation(self.t_ns, gripper=hand, estimated_n=estimated_n, **values)

    def obey(self, command: GripperCommand | None) -> GripperCommand | None:
        if isinstance(command, MoveFingers):
            self.at = command.targets_counts
        return command

    def moving(self, estimated_n: Vector3) -> GripperCommand | None:
        return self.obey(self.touch.update(self.seen(estimated_n, moves=True)))

    def resting(self, estimated_n: Vector3 = NO_FORCE, **more: object) -> GripperCommand | None:
        return self.obey(self.touch.update(self.seen(estimated_n, **more)))

    def braced(self) -> "Hand":
        self.resting()
        assert self.touch.braced
        return self

    def gripping(self, estimated_n: Vector3) -> "Hand":
        """The thumb has met the object at 60 counts, and B and C too."""
        self.braced()
        assert isinstance(self.moving(estimated_n), HoldFingers)
        self.at = (60, 30, 30)
        return self


def test_b_and_c_brace_first_then_the_thumb_closes() -> None:
    hand = Hand()
    assert hand.at == (6, BRACE_COUNTS, BRACE_COUNTS)
    assert hand.moving(NO_FORCE) is None
    hand.braced()
    assert hand.at == (CLOSED_COUNTS, BRACE_COUNTS, BRACE_COUNTS)


def test_finger_that_feels_the_object_holds_and_a_lost_hold_is_repeated() -> None:
    for estimated_n in ((0.0, 0.1, 0.0), (0.0, 0.0, 0.1), (0.5, 0.0, 0.0)):
        hand = Hand()
        assert hand.moving((0.49, 0.09, 0.09)) is None
        assert isinstance(hand.moving(estimated_n), HoldFingers)
        again = [hand.moving(estimated_n) for _ in range(30)]
        assert [type(c) for c in again] == [type(None)] * 29 + [HoldFingers]
    thumb = Hand().braced()
    assert thumb.moving((0.09, 0.2, 0.2)) is None
    assert isinstance(thumb.moving((0.1, 0.0, 0.0)), HoldFingers)
    dead = Hand().braced()
    assert isinstance(dead.moving((0.0, 0.3, 0.2)), HoldFingers)  # onto the other side


def test_only_a_rise_since_the_motion_began_is_felt() -> None:
    hand = Hand()
    hand.resting((0.0, 0.0, 0.0))
    offset = Hand()
    offset.touch.begin(offset.seen((1.0, 1.0, 1.0)))
    assert offset.moving((1.05, 1.05, 1.05)) is None
    assert isinstance(offset.moving((1.0, 1.1, 1.0)), HoldFingers)


def test_b_and_c_come_to_an_object_that_only_the_thumb_has_met() -> None:
    hand = Hand().gripping((0.2, 0.0, 0.0))
    command = hand.resting((0.2, 0.0, 0.0))
    assert isinstance(command, MoveFingers)
    assert command.targets_counts == (60, CLOSED_COUNTS, CLOSED_COUNTS)


def test_side_that_feels_less_closes_by_one_count_until_the_first_force() -> None:
    hand = Hand().gripping((0.5, 0.2, 0.2))
    steps: list[tuple[Vector3, Counts3]] = [
        ((0.5, 0.2, 0.2), (61, 30, 30)), ((0.9, 0.2, 0.1), (61, 30, 31)),
        ((0.9, 0.1, 0.2), (61, 31, 31)), ((0.9, 0.4, 0.4), (62, 31, 31)),
    ]  # fmt: skip
    for estimated_n, targets in steps:
        command = hand.resting(estimated_n)
        assert isinstance(command, MoveFingers) and command.targets_counts == targets, estimated_n
    assert hand.resting((1.05, 0.5, 0.5)) is None  # half a count less is near enough
    assert hand.touch.complete


def test_grip_is_complete_only_with_a_measured_stiffness_or_without_room_for_a_count() -> None:
    hand = Hand().gripping((0.5, 0.2, 0.2))
    assert isinstance(hand.resting((2.0, 1.0, 1.0), rise_measured=False), MoveFingers)
    assert not hand.touch.complete
    hand.resting((9.0, 4.5, 4.5), rise_measured=False)
    assert hand.touch.complete


def test_object_that_was_felt_late_is_loosened_first() -> None:
    hand = Hand().gripping((5.0, 2.5, 2.5))
    command = hand.resting((5.0, 2.5, 2.5))
    assert isinstance(command, MoveFingers) and command.targets_counts == (59, 30, 30)


def test_empty_hand_silent_side_and_stiff_object_end_the_grasp_with_a_remedy() -> None:
    empty = Hand().braced()
    empty.resting()
    assert empty.touch.failed is not None and "nothing is between" in empty.touch.failed[0]
    silent = Hand().gripping((0.0, 0.3, 0.3))
    for _ in range(SILENT_COUNTS + 1):
        silent.resting((0.0, 0.5, 0.5))
    assert silent.touch.failed is not None and "finger A feels nothing" in silent.touch.failed[0]
    stiff = Hand().gripping((0.5, 0.2, 0.2))
    stiff.resting((0.8, 0.4, 0.4), rise_n=9.5)
    assert stiff.touch.failed is not None and "9.5 N" in stiff.touch.failed[0]
    for hand in (empty, silent, stiff):
        assert hand.touch.failed is not None and hand.touch.failed[1]


def test_contact_that_shows_no_force_is_not_believed() -> None:
    hand = Hand().gripping((0.1, 0.1, 0.0))
    for _ in range(SILENT_COUNTS):
        assert isinstance(hand.resting((0.1, 0.1, 0.0)), MoveFingers)
    hand.resting((0.1, 0.1, 0.0))
    assert hand.at[0] == CLOSED_COUNTS  # the thumb closes on


def test_thumb_that_a_weak_hand_latches_completes_the_grip() -> None:
    hand = Hand().gripping((0.5, 0.2, 0.2))
    latched = gripper(0, (60, 30, 30), (Detection.CONTACT_CLOSING, *MOVES[1:]))
    rests = msgspec.structs.replace(
        latched, fingers=(latched.fingers[0], *gripper(0, (60, 30, 30)).fingers[1:])
    )
    hand.touch.update(hand.seen((0.9, 0.5, 0.5)))
    obs = hand.seen((0.9, 0.5, 0.5), rise_measured=False)
    hand.touch.update(msgspec.structs.replace(obs, gripper=rests))
    assert hand.touch.complete


def test_one_side_presses_no_harder_than_its_share_while_the_other_feels_nothing() -> None:
    hand = Hand().gripping((1.0, 0.2, 0.0))
    assert isinstance(hand.resting((3.0, 0.2, 0.0)), MoveFingers)
    assert hand.resting((4.2, 0.2, 0.0)) is None  # 0.6 of 10 N, less a count of 1.9 N
    assert hand.touch.failed is not None
    assert hand.touch.failed[0] == "fingers B and C feel nothing, the other side 4.2 N"


def test_opposing_fingers_that_always_read_too_little_close_by_a_dozen_counts_at_most() -> None:
    hand = Hand().gripping((1.0, 0.2, 0.2))
    while hand.at[0] == 60:
        assert isinstance(hand.resting((1.0, 0.2, 0.2), rise_n=0.5), MoveFingers)
    assert sum(hand.at[1:]) - 60 == OTHERS_COUNTS


def test_the_thumb_closes_once_the_force_is_reached_also_where_the_others_read_less() -> None:
    hand = Hand().gripping((1.0, 0.5, 0.4))
    assert hand.resting((3.0, 0.5, 0.4), rise_measured=False) is not None
    assert hand.at == (61, 30, 30)
