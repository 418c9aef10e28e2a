"""The node in a process of its own, and a client of it in the process of the test.

Every test has its own domain, on loopback. Tests wait for events with generous deadlines; rates are
judged by the stamps of messages, never by elapsed time.
"""

import gc
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from scenarios.lift.lift import lift
from tests.unit.scenarios.conftest import config

ROOT = Path(__file__).parents[2]
GRASP = [sys.executable, "-c", "import sys; from grasp.cli.main import main; sys.exit(main())"]
PATIENCE_S = 120.0  # timeout of any event, also on a busy machine
QUICK = (
    "hand.activation_s=0.1", "controller.hold_s=0.3", "controller.lift_height_m=0.08",
    "controller.lower_speed_mps=0.2", "controller.settle_s=0.2", "controller.baseline_s=0.2",
)  # fmt: skip
SETS = [word for text in QUICK for word in ("--set", text)]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "tests/ros/" in item.path.as_posix():
            item.add_marker(pytest.mark.ros)
            item.add_marker(pytest.mark.timeout(900))
            # of lark, which rclpy's messages import
            ignored = "ignore:module 'sre_:DeprecationWarning"
            item.add_marker(pytest.mark.filterwarnings(ignored))


@pytest.fixture(scope="session", autouse=True)
def lasting_sockets() -> None:
    open_lasting_sockets()


def open_lasting_sockets() -> None:
    """Open the few sockets that the middleware keeps until the process ends."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        Client(random.randrange(1, 102)).close()


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """A domain for this test alone, restricted to loopback, here and in every process begun."""
    chosen = random.randrange(1, 102)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(chosen))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    return chosen


class Client:
    """Topics, services and the action of the node, as another program uses them."""

    def __init__(self, domain: int) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self.node = rclpy.create_node("client", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._actions: list[Any] = []

    def close(self) -> None:
        for action in self._actions:
            action.destroy()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()
        self.node = self._executor = self._context = self._actions = None
        gc.collect()  # frees the last references, and with them the sockets

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Spin until the condition is true; fails after PATIENCE_S."""
        deadline = time.monotonic() + PATIENCE_S
        while not (found := condition()):
            assert time.monotonic() < deadline, f"timeout: {what}"
            self._executor.spin_once(0.05)
        return found

    def messages(self, topic: str, kind: Any, qos: Any) -> list[Any]:
        """A list that grows by each message of the topic."""
        found: list[Any] = []
        self.node.create_subscription(kind, topic, found.append, qos)
        return found

    def follow_state(self) -> list[Any]:
        """Messages of the latched state; waits until the node is there."""
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from std_msgs.msg import String

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        found = self.messages("/grasp/state", String, latched)
        self.until(lambda: found, "the latched state")
        return found

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, name)
        return self.result(client.call_async(request), name)

    def trigger(self, name: str) -> tuple[bool, str]:
        from std_srvs.srv import Trigger

        response = self.call(Trigger, f"/grasp/{name}", Trigger.Request())
        return response.success, response.message

    def send_lift(self, feedback: list[Any] | None = None) -> Any:
        """Send a goal; returns its handle."""
        return self.result(self.begin_lift(feedback), "goal")

    def begin_lift(self, feedback: list[Any] | None = None) -> Any:
        """Send a goal; returns the future of its handle."""
        from rclpy.action import ActionClient
        from test_msgs.action import Fibonacci

        client = ActionClient(self.node, Fibonacci, "/grasp/lift")
        self._actions.append(client)
        self.until(client.server_is_ready, "the action server")
        take = None if feedback is None else (lambda m: feedback.append(list(m.feedback.sequence)))
        return client.send_goal_async(Fibonacci.Goal(), feedback_callback=take)

    def result(self, future: Any, what: str) -> Any:
        self.until(future.done, what)
        return future.result()


@pytest.fixture
def client(domain: int) -> Iterator[Client]:
    made = Client(domain)
    yield made
    made.close()


@contextmanager
def process(*command: str, **options: Any) -> Iterator["subprocess.Popen[str]"]:
    with subprocess.Popen(command, text=True, stdin=subprocess.DEVNULL, **options) as started:
        try:
            yield started
        finally:
            started.kill()


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Start]:
    """Start the node with further words, in `tmp_path`; its lifts are quick."""
    with ExitStack() as until_end:

        def begin(*words: str) -> "subprocess.Popen[str]":
            command = (*GRASP, "ros", *SETS, *words)
            options = {"cwd": tmp_path, "stderr": subprocess.PIPE}
            return until_end.enter_context(process(*command, **options))

        yield begin


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of two recorded lifts, with the seeds 0 and 1."""
    found = []
    for seed in (0, 1):
        result = lift.run(config(), seed, tmp_path_factory.mktemp("runs")).result
        assert result is not None and result.recording is not None
        found.append(Path(result.recording).parent)
    return found
