"""Where no step can be taken any more: each device is made safe by itself, and seen to be."""

from typing import Any

import pytest

from drivers.errors import LinkLost
from drivers.interfaces import Detection
from grasp.commands import CloseFast, MoveArm, StopArm
from tests.unit.grasp.builders import REST, arm, gripper
from tests.unit.grasp.loop_bench import MS, Bench

CLOSE = CloseFast(9.0, (True, False, True), (4, 5, 6), 0.03)
RISE = MoveArm((0.1, 0.2, 0.3), 0.04, 0.6)


def test_abort_tells_each_device_by_itself_whatever_the_others_do() -> None:
    bench = Bench(abort_s=0.2, abort_repeat_s=0.1)
    bench.loop.tick()
    bench.decides = [(RISE,)]
    bench.loop.tick()
    bench.arm.state = arm(moving=True)
    bench.raises["stop"] = ValueError("a bug")
    left = bench.loop.abort()
    assert bench.verbs() == [("hold",)]
    assert bench.clock.now_ns == 10**9 + 220 * MS
    assert left is not None
    assert left.arm.moving
    assert left.t_ns == bench.clock.now_ns


@pytest.mark.parametrize("hand", [{"fresh": False}, {"detections": (REST, Detection.MOVING, REST)}])
def test_an_abort_waits_for_a_hand_that_moves_and_tells_an_arm_that_stands_to_stop_once(
    hand: dict[str, Any],
) -> None:
    bench = Bench(abort_s=0.2, abort_repeat_s=0.05)
    bench.loop.tick()
    bench.hand.state = gripper(2 * 10**9, **hand)
    bench.arm.state = arm(2 * 10**9)
    left = bench.loop.abort()
    assert bench.verbs() == [("stop", 2.0), ("hold",)]
    assert left is not None
    assert not left.gripper.at_rest
    assert bench.clock.now_ns == 10**9 + 210 * MS


def test_an_abort_tells_a_hand_again_that_rests_and_is_not_as_it_was_told() -> None:
    bench = Bench(abort_s=0.2, abort_repeat_s=0.05)
    bench.loop.tick()
    bench.hand.state, bench.arm.state = gripper(2 * 10**9), arm(2 * 10**9)
    bench.missing_of_hand = ("the hand is not as it should be",)
    bench.loop.abort()
    assert bench.verbs() == [("stop", 2.0), *[("hold",)] * 4]


def test_an_abort_believes_no_state_from_before_it() -> None:
    bench = Bench(abort_s=0.2, abort_repeat_s=0.05)
    bench.loop.tick()
    bench.hand.state, bench.arm.state = gripper(10**9), arm(10**9)
    bench.raises["gripper pump"] = LinkLost("gone", "look")
    left = bench.loop.abort()
    assert bench.clock.now_ns == 10**9 + 210 * MS
    assert bench.verbs() == [("stop", 2.0), ("hold",), *[("stop", 2.0)] * 3]
    assert left is not None and left.observation.gripper_lost


@pytest.mark.parametrize("bug", [SystemExit(0), KeyboardInterrupt(), ValueError("a bug")], ids=repr)
@pytest.mark.parametrize("device", ["arm pump", "gripper pump", "board pump", "hold"])
def test_an_abort_stops_the_arm_whatever_the_devices_raise(bug: BaseException, device: str) -> None:
    bench = Bench(abort_s=0.2, abort_repeat_s=0.05)
    bench.loop.tick()
    bench.clock.sleep_until_ns(bench.clock.now_ns + 5 * MS)  # so that the arm is asked first
    bench.raises[device] = bug
    assert bench.loop.abort() is not None
    assert ("stop", 2.0) in bench.verbs()
    assert ("hold",) in bench.verbs() or device == "hold"


def test_an_abort_does_not_begin_a_closing_anew_while_it_lasts() -> None:
    bench = Bench(abort_s=0.2, abort_repeat_s=0.05)
    bench.controller.aborted = lambda: (StopArm(2.0), CLOSE)
    bench.loop.tick()
    bench.hand.state = gripper(2 * 10**9, detections=(REST, Detection.MOVING, REST))
    bench.arm.state = arm(2 * 10**9)
    bench.missing_of_hand = ("the hand is not as it should be",)
    bench.loop.abort()
    assert [name for name, *_ in bench.verbs()] == ["stop", "close_fast"]
