"""The ROS 2 node `grasp`: topics, services and the action, as docs/ros.md describes them.

The node controls nothing. Each lift is a process of its own, which feeds its steps through a pipe
that never blocks it; a subscriber cannot delay it. Needs `rclpy`.
"""

import math
import os
import shlex
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any

import msgspec
import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from drivers.errors import UsageError, one_line
from grasp.cli import exits
from grasp.cli.child import Child
from grasp.cli.output import JsonObject
from grasp.cli.ros_lifts import ClientResult, Goal, Lifts, Slot
from grasp.control.fault import INTERRUPTED, TRIAL, Fault
from grasp.run import signals
from grasp.settings import config_dir
from scenarios.report.ros_topics import (
    ERROR,
    IDLE,
    LATCHED,
    RELIABLE,
    SENSOR,
    STATE,
    TOPICS,
    Message,
    RosMessages,
    diagnostics,
)
from scenarios.report.step_feed import Begin, Step

Ros = Any  # rclpy has no types
NAME = "grasp"
DISCOVERY, LOCALHOST = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"
# variable of Fast DDS with its profile, and in older distributions
PROFILE, OLD_PROFILE = "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"
OLD = ("humble", "iron", "jazzy")
STARTING = "starting"  # like IDLE a state without control steps
FEEDBACK_NS = 100_000_000
THREADS = 4  # a lift or release, a cancel or stop, the diagnostics, one more
RESULT_S = 900  # a client may ask for its result so long after the end
SPIN_S = 0.1
LAST_SPINS = 5  # a client still asks for its result
RUNNING = "a lift or a release is running"
SERVICES = QoSProfile(depth=100)  # requests that wait, of many clients at once
QOS = {
    SENSOR: qos_profile_sensor_data,
    LATCHED: QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    RELIABLE: QoSProfile(depth=10),
}


class OwnAction:
    """Goal, feedback and result in `grasp_msgs/action/Lift`."""

    def __init__(self, kind: Ros) -> None:
        self.kind = kind

    def goal(self, request: Ros) -> Goal:
        return Goal(request.object, request.profile)

    def feedback(self, step: Step) -> Ros:
        control = step.control
        return self.kind.Feedback(
            phase=control.phase, slip=control.probabilities, slip_registered=control.registered,
            force=list(control.estimated_n),
        )  # fmt: skip

    def result(self, outcome: ClientResult) -> Ros:
        return self.kind.Result(
            success=outcome.success, verdict=outcome.verdict, message=outcome.message,
            slip_distance=outcome.slip_distance_m, peak_force=list(outcome.peak_force_n),
        )  # fmt: skip


class Fibonacci(OwnAction):
    """The same as whole numbers, in `example_interfaces/action/Fibonacci`, whose goal is ignored:
    the standard action that every installation has, where `grasp_msgs` was not built."""

    def goal(self, request: Ros) -> Goal:
        return Goal()

    def feedback(self, step: Step) -> Ros:
        control = step.control
        numbers = (*control.probabilities, control.registered, *control.estimated_n)
        return self.kind.Feedback(sequence=[_thousandths(number) for number in numbers])

    def result(self, outcome: ClientResult) -> Ros:
        numbers = (outcome.success, outcome.slip_distance_m, *outcome.peak_force_n)
        return self.kind.Result(sequence=[_thousandths(number) for number in numbers])


def _thousandths(number: float) -> int:
    """The number times 1000, -1 for NaN."""
    return -1 if math.isnan(number) else round(number * 1000)


def action_type() -> OwnAction:
    """The first action that can be imported: `grasp_msgs`, then standard ones."""
    for package, kind in (
        ("grasp_msgs", OwnAction), ("example_interfaces", Fibonacci), ("test_msgs", Fibonacci),
    ):  # fmt: skip
        try:
            module = import_module(f"{package}.action")
        except ImportError:
            continue
        return kind(module.Lift if kind is OwnAction else module.Fibonacci)
    raise ImportError("no action in grasp_msgs, example_interfaces or test_msgs")


