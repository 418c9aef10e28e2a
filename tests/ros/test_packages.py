"""The packages for a colcon workspace: well-formed, and the action is what the node serves."""

import xml.etree.ElementTree as ET
from pathlib import Path

ROS = Path(__file__).parents[2] / "ros"


def test_the_action_has_the_fields_that_the_node_uses() -> None:
    from rosidl_adapter.parser import parse_action_file

    action = parse_action_file("grasp_msgs", str(ROS / "grasp_msgs" / "action" / "Lift.action"))
    goal, result, feedback = (
        {field.name: str(field.type) for field in part.fields}
        for part in (action.goal, action.result, action.feedback)
    )
    assert goal == {"object": "string", "profile": "string"}
    assert result == {
        "success": "bool", "verdict": "string", "message": "string", "slip_distance": "float64",
        "peak_force": "float64[3]",
    }  # fmt: skip
    assert feedback == {
        "phase": "string", "slip": "float64[3]", "slip_registered": "bool", "force": "float64[3]",
    }  # fmt: skip


def test_packages_state_name_version_and_licence() -> None:
    for folder in ROS.iterdir():
        package = ET.parse(folder / "package.xml").getroot()
        assert package.findtext("name") == folder.name
        assert package.findtext("version") and package.findtext("license") == "MIT"
        assert package.find("maintainer") is not None
        assert f"project({folder.name})" in (folder / "CMakeLists.txt").read_text()
