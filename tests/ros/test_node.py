"""The ROS 2 node and a client in another process."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from scenarios.rigs.emulated import ControlClient
from tests.ros.conftest import GRASP, PATIENCE_S, SETS, Client, Start, process
from tests.wire.lab import emulate, lab_file

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # of action_msgs/msg/GoalStatus
TICK_NS = 10_000_000
SUBSCRIBER = """
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("stalls")
take = lambda message: print("seen", flush=True)
node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
node.create_subscription(JointState, "/grasp/joint_states", take, qos_profile_sensor_data)
rclpy.spin(node)
"""
# the node, whose answer to the first goal cannot be sent
LOSES_AN_ANSWER = """
import sys
from rclpy.action.server import RCLError, ServerGoalHandle
from grasp.cli.main import main

class Lost:
    def __init__(self, server):
        self._server, self._handle = server, server._handle

    def send_goal_response(self, *_):
        self._server._handle = self._handle
        raise RCLError("the client is gone")

    def __getattr__(self, name):
        return getattr(self._handle, name)

init = ServerGoalHandle.__init__

def first(self, server, *rest):
    ServerGoalHandle.__init__ = init
    init(self, server, *rest)
    server._handle = Lost(server)

ServerGoalHandle.__init__ = first
sys.exit(main())
"""
AT_ONCE = 30  # requests; more than the middleware keeps by default


def stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


def results(folder: Path) -> list[dict[str, Any]]:
    """Results of the lifts that have ended, in order."""
    return [json.loads(path.read_text()) for path in sorted(folder.glob("runs/*/result.json"))]


def children(pid: int) -> list[int]:
    """Child processes of a process."""
    found = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for path in found for child in path.read_text().split()]


def wait_until_gone(pid: int) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while Path(f"/proc/{pid}").exists():
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        if state == "Z":
            return
        assert time.monotonic() < deadline
        time.sleep(0.05)


def ended_safely(result: dict[str, Any]) -> bool:
    """Whether arm and hand confirmed their safe state after an interruption."""
    return result["outcome"] == "interrupted" and result["end"]["unconfirmed"] == []


def test_topics_of_a_lift_arrive_at_the_tactile_rate(client: Client, start: Start) -> None:
    from geometry_msgs.msg import PointStamped, WrenchStamped
    from rclpy.qos import qos_profile_sensor_data as sensor
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float32MultiArray

    start("--rig", "emulated")
    wrench = client.messages("/grasp/finger_a/wrench", WrenchStamped, sensor)
    joints = client.messages("/grasp/joint_states", JointState, sensor)
    tool = client.messages("/grasp/tool_position", PointStamped, sensor)
    taxels, slip = (client.messages(f"/grasp/{name}", Float32MultiArray, sensor)
                    for name in ("taxels", "slip"))  # fmt: skip
    states = client.follow_state()
    before_ns = time.time_ns()
    feedback: list[list[int]] = []
    handle = client.send_lift(feedback)
    result = client.result(handle.get_result_async(), "the lift")
    after_ns = time.time_ns()
    client.until(lambda: states[-1].data == "idle", "idle")
    assert result.status == SUCCEEDED
    succeeded, slip_mm, *peak_mn = result.result.sequence
    assert succeeded == 1000 and 0 <= slip_mm < 60 and all(2000 < n < 20_000 for n in peak_mn)
    assert {"starting", "lift", "hold", "idle"} <= {message.data for message in states}
    assert len(feedback) > 10 and {len(values) for values in feedback} == {7}
    for messages in (wrench, joints, tool):
        stamps = [stamp_ns(message) for message in messages]
        assert len(stamps) > 50 and before_ns < stamps[0] < stamps[-1] < after_ns
    # a step without a new sample repeats the last one, on a slow machine often
    stamps = sorted({stamp_ns(message) for message in wrench})
    steps_ns = sorted(b - a for a, b in pairwise(stamps))
    fastest_ns = steps_ns[len(steps_ns) // 10]
    assert abs(fastest_ns - TICK_NS) < TICK_NS / 2
    assert max(message.wrench.force.z for message in wrench) > 2.0
    assert {len(message.name) for message in joints} == {9}  # the hand's, the arm's
    assert [dim.label for dim in taxels[-1].layout.dim] == ["finger", "taxel"]
    assert len(taxels[-1].data) == 18 and len(slip[-1].data) == 4


def test_a_canceled_lift_stops_the_arm_and_keeps_the_grip(
    client: Client, start: Start, tmp_path: Path
) -> None:
    start("--rig", "emulated")
    states = client.follow_state()
    handle = client.send_lift()
    client.until(lambda: states[-1].data == "lift", "the lift")
    client.result(handle.cancel_goal_async(), "cancel")
    result = client.result(handle.get_result_async(), "the end")
    assert result.status == CANCELED
    (ended,) = results(tmp_path)
    assert ended_safely(ended) and not ended["end"]["open"]


def test_services_during_and_after_a_lift(client: Client, start: Start, tmp_path: Path) -> None:
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    start("--rig", "simulated")
    states = client.follow_state()
    assert client.trigger("stop") == (True, "nothing is running")
    handle = client.send_lift()
    client.until(lambda: states[-1].data == "lift", "the lift")
    refused = client.result(client.send_lift().get_result_async(), "the refusal")
    assert refused.status == ABORTED and refused.result.sequence[0] == 0
    assert client.trigger("release") == (False, "refused: a lift or a release is running")
    assert client.trigger("stop")[0]
    result = client.result(handle.get_result_async(), "the end")
    assert result.status == ABORTED and result.result.sequence[0] == 0
    assert ended_safely(results(tmp_path)[0])
    client.until(lambda: states[-1].data == "idle", "idle")
    released, why = client.trigger("release")
    assert not released and "no hand is closed" in why
    rig = Parameter("rig", value="hardware").to_parameter_msg()
    request = SetParameters.Request(parameters=[rig])
    (answer,) = client.call(SetParameters, "/grasp/set_parameters", request).results
    assert not answer.successful


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_lift_ends_safely_when_its_node_is_killed_or_interrupted(
    number: int, client: Client, start: Start, tmp_path: Path
) -> None:
    node = start("--rig", "emulated")
    states = client.follow_state()
    client.send_lift()
    client.until(lambda: states[-1].data == "lift", "the lift")
    (lift,) = children(node.pid)
    node.send_signal(number)
    assert node.wait(PATIENCE_S) == (0 if number == signal.SIGINT else -number)
    wait_until_gone(lift)
    (ended,) = results(tmp_path)
    assert ended_safely(ended) and not ended["end"]["open"]


def test_a_stalled_subscriber_and_the_node_change_no_message(
    client: Client, start: Start, tmp_path: Path
) -> None:
    subscriber = (sys.executable, "-c", SUBSCRIBER)
    with process(*subscriber, stdout=subprocess.PIPE) as stalled:
        start("--rig", "simulated", "--pace", "max")
        client.follow_state()
        assert stalled.stdout is not None and stalled.stdout.readline() == "seen\n"
        os.kill(stalled.pid, signal.SIGSTOP)
        handle = client.send_lift()
        assert client.result(handle.get_result_async(), "the lift").status == SUCCEEDED
    alone = ["run", "lift", "--json", "--rig", "simulated", "--pace", "max", "--runs", "alone"]
    subprocess.run([*GRASP, *alone, *SETS], cwd=tmp_path, check=True, capture_output=True)
    (with_node,), (without,) = (
        tmp_path.glob(f"{name}/*/recording.mcap") for name in ("runs", "alone")
    )
    assert with_node.read_bytes() == without.read_bytes()


def test_two_nodes_of_one_name_both_work_and_warn(client: Client, start: Start) -> None:
    first, second = start("--rig", "simulated"), start("--rig", "simulated")
    client.until(lambda: client.node.get_node_names().count("grasp") == 2, "two nodes")
    for node in (first, second):
        assert node.stderr is not None
        assert any("another node is named /grasp" in line for line in node.stderr)
        node.send_signal(signal.SIGINT)
        assert node.wait(PATIENCE_S) == 0


def test_two_cells_of_one_domain_have_namespaces(client: Client, start: Start) -> None:
    from std_srvs.srv import Trigger

    cells = ["/left", "/right"]
    for cell in cells:
        start("--rig", "simulated", "--ros-args", "-r", f"__ns:={cell}")
    for cell in cells:
        answer = client.call(Trigger, f"{cell}/grasp/stop", Trigger.Request())
        assert answer.message == "nothing is running"
    topics = {name for name, _ in client.node.get_topic_names_and_types()}
    assert {f"{cell}/grasp/finger_a/wrench" for cell in cells} <= topics


def test_a_lift_stops_when_its_client_is_gone_if_asked(
    client: Client, start: Start, domain: int, tmp_path: Path
) -> None:
    start("--rig", "emulated", "--stop-without-client")
    states = client.follow_state()
    leaves = Client(domain)
    leaves.send_lift()
    client.until(lambda: states[-1].data == "lift", "the lift")
    leaves.close()
    client.until(lambda: states[-1].data == "idle", "idle")
    (ended,) = results(tmp_path)
    assert ended_safely(ended) and not ended["end"]["open"]


def test_arguments_that_ros_refuses_are_one_line(start: Start) -> None:
    node = start("--rig", "simulated", "--ros-args", "-r", "no rule")
    assert node.wait(PATIENCE_S) == 2
    assert node.stderr is not None and "ROS 2 does not start" in node.stderr.read()


def test_a_hand_left_closed_on_real_devices_is_opened_by_the_service(
    client: Client, start: Start, tmp_path: Path
) -> None:
    with (
        emulate("--object", "can") as endpoints,
        closing(ControlClient(endpoints["control"]["host"], endpoints["control"]["port"])) as cell,
    ):
        lab = ("--rig", "hardware", "--config", str(lab_file(tmp_path / "lab.toml", endpoints)))
        activate = [*GRASP, "gripper", "activate", "--empty", *lab, "--confirm-motion"]
        subprocess.run(activate, check=True, capture_output=True)
        cell.ask("place")
        assert start(*lab).wait(PATIENCE_S) == 2  # without a confirmation
        start(*lab, "--confirm-motion")
        states = client.follow_state()
        handle = client.send_lift()
        client.until(lambda: states[-1].data == "lift", "the lift")
        assert client.trigger("stop")[0]
        client.result(handle.get_result_async(), "the end")
        (ended,) = results(tmp_path)
        assert ended_safely(ended) and not ended["end"]["open"]
        client.until(lambda: states[-1].data == "idle", "idle")
        released, text = client.trigger("release")
        assert released, text


def test_a_goal_whose_answer_is_lost_does_not_occupy_the_node(
    client: Client, domain: int, tmp_path: Path
) -> None:
    words = (sys.executable, "-c", LOSES_AN_ANSWER, "ros", *SETS, "--rig", "simulated")
    with process(*words, "--pace", "max", cwd=tmp_path, stderr=subprocess.PIPE) as node:
        client.follow_state()
        client.begin_lift()
        assert node.stderr is not None
        assert any("Failed to send goal response" in line for line in node.stderr)
        assert client.trigger("stop") == (True, "nothing is running")
        handle = client.send_lift()
        assert handle.accepted
        assert client.result(handle.get_result_async(), "the lift").status == SUCCEEDED
        node.send_signal(signal.SIGTERM)
        assert node.wait(PATIENCE_S) == 0


def test_diagnostics_go_on_when_somebody_sets_simulated_time(client: Client, start: Start) -> None:
    from diagnostic_msgs.msg import DiagnosticArray
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    start("--rig", "simulated")
    diagnostics = client.messages("/diagnostics", DiagnosticArray, 10)
    client.follow_state()
    simulated = Parameter("use_sim_time", value=True).to_parameter_msg()
    request = SetParameters.Request(parameters=[simulated])
    (answer,) = client.call(SetParameters, "/grasp/set_parameters", request).results
    assert answer.successful
    before = len(diagnostics)
    client.until(lambda: len(diagnostics) > before + 1, "diagnostics")


def test_many_requests_at_once_are_all_answered(client: Client, start: Start) -> None:
    from rclpy.qos import QoSProfile
    from std_srvs.srv import Trigger

    node = start("--rig", "simulated")
    client.follow_state()
    stop = client.node.create_client(Trigger, "/grasp/stop", qos_profile=QoSProfile(depth=AT_ONCE))
    client.until(stop.service_is_ready, "stop")
    client.trigger("stop")
    node.send_signal(signal.SIGSTOP)
    answers = [stop.call_async(Trigger.Request()) for _ in range(AT_ONCE)]
    node.send_signal(signal.SIGCONT)
    client.until(lambda: all(answer.done() for answer in answers), "all answers")
