"""Messages of a control step, as plain values: topics, units, stamps and labels."""

from typing import Any

import pytest

from grasp.control.fault import GRIPPER, Fault
from grasp.run.messages import ArmMessage, ControlMessage, arm_message, tactile_message
from scenarios.report.ros_topics import (
    ARM_JOINTS,
    DIAGNOSTICS,
    ERROR,
    JOINTS,
    SLIP,
    STATE,
    TAXELS,
    TOOL,
    TOPICS,
    WARN,
    WRENCHES,
    RosMessages,
)
from tests.unit.grasp.builders import arm, frame, gripper

UNIX_NS = 5_000_000_000


def control(**changes: Any) -> ControlMessage:
    values = {
        "phase": "lift", "probabilities": [0.25, 0.5, 0.75], "armed": True, "masked": False,
        "registered": True, "event": False, "finger": 0, "estimated_n": (3.0, 1.0, 2.0),
        "rest_taken": True, "pending": False, "errors": (), "gripper_lost": False, "commands": [],
        **changes,
    }  # fmt: skip
    return ControlMessage(**values)


def step(messages: RosMessages, t_ns: int, **changes: Any) -> dict[str, dict[str, Any]]:
    """Fields of the messages of one step, by topic."""
    tactile = tactile_message(frame(-7))
    state = gripper(t_ns, (0, 100, 200))
    made = messages.of_step(t_ns, tactile, state, arm_message(arm(t_ns)), control(**changes))
    return {message.topic: message.fields for message in made}


def test_a_step_gives_every_topic_once_in_si_units() -> None:
    fields = step(RosMessages(UNIX_NS, 0.001), 1_500_000_000)
    assert set(fields) == set(TOPICS)
    assert fields[JOINTS]["position"] == [0.0, 0.1, 0.2]
    assert fields[JOINTS]["name"] == ["finger_a", "finger_b", "finger_c"]
    assert [fields[topic]["wrench"]["force"]["z"] for topic in WRENCHES] == [3.0, 1.0, 2.0]
    assert fields[TOOL]["point"] == {"x": 0.3, "y": 0.2, "z": 0.4}
    assert fields[SLIP]["data"] == [0.25, 0.5, 0.75, 1.0]
    assert fields[TAXELS]["data"] == [-7.0] * 18
    finger, taxel = fields[TAXELS]["layout"]["dim"]
    assert finger == {"label": "finger", "size": 3, "stride": 18}
    assert taxel == {"label": "taxel", "size": 6, "stride": 6}


def test_stamps_are_the_times_of_the_samples() -> None:
    fields = step(RosMessages(UNIX_NS, 0.001), 1_500_000_000)
    assert fields[JOINTS]["header"]["stamp"] == {"sec": 6, "nanosec": 500_000_000}
    assert fields[WRENCHES[0]]["header"]["stamp"] == {"sec": 5, "nanosec": 0}  # sampled at 0


def test_the_state_is_sent_on_change_and_diagnostics_once_a_second() -> None:
    messages = RosMessages(0, 0.001)
    steps = [step(messages, 10_000_000 * k) for k in range(150)]
    assert [k for k, fields in enumerate(steps) if STATE in fields] == [0]
    assert [k for k, fields in enumerate(steps) if DIAGNOSTICS in fields] == [0, 100]


def test_diagnostics_state_the_most_severe_problem_of_a_device() -> None:
    messages = RosMessages(0, 0.001)
    reported, failed = (Fault(code, GRIPPER, code, data={"finger": "A"}) for code in "ab")
    levels = []
    for k, changes in enumerate(({}, {"reported": (reported,)}, {"faults": (failed,)})):
        statuses = {s["name"]: s for s in step(messages, k, **changes)[DIAGNOSTICS]["status"]}
        levels.append((statuses["grasp"]["level"], statuses["grasp: gripper"]["level"]))
        assert statuses["grasp: arm"]["message"] == "ok"
    assert levels == [(0, 0), (WARN, WARN), (ERROR, ERROR)]
    values = {pair["key"]: pair["value"] for pair in statuses["grasp: gripper"]["values"]}
    assert values["code"] == "b" and values["finger"] == "A"
    assert DIAGNOSTICS not in step(messages, 4)


@pytest.mark.parametrize(("hand_ns", "arm_ns"), [(9, 7), (7, 9)])
def test_joints_of_hand_and_arm_have_the_stamp_of_the_older_sample(
    hand_ns: int, arm_ns: int
) -> None:
    q = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    state = arm_message(arm(arm_ns, joints_rad=q))
    made = RosMessages(0, 0.001).of_step(9, None, gripper(hand_ns), state, control())
    (joints,) = (message for message in made if message.topic == JOINTS)
    assert joints.stamp_ns == 7
    found = dict(zip(joints.fields["name"], joints.fields["position"], strict=True))
    assert [found[name] for name in ARM_JOINTS] == [*q] and "finger_a" in found


@pytest.mark.parametrize("joints_rad", [None, (0.1, None, 0.3, 0.4, 0.5, 0.6)])
def test_unknown_values_are_left_out(joints_rad: Any) -> None:
    nothing = (None, None, None)
    arm_unknown = ArmMessage(0, 0, nothing, nothing, False, joints_rad=joints_rad)
    made = RosMessages(0, 0.001).of_step(0, None, gripper(), arm_unknown, control())
    assert [message.topic for message in made] == [JOINTS, STATE, DIAGNOSTICS]
