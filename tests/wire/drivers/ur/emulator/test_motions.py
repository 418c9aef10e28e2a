"""Motions of the emulated arm, in virtual time."""

import itertools
import math

import pytest

from drivers.ur import kinematics
from drivers.ur.emulator.controller import RuntimeState, SafetyMode
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings
from tests.wire.drivers.ur.emulator.bench import DOWN, PERIOD_NS, run_to_end


def test_line_takes_the_time_of_its_trapezoid(bench):
    """0.1 m at 0.25 m/s and 1.2 m/s2: s / v + v / a = 0.608 s, reached exactly, joints with it."""
    bench.run(
        f"movel(p[0.5, 0.1, 0.4, {DOWN}], a=1.2, v=0.25)\nwrite_output_integer_register(5, 7)"
    )
    done = bench.controller.registers.values["output", "int"]
    count = next(n for n in itertools.count(1) if bench.cycles(1) or done[5] == 7)
    assert 0.608 <= count * 0.008 < 0.608 + 3 * 0.008
    assert math.dist(bench.motion.position, (0.5, 0.1, 0.4)) < 1e-9
    assert bench.motion.pose_of(bench.motion.q, None)[:3] == pytest.approx((0.5, 0.1, 0.4))
    assert bench.controller.runtime_state is RuntimeState.STOPPED


def test_motion_out_of_reach_is_a_protective_stop(bench):
    bench.run("while True:\n speedl([0.5, 0, 0, 0, 0, 0], a=5)\n end")
    bench.cycles(400)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert bench.motion.velocity == (0.0, 0.0, 0.0)
    assert bench.motion.position[0] < 1.5


# example_control_loop.py of UR's Python RTDE client
SET_POINTS = ((-0.12, -0.43, 0.14, 0, 3.11, 0.04), (-0.12, -0.51, 0.21, 0, 3.11, 0.04))


@pytest.mark.parametrize("pose", SET_POINTS)
def test_inverse_gives_the_joints_within_their_range_and_nearest(bench, pose):
    from_here = bench.motion.q
    values = ", ".join(map(str, pose))
    run_to_end(
        bench,
        f"q = get_inverse_kin(p[{values}])\nif is_within_safety_limits(q):\n"
        "write_output_integer_register(0, 1)\nend\ni = 0\nwhile i < 6:\n"
        " write_output_float_register(i, q[i])\n i = i + 1\n end",
    )
    q = bench.controller.registers.values["output", "double"][:6]
    assert bench.controller.registers.values["output", "int"][0]
    for angle, start in zip(q, from_here, strict=True):
        others = [angle + turn * 2 * math.pi for turn in (-2, -1, 1, 2)]
        possible = [other for other in others if abs(other) <= 2 * math.pi]
        assert abs(angle) <= 2 * math.pi
        assert all(abs(angle - start) <= abs(other - start) for other in possible)


def test_spin_about_the_tool_axis_keeps_the_axis_direction(bench):
    start = kinematics.rotation(bench.motion.tcp_pose[3:])
    bench.run("speedl([0, 0, 0, 0, 0, 0.5], a=2, t=1)")
    bench.cycles(60)
    turned = kinematics.rotation(bench.motion.tcp_pose[3:])
    assert turned[:, 2] == pytest.approx(start[:, 2], abs=1e-6)
    x, y, z = kinematics.rotation_vector(turned @ start.T)
    assert (x, y) == pytest.approx((0, 0), abs=1e-6) and 0.1 < z < 0.3
    assert bench.motion.tcp_speed == pytest.approx((0, 0, 0, 0, 0, 0.5), abs=1e-6)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("speedl([0, 0, 0, 0, 0, 4], a=40, t=1)", "joint 5 too fast"),
        ("while True:\n speedl([-0.5, 0, 0, 0, 0, 0], a=5)\n end", "joint"),
    ],
)
def test_exceeding_a_joint_limit_is_a_protective_stop(bench, body, said):
    bench.run(body)
    bench.cycles(600)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert any(said in line for line in bench.controller.messages), bench.controller.messages
    assert bench.motion.tcp_speed == (0.0,) * 6


def test_line_under_way_follows_the_speed_slider_as_the_arm_of_virtual_time_does(bench):
    """0.1 m at 0.25 m/s, slowed down to 0.4 after 0.2 s, stopped, and continued at full speed."""
    virtual = ArmModel(ArmModelSettings(), 0, command_latency_s=0.0)
    bench.run(f"movel(p[0.5, 0.1, 0.4, {DOWN}], a=1.2, v=0.25)")
    until = bench.now_ns + PERIOD_NS
    virtual.move_l((0.5, 0.1, 0.4), 0.25, 1.2, until)
    for cycles, fraction in ((25, 0.4), (12, 0.0), (250, 1.0)):
        bench.cycles(cycles)
        virtual.set_speed_slider(fraction, bench.now_ns)
        bench.controller.set_speed_slider(fraction)
    places, expected = [], []
    for _ in range(60):
        bench.cycles(1)
        places.append(bench.motion.position)
        expected.append(virtual.at(bench.now_ns).position_m)
    assert places == expected
    assert len(set(places)) > 10 and places[-1] == (0.5, 0.1, 0.4)
