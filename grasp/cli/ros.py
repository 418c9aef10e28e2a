"""`grasp ros`: the ROS 2 node."""

import os
from importlib.util import find_spec

from drivers.errors import UsageError, one_line
from grasp.cli.commands import RosOptions
from grasp.cli.ros_lifts import Lifts

MOST_DOMAIN = 232  # its ports end at 65,535
REMEDY = "source a ROS 2 installation, or pip install 'grasp-controller[ros]'"


def ros(args: RosOptions) -> int:
    lifts = Lifts(args)
    domain = os.environ.get("ROS_DOMAIN_ID", "")
    if domain and not (domain.isascii() and domain.isdigit() and int(domain) <= MOST_DOMAIN):
        raise UsageError(f"ROS_DOMAIN_ID={domain!r}", f"a whole number from 0 to {MOST_DOMAIN}")
    if find_spec("rclpy") is None:
        raise UsageError("no ROS 2: the Python package rclpy was not found", REMEDY)
    try:
        from grasp.cli import ros_node
    except Exception as error:  # rclpy loads the middleware here, and raises what that raises
        problem = f"rclpy cannot be imported: {one_line(str(error))}"
        remedy = "run grasp with the Python of the ROS installation"
        if chosen := os.environ.get("RMW_IMPLEMENTATION"):
            remedy = f"install RMW_IMPLEMENTATION={chosen}, or unset it; else {remedy}"
        raise UsageError(problem, remedy) from None
    return ros_node.run(lifts, args.ros_args)
