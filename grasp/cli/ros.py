"""`grasp ros`: the ROS 2 node."""

from importlib.util import find_spec

from drivers.errors import UsageError
from grasp.cli.commands import RosOptions
from grasp.cli.ros_lifts import Lifts

REMEDY = "source a ROS 2 installation, or pip install 'grasp-controller[ros]'"


def ros(args: RosOptions) -> int:
    lifts = Lifts(args)
    if find_spec("rclpy") is None:
        raise UsageError("no ROS 2: the Python package rclpy was not found", REMEDY)
    try:
        from grasp.cli import ros_node
    except ImportError as error:
        problem = f"rclpy cannot be imported: {error}"
        raise UsageError(problem, "run grasp with the Python of the ROS installation") from None
    return ros_node.run(lifts)
