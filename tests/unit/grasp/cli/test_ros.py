"""What a ROS client may choose of a lift, the command line of a lift, and a missing ROS."""

import os
import signal
from pathlib import Path

import pytest

from drivers.errors import UsageError
from grasp.cli import ros
from grasp.cli.child import Child
from grasp.cli.commands import build_parser
from grasp.cli.main import main
from grasp.cli.ros_lifts import Goal, Lifts
from grasp.clock import WallClock
from grasp.controller import Decision
from grasp.loop import Tick
from grasp.slip_monitor import ARMED
from grasp.states import State
from scenarios.report.step_feed import Begin, Step, StepFeed
from tests.unit.grasp.builders import observation


def lifts(*words: str) -> Lifts:
    return Lifts(build_parser().parse_args(["ros", *words]))


def test_a_lift_has_the_options_of_the_node_and_its_own_seed() -> None:
    node = lifts("--rig", "simulated", "--seed", "7", "--set", "hand.activation_s=1",
                 "--detector", "energy", "--runs", "there")  # fmt: skip
    first, second = (build_parser().parse_args(node.words(goal)) for goal in (Goal(), Goal("ball")))
    assert (first.command, first.rig, first.pace, first.runs) == (
        "run lift", "simulated", "real", Path("there"),
    )  # fmt: skip
    assert (first.object, first.seed, second.object, second.seed) == ("can", 7, "ball", 8)
    assert first.set == ["hand.activation_s=1"] and first.detector == "energy"
    assert not first.confirm_motion and node.permit is None


def test_a_goal_names_packaged_parts_and_changes_no_limit(tmp_path: Path) -> None:
    node = lifts("--rig", "simulated")
    assert node.problem(Goal()) == node.problem(Goal("ball", "default")) == ""
    file = tmp_path / "can.toml"
    for goal, text in (
        (Goal(str(file)), "is unknown in objects"),
        (Goal("can", "../paper"), "is unknown in profiles"),
        (Goal("can --confirm-motion"), "is unknown in objects"),
        (Goal("can", "paper"), "changes the force guard"),
    ):
        assert text in node.problem(goal)
    assert lifts("--rig", "simulated", "--profile", "paper").problem(Goal("can", "paper")) == ""


def test_real_devices_need_a_confirmation_of_the_node_itself() -> None:
    with pytest.raises(UsageError, match="moves real devices"):
        lifts("--rig", "hardware")


def test_a_missing_ros_is_one_line_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ros, "find_spec", lambda name: None)
    assert main(["ros", "--rig", "simulated"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "rclpy" in line and "source a ROS 2" in line and "grasp-controller[ros]" in line


def test_a_lift_feeds_its_steps_until_it_is_stopped(tmp_path: Path) -> None:
    words = lifts("--rig", "simulated", "--runs", str(tmp_path)).words(Goal())
    child = Child(words, feeds=True)
    lines = child.lines()
    assert isinstance(next(lines), Begin)
    assert any(isinstance(line, Step) and line.control.phase == "lift" for line in lines)
    child.stop()
    *_, last = lines
    assert isinstance(last, Step) and last.control.phase == "stopped"
    printed = child.result()
    assert printed["error"]["kind"] == "interrupted"
    assert printed["result"]["end"]["unconfirmed"] == []


def test_a_feed_never_waits_and_stops_its_process_when_nobody_reads() -> None:
    reads, writes = os.pipe()
    feed, received = StepFeed(writes), []
    tick = Tick(observation(0), Decision(State.LIFT, ARMED, ()), ())
    before = signal.signal(signal.SIGTERM, lambda number, _: received.append(number))
    try:
        feed.begin(WallClock())
        for _ in range(1000):  # more than the pipe holds
            feed.watch(tick, None, None)  # type: ignore[arg-type]
        *lines, last = os.read(reads, 1 << 20).split(b"\n")
        assert last == b"" and 10 < len(lines) < 1000  # whole lines only
        assert received == []
        os.close(reads)
        for _ in range(3):
            feed.watch(tick, None, None)  # type: ignore[arg-type]
        assert received == [signal.SIGTERM]
    finally:
        signal.signal(signal.SIGTERM, before)
        os.close(writes)
