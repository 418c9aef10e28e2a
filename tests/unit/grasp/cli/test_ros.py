"""What a ROS client may choose of a lift, the command line of a lift, and a missing ROS."""

import math
import os
import signal
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from drivers.errors import ConfigError, UsageError
from grasp.cli import ros, ros_lifts
from grasp.cli.child import Child
from grasp.cli.commands import RosOptions, build_parser
from grasp.cli.main import main
from grasp.cli.ros_lifts import ClientResult, Goal, Lifts, Slot
from grasp.control.slip_monitor import ARMED
from grasp.control.states import State
from grasp.control.transition import Decision
from grasp.run.clock import WallClock
from grasp.run.loop import Tick
from scenarios.report.step_feed import Begin, Step, StepFeed
from tests.unit.grasp.builders import observation


def lifts(*words: str) -> Lifts:
    return Lifts(RosOptions.of(build_parser().parse_args(["ros", *words])))


def test_a_lift_has_the_options_of_the_node_and_its_own_seed() -> None:
    node = lifts("--rig", "simulated", "--seed", "7", "--set", "hand.activation_s=1",
                 "--detector", "energy", "--runs", "there")  # fmt: skip
    first, second = (build_parser().parse_args(node.words(goal)) for goal in (Goal(), Goal("ball")))
    assert (first.command, first.rig, first.pace, first.runs) == (
        "run lift", "simulated", "real", Path("there"),
    )  # fmt: skip
    assert (first.object, first.seed, second.object, second.seed) == (None, 7, "ball", 8)
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


def test_a_settings_file_that_becomes_a_pipe_refuses_the_goal(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[hand]\nactivation_s = 1.0\n")
    node = lifts("--rig", "simulated", "--config", str(file))
    assert node.problem(Goal()) == ""
    file.unlink()
    os.mkfifo(file)
    assert "is no regular file" in node.problem(Goal())
    with pytest.raises(ConfigError, match="is no regular file"):
        lifts("--rig", str(file))


@pytest.mark.parametrize(
    ("printed", "success", "verdict", "slip_m"),
    [
        ({"success": True, "outcome": "held", "slip_distance_m": 0.01}, True, "held", 0.01),
        ({"success": False, "outcome": "dropped"}, False, "dropped", None),
        ({"success": None, "outcome": "interrupted"}, False, "interrupted", None),
        ({"error": {"kind": "link_lost", "message": "no arm"}}, False, "link_lost", None),
        (
            {"error": {"kind": "stale"}, "result": {"success": False, "outcome": "fault"}},
            False, "fault", None,
        ),
    ],
)  # fmt: skip
def test_a_client_is_told_success_only_of_a_lift_that_was_one(
    printed: dict[str, Any], success: bool, verdict: str, slip_m: float | None
) -> None:
    outcome = ClientResult.of({"peak_force_n": {"A": 4.0}, **printed})
    assert (outcome.success, outcome.verdict) == (success, verdict)
    assert outcome.slip_distance_m == slip_m or math.isnan(outcome.slip_distance_m)
    assert outcome.peak_force_n[0] == 4.0 or "error" in printed


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> Mock:
    made = Mock()
    monkeypatch.setattr(ros_lifts, "Child", lambda words, feeds: made)
    return made


def test_a_stop_reaches_a_lift_whose_process_does_not_exist_yet(child: Mock) -> None:
    slot = Slot()
    slot.stopping = False
    assert not slot.stop()  # it was accepted, and has not begun
    with slot.taken() as free:
        assert free and slot.busy.locked()
        slot.start(["run", "lift"], lift=True)
        assert child.stop.call_count == 1
    slot.stopping = False
    child.reset_mock()
    with slot.taken():
        slot.start(["run", "lift"], lift=True)
        assert child.stop.call_count == 0  # the stop was not for this one
        assert slot.stop() and child.stop.call_count == 1


def test_one_command_runs_at_a_time_and_an_exception_ends_it(child: Mock) -> None:
    slot = Slot()
    with pytest.raises(OSError, match="pipe"), slot.taken():
        slot.start(["release"])
        with slot.taken() as free:
            assert not free
        assert slot.busy.locked() and child.stop.call_count == 0
        raise OSError("pipe")
    assert not slot.busy.locked() and child.stop.call_count == 1
    with slot.taken() as free:
        assert free


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


@pytest.mark.parametrize("domain", ["banana", "233", "-1", "²"])
def test_a_domain_that_ros_has_not_is_refused_before_the_start(
    domain: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    assert main(["ros", "--rig", "simulated"]) == 2
    assert "a whole number from 0 to 232" in capsys.readouterr().err


def test_the_emulated_rig_has_no_other_pace(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ros", "--pace", "max"]) == 2
    assert "--pace max is of the rig simulated" in capsys.readouterr().err
