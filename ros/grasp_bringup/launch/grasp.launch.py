"""Starts the node: `ros2 launch grasp_bringup grasp.launch.py rig:=simulated`.

There is no argument for --confirm-motion: real devices are started on the command line of `grasp`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([
        DeclareLaunchArgument("rig", default_value="emulated", description="emulated or simulated"),
        DeclareLaunchArgument("object", default_value="can", description="object to lift"),
        ExecuteProcess(
            cmd=["grasp", "ros", "--rig", LaunchConfiguration("rig"),
                 "--object", LaunchConfiguration("object")],
            output="screen",
        ),
    ])  # fmt: skip