class GraspNode:
    """The node on an initialized `rclpy`; ``spin`` runs it until a signal."""

    def __init__(self, lifts: Lifts) -> None:
        self._lifts = lifts
        self._node = node = rclpy.create_node(NAME)
        self._log = node.get_logger()
        self._publishers = {
            topic: node.create_publisher(message_type(kind), own_name(topic), QOS[qos])
            for topic, (kind, qos) in TOPICS.items()
        }
        group = ReentrantCallbackGroup()  # a stop must not wait for a lift
        for name, act in (("stop", self._stop), ("release", self._release)):
            node.create_service(
                Trigger, f"~/{name}", _trigger(act), qos_profile=SERVICES, callback_group=group
            )
        self._action = action_type()
        self._server = ActionServer(
            node, self._action.kind, "~/lift", self._lift, callback_group=group,
            goal_callback=self._accept, cancel_callback=self._cancel, result_timeout=RESULT_S,
            goal_service_qos_profile=SERVICES, result_service_qos_profile=SERVICES,
            cancel_service_qos_profile=SERVICES,
        )  # fmt: skip
        # the node's own clock stands still when a stranger sets use_sim_time
        node.create_timer(1.0, self._beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._slot = Slot()
        self._running: Ros = None  # handle of the goal whose lift runs
        self._state, self._last = IDLE, "none"
        self._problems: dict[str, tuple[int, Fault]] = {}
        self._warned = False
        self._publish_state(IDLE)

    @property
    def name(self) -> str:
        """With its namespace."""
        return str(self._node.get_fully_qualified_name())

    def spin(self) -> None:
        """Run until a signal, then stop a lift and wait for its end."""
        executor = MultiThreadedExecutor(THREADS)
        executor.add_node(self._node)
        try:
            while not signals.received() or self._slot.busy.locked():
                if signals.received():
                    self._stop()
                executor.spin_once(SPIN_S)
            for _ in range(LAST_SPINS):
                executor.spin_once(SPIN_S)
        finally:
            self._stop()
            executor.shutdown()
            self._server.destroy()
            self._node.destroy_node()

    # Action

    def _accept(self, request: Ros) -> Ros:
        """Accept every goal: a rejected one reaches its client without the reason."""
        if not self._slot.busy.locked():
            self._slot.stopping = False
        return GoalResponse.ACCEPT

    def _cancel(self, handle: Ros) -> Ros:
        if self._running in (None, handle):  # not a goal that waits for its refusal
            self._stop()
        return CancelResponse.ACCEPT

    def _lift(self, handle: Ros) -> Ros:
        """Run a lift to its end. Only here is anything taken: an accepted goal may never start."""
        with self._slot.taken() as free:
            goal = self._action.goal(handle.request)
            problem = self._lifts.problem(goal) if free and not signals.received() else RUNNING
            if problem:
                self._log.warning(f"lift refused: {problem}")
                handle.abort()
                error = {"kind": "refused", "message": problem}
                return self._action.result(ClientResult.of({"error": error}))
            try:
                self._running = handle
                self._publish_state(STARTING)
                child = self._slot.start(self._lifts.words(goal), True)
                messages = self._follow(child, handle)
                printed = child.result()
                outcome = ClientResult.of(printed)
                self._last = outcome.verdict
                self._problems = _problems(messages, printed.get("error"))
                if canceled := handle.is_cancel_requested:
                    handle.canceled()
                elif outcome.success:
                    handle.succeed()
                else:
                    handle.abort()
                how = "canceled by its client" if canceled else outcome.message
                self._log.info(f"lift: {outcome.verdict} {how}".rstrip())
                return self._action.result(outcome)
            finally:
                self._running = None
                self._publish_state(IDLE)

    def _follow(self, child: Child, handle: Ros) -> RosMessages | None:
        """Publish what the lift feeds, until it ends."""
        messages, due_ns, shown = None, 0, None
        feedback = self._node.resolve_topic_name("~/lift/_action/feedback")
        for line in child.lines():
            if isinstance(line, Begin):
                messages = RosMessages(line.unix_ns, self._lifts.m_per_count)
            elif messages is not None:
                for message in messages.of_step(*msgspec.structs.astuple(line)):
                    self._publish(message)
                event = (line.control.phase, line.control.registered)
                if event != shown or line.t_ns >= due_ns:
                    shown, due_ns = event, line.t_ns + FEEDBACK_NS
                    handle.publish_feedback(self._action.feedback(line))
                    gone = self._lifts.stop_without_client
                    if gone and not self._node.count_subscribers(feedback):
                        self._stop()
        return messages

    # Services

    def _stop(self) -> tuple[bool, str]:
        if self._slot.stop():
            return True, "stopping: the arm stops, the hand keeps its grip"
        return True, "nothing is running"

    def _release(self) -> tuple[bool, str]:
        with self._slot.taken() as free:
            if not free:
                return False, f"refused: {RUNNING}"
            permit = self._lifts.permit
            if permit is None:
                return False, f"the rig {self._lifts.rig} ends with each lift: no hand is closed"
            words = [*shlex.split(permit.release)[1:], "--json"]
            printed = self._slot.start(words).result()
        error = printed.get("error")
        if error:
            return False, f"{error['message']} ({error['remedy']})"
        return True, f"released, fingers at {printed['positions_counts']} counts"

    # Topics

    def _beat(self) -> None:
        """Publish diagnostics where no lift does, and look for a second node of this name."""
        if self._state in (IDLE, STARTING):
            more = {"rig": self._lifts.rig, "last lift": self._last}
            self._publish(diagnostics(time.time_ns(), self._problems, self._state, **more))
        own = (self._node.get_name(), self._node.get_namespace())
        if not self._warned and self._node.get_node_names_and_namespaces().count(own) > 1:
            self._warned = True
            name = self._node.get_fully_qualified_name()
            self._log.warning(f"another node is named {name}: set another ROS_DOMAIN_ID for one, "
                              "or a namespace (--ros-args -r __ns:=/NAME)")  # fmt: skip

    def _publish_state(self, state: str) -> None:
        self._publish(Message(STATE, 0, {"data": state}))

    def _publish(self, message: Message) -> None:
        if message.topic == STATE:
            self._state = message.fields["data"]
        made = message_type(TOPICS[message.topic].type)()
        fill(made, message.fields)
        self._publishers[message.topic].publish(made)


def _problems(
    messages: RosMessages | None, error: JsonObject | None
) -> dict[str, tuple[int, Fault]]:
    """Problems of a finished lift: of its devices, or why it did not run."""
    found = messages.problems if messages else {}
    if error and error["kind"] != INTERRUPTED and not found:
        fault = Fault(error["kind"], TRIAL, error["message"], error["remedy"])
        return {TRIAL: (ERROR, fault)}
    return found


def _trigger(act: Callable[[], tuple[bool, str]]) -> Callable[[Ros, Ros], Ros]:
    """Callback of a Trigger service."""

    def serve(_: Ros, response: Ros) -> Ros:
        response.success, response.message = act()
        return response

    return serve


@cache
def message_type(name: str) -> Ros:
    """The class of `package/msg/Name`, or of `package/Name`."""
    package, *_, kind = name.split("/")
    return getattr(import_module(f"{package}.msg"), kind)


def fill(message: Ros, fields: JsonObject) -> None:
    """Set fields of a message, also nested ones, from plain values."""
    types = message.get_fields_and_field_types()
    for name, value in fields.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            element = message_type(types[name].removeprefix("sequence<").removesuffix(">"))
            elements = [element() for _ in value]
            for one, of in zip(elements, value, strict=True):
                fill(one, of)
            setattr(message, name, elements)
        else:
            setattr(message, name, bytes([value]) if types[name] == "octet" else value)


def own_name(topic: str) -> str:
    """A topic of the node relative to its name, so that namespace and remapping reach it."""
    return topic.replace(f"/{NAME}/", "~/", 1)


def run(lifts: Lifts, ros_args: Sequence[str] = ()) -> int:
    """Run the node until a signal; returns the exit code. Raises UsageError for arguments that ROS
    refuses."""
    # a node that can move an arm is not offered to a network unless somebody asks for that
    if os.environ.setdefault(DISCOVERY, LOCALHOST) == LOCALHOST:
        name = OLD_PROFILE if os.environ.get("ROS_DISTRO") in OLD else PROFILE
        os.environ.setdefault(name, str(config_dir() / "ros" / "loopback.xml"))
    given = ["--ros-args", *ros_args] if ros_args else []
    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy has a class for each layer
        problem = f"ROS 2 does not start: {one_line(str(error))}"
        raise UsageError(problem, "check --ros-args and the ROS_... variables") from None
    try:
        with signals.deferred():
            node = GraspNode(lifts)
            name = node.name
            exits.report_line(f"ROS 2 node {name} on rig {lifts.rig}, Ctrl-C ends it")
            node.spin()
    finally:
        rclpy.try_shutdown()
    return exits.SUCCESS
