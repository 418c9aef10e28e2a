"""Abort where no step is possible: each device is commanded separately until it confirms."""

from typing import Any

import pytest

from drivers.errors import LinkLost
from drivers.interfaces import Detection
from grasp.control.commands import CloseToLimit, MoveArm, StopArm
from tests.unit.grasp.builders import REST, arm, gripper
from tests.unit.grasp.loop_bench import MS, Bench

RISE = MoveArm((0.1, 0.2, 0.3), 0.04, 0.6)


def test_abort_commands_each_device_although_others_fail() -> None:
    bench = Bench(abort_s=0.2)
    bench.loop.tick()
    bench.decides = [(RISE,)]
    bench.loop.tick()
    bench.arm.state = arm(moving=True)
    bench.raises["stop"] = ValueError("a bug")
    left = bench.loop.abort()
    assert set(bench.verbs()) == {("hold",)}
    assert bench.clock.now_ns == 10**9 + 220 * MS
    assert left is not None
    assert left.arm.moving
    assert left.t_ns == bench.clock.now_ns


@pytest.mark.parametrize("hand", [{"fresh": False}, {"detections": (REST, Detection.MOVING, REST)}])
def test_an_abort_waits_for_a_hand_that_moves(
    hand: dict[str, Any],
) -> None:
    bench = Bench(abort_s=0.2)
    bench.loop.tick()
    bench.hand.state = gripper(2 * 10**9, **hand)
    bench.arm.state = arm(2 * 10**9)
    left = bench.loop.abort()
    assert bench.verbs() == [("stop", 2.0), ("hold",)] * 4
    assert left is not None
    assert not left.gripper.at_rest
    assert bench.clock.now_ns == 10**9 + 210 * MS


def test_abort_ignores_states_from_before_it() -> None:
    bench = Bench(abort_s=0.2)
    bench.loop.tick()
    bench.hand.state, bench.arm.state = gripper(10**9), arm(10**9)
    bench.raises["gripper poll"] = LinkLost("gone", "look")
    left = bench.loop.abort()
    assert bench.clock.now_ns == 10**9 + 210 * MS
    assert bench.verbs() == [("stop", 2.0), ("hold",)] * 4
    assert left is not None and left.observation.gripper_lost


@pytest.mark.parametrize("bug", [SystemExit(0), KeyboardInterrupt(), ValueError("a bug")], ids=repr)
@pytest.mark.parametrize("device", ["arm poll", "gripper poll", "board poll", "hold"])
def test_abort_stops_the_arm_although_devices_raise(bug: BaseException, device: str) -> None:
    bench = Bench(abort_s=0.2)
    bench.loop.tick()
    bench.clock.sleep_until_ns(bench.clock.now_ns + 5 * MS)  # so that the arm is asked first
    bench.raises[device] = bug
    assert bench.loop.abort() is not None
    assert ("stop", 2.0) in bench.verbs()
    assert ("hold",) in bench.verbs() or device == "hold"


def test_abort_ends_once_confirmed_and_does_not_restart_a_closing() -> None:
    bench = Bench(abort_s=0.3)
    bench.controller.abort_commands = lambda: (
        StopArm(2.0),
        CloseToLimit(9.0, (True,) * 3, (9, 9, 9), 0.1),
    )
    bench.loop.tick()
    bench.arm.state = arm(2 * 10**9)
    bench.hand.state = gripper(2 * 10**9, detections=(REST, Detection.MOVING, REST))

    def rests(now_ns: int) -> None:
        if now_ns >= 10**9 + 130 * MS:
            bench.hand.state = gripper(2 * 10**9)

    bench.hand.poll = rests
    bench.loop.abort()
    assert bench.clock.now_ns == 10**9 + 160 * MS
    assert [name for name, *_ in bench.verbs()] == ["stop", "close_to_limit", "stop", "stop"]
