"""Control periods with the ROS 2 node and a subscriber against without, and ages of its topics."""

import os
import subprocess
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from detector.scores.quantiles import quantile
from grasp.run.messages import CONTROL
from scenarios.trial.run_folder import open_trial
from tests.ros.conftest import GRASP, PATIENCE_S, ROOT, SETS, Client, open_lasting_sockets, process

LIFTS = int(os.environ.get("LIFTS", "6"))
DOMAIN = 98


def periods_ms(recording: Path) -> list[float]:
    """Times between the control steps of a run."""
    t_ns = [t_ns for t_ns, _ in open_trial(recording).of(CONTROL)]
    return [(b - a) * 1e-6 for a, b in pairwise(t_ns)]


class Ages:
    """Ages of a topic's messages on arrival, ms, and their stamps."""

    def __init__(self) -> None:
        self.ages_ms: list[float] = []
        self.stamps_ns: list[int] = []

    def append(self, message: Any) -> None:
        stamp = message.header.stamp
        self.stamps_ns.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
        self.ages_ms.append((time.time_ns() - self.stamps_ns[-1]) * 1e-6)


@pytest.fixture(autouse=True, scope="module")
def lasting_sockets() -> None:
    pytest.importorskip("rclpy")
    open_lasting_sockets()


@pytest.mark.bench
@pytest.mark.timeout(3600)
@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")
def test_control_periods_with_and_without_the_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from geometry_msgs.msg import PointStamped, WrenchStamped
    from rclpy.qos import qos_profile_sensor_data as sensor
    from sensor_msgs.msg import JointState

    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    client = Client(DOMAIN)
    topics = {"finger_a/wrench": WrenchStamped, "joint_states": JointState,
              "tool_position": PointStamped}  # fmt: skip
    ages = {topic: Ages() for topic in topics}
    for topic, kind in topics.items():
        client.node.create_subscription(kind, f"/grasp/{topic}", ages[topic].append, sensor)
    alone = ["run", "lift", "--json", "--rig", "emulated", "--runs", "alone", *SETS]
    with process(*GRASP, "ros", "--rig", "emulated", *SETS, cwd=tmp_path):
        client.follow_state()
        for _ in range(LIFTS):
            subprocess.run(
                [*GRASP, *alone], cwd=tmp_path, check=False, capture_output=True, timeout=PATIENCE_S
            )
            client.result(client.send_lift().get_result_async(), "a lift")
    client.close()
    found = {}
    for name in ("alone", "runs"):
        periods = [ms for run in tmp_path.glob(f"{name}/*") for ms in periods_ms(run)]
        found[name] = {share: quantile(sorted(periods), share) for share in (0.5, 0.99)}
    print()
    for share in (0.5, 0.99):
        with_ms, without_ms = found["runs"][share], found["alone"][share]
        print(f"control period p{share * 100:g}: {with_ms:.3f} ms with the node, {without_ms:.3f} "
              f"without: {with_ms / without_ms:.3f} times")  # fmt: skip
    for topic, seen in ages.items():
        steps = sorted(b - a for a, b in pairwise(seen.stamps_ns))
        p50, p99 = (quantile(sorted(seen.ages_ms), share) for share in (0.5, 0.99))
        print(f"{topic}: {len(seen.ages_ms)} messages, {1e9 / quantile(steps, 0.5):.0f} Hz "
              f"by stamps, age p50 {p50:.1f}, p99 {p99:.1f} ms")  # fmt: skip
