"""The emulated controller without sockets, in virtual time; and around a world of somebody else."""

import itertools
import math
import struct
import threading
import time
from contextlib import nullcontext

import pytest

from drivers.fairness import Budget, Slowly
from drivers.ur import kinematics
from drivers.ur.emulator.controller import Controller, RuntimeState, SafetyMode
from drivers.ur.emulator.faults import FaultChannel
from drivers.ur.emulator.fields import output_values
from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.emulator.primary import state_message
from drivers.ur.emulator.robot import UrEmulator
from drivers.ur.emulator.rtde import RtdeServer
from drivers.ur.emulator.settings import EmulatorSettings
from drivers.ur.model import ArmModel, ArmModelSettings
from tests.wire.drivers.ur.emulator.test_stock_clients import packages

PERIOD_NS = 8_000_000
DOWN = "3.141592653589793, 0, 0"


class Bench:
    """A controller whose cycles are counted by the test."""

    def __init__(self):
        settings = EmulatorSettings(host="127.0.0.2")
        self.arm = ArmModel(ArmModelSettings(command_latency_s=0.0), 0)
        self.motion = RobotMotion(settings, self.arm, nullcontext(), 0)
        self.controller = Controller(settings, self.motion, 0)
        self.now_ns = 0

    def cycles(self, count, inputs=None):
        for _ in range(count):
            self.now_ns += PERIOD_NS
            self.controller.step(self.now_ns, inputs or {})

    def run(self, body):
        self.controller.load(f"def main():\n{body}\nend\n")

    @property
    def last(self):
        return self.controller.messages[-1]


@pytest.fixture
def bench():
    return Bench()


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


def test_program_that_ends_in_motion_is_braked(bench):
    bench.run("speedl([0, 0.1, 0, 0, 0, 0], a=1, t=0.5)")
    bench.cycles(30)
    assert bench.motion.velocity[1] > 0.0
    bench.controller.stop_program("test")
    bench.cycles(10)
    assert bench.motion.velocity == (0.0, 0.0, 0.0)


def test_two_threads_on_one_arm_end_the_program(bench):
    bench.run(
        "thread t():\n while True:\n speedl([0, 0, 0.1, 0, 0, 0], a=1)\n end\n end\n"
        "run t()\n sync()\n sync()\n stopl(1)"
    )
    bench.cycles(20)
    assert "Another thread is already controlling the robot" in bench.last
    assert bench.controller.runtime_state is RuntimeState.STOPPED


@pytest.mark.parametrize(
    "call",
    [
        "movel([1e999, 0, 0, 0, 0, 0])",
        "movel(1)",
        f"movel(p[5, 0, 0, {DOWN}])",
        f"movel(p[1e300, 0, 0, {DOWN}])",
        f"movel(p[0.5, 0.1, 0.4, {DOWN}], v=0)",
        f"movel(p[0.5, 0.1, 0.4, {DOWN}], t=-3)",
        "movel(p[0.5, 0.1, 1.3, 0, 0, 0])",
        "movej([7, 0, 0, 0, 0, 0])",
        "servoj([9, 0, 0, 0, 0, 0])",
        "servoj(get_actual_joint_positions(), lookahead_time=0)",
        "speedj([0, 0, 0, 0, 0], a=1)",
        "speedj([0, 0, 0, 0, 0, 1e300], a=1)",
        "servoc(p[0, 0, 0, 0, 0, 0])",
        "force_mode(p[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0])",
        'popup("here")',
        'socket_open("127.0.0.1", 80)',
        "set_standard_digital_out(8, True)",
        "set_standard_analog_out(2, 0.5)",
        "set_tool_voltage(5)",
        "set_flag(32, True)",
        "get_flag(-1)",
        "read_port_bit(0)",
        "movep(p[0.5, 0.1, 0.3, 0, 0, 0])",
        "teach_mode()",
        "sqrt(-1)",
        "pow(1e200, 2)",
        'to_num("a")',
        "normalize([0, 0, 0])",
        'str_at("abc", 3)',
        "stopl(0)",
        "stopj(-1)",
        "speedl([0, 0, 0.1, 0, 0, 0], a=0)",
        "sleep(1e999)",
        "write_output_integer_register(48, 1)",
        "write_output_integer_register(0, 1.5)",
        "write_output_float_register(0, 1e999)",
        "read_input_float_register(-1)",
        'rtde_set_watchdog("input_int_register_0", 0, "stop")',
        "get_inverse_kin(p[9, 9, 9, 0, 0, 0])",
        "get_inverse_kin(p[0.5, 0.1, 0.3, 1e300, 1e300, 0])",
        "set_tcp(p[0, 0, 0, 0, 0, 1e999])",
        'rtde_set_watchdog("input_int_register_0", 1e-300, "stop")',
        "set_payload(1, [0])",
        "set_payload(-5)",
        "set_payload(1e6)",
        "set_target_payload(-1, [0, 0, 0])",
    ],
)
def test_bad_arguments_end_the_program_and_nothing_moves(bench, call):
    bench.run(call)
    bench.cycles(3)
    assert bench.controller.script_errors == 1, bench.last
    assert bench.controller.runtime_state is RuntimeState.STOPPED
    assert math.dist(bench.motion.position, (0.5, 0.1, 0.3)) < 1e-9


def test_secondary_program_runs_beside_the_main_one(bench):
    """Also one that computes for longer than a cycle has time for, and the next after it."""
    bench.run("n = 0\nwhile True:\n n = n + 1\nwrite_output_integer_register(1, n)\nsync()\nend")
    bench.cycles(3)
    ints = bench.controller.registers.values["output", "int"]
    before = ints[1]
    bench.controller.load(
        "# beside\nsec one():\n i = 0\nwhile i < 1000:\n i = i + 1\nend\n"
        "write_output_integer_register(5, i)\nset_standard_digital_out(2, "
        "get_inverse_kin_has_solution(get_actual_tcp_pose()))\nend\n"
    )
    bench.controller.load("sec two():\n write_output_integer_register(6, 2)\nend\n")
    budget = Budget(0.05)
    while ints[6] != 2:
        bench.now_ns += PERIOD_NS
        bench.controller.step(bench.now_ns, {}, budget)
    assert ints[5] == 1000
    assert bench.controller.ports.digital_out == 4
    bench.cycles(5)
    assert ints[1] > before
    assert bench.controller.runtime_state is RuntimeState.PLAYING
    assert not bench.controller.script_errors


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        ("sync()", "sync takes time"),
        ("sleep(1)", "sleep takes time"),
        (f"movel(p[0.5, 0.1, 0.4, {DOWN}])", "movel takes time"),
        ("speedl([0, 0, 0.1, 0, 0, 0])", "speedl takes time"),
        ("stopl(1)", "stopl takes time"),
        ("thread t():\n while True:\n end\n end\nrun t()", "too many threads"),
        ("while True:\n end", "infinite loop"),
        ("nonsense()", "not defined"),
        ("x = ", "expected"),
    ],
)
def test_secondary_program_that_would_take_time_or_fails_ends_alone(bench, call, reason):
    bench.run("while True:\n sync()\n end")
    bench.cycles(2)
    bench.controller.load(f"sec one():\n{call}\nend\n")
    bench.cycles(3)
    assert reason in bench.last
    assert bench.controller.script_errors == 1
    assert bench.controller.runtime_state is RuntimeState.PLAYING
    assert not bench.motion.moving
    bench.controller.load("sec two():\n set_standard_digital_out(2, True)\nend\n")
    bench.cycles(2)
    assert bench.controller.ports.digital_out == 4


def test_program_that_is_interrupted_goes_on_with_the_registers_that_it_began_with(bench):
    """A client writes a command and its arguments at once; read in two cycles, they would be those
    of two commands."""
    bench.run(
        "torn = 0\nwhole = 0\nwhile True:\n a = read_input_integer_register(0)\n i = 0\n"
        "while i < 1000:\n i = i + 1\nend\nif a == read_input_float_register(0):\n"
        " whole = whole + 1\nelse:\n torn = torn + 1\nend\n"
        "write_output_integer_register(5, whole)\nwrite_output_integer_register(6, torn)\n"
        "write_output_integer_register(7, a)\nsync()\nend"
    )
    ints, budget, last = bench.controller.registers.values["output", "int"], Budget(0.02), 400
    for n in range(last + 1):
        bench.now_ns += PERIOD_NS
        written = {"input_int_register_0": (n,), "input_double_register_0": (float(n),)}
        bench.controller.step(bench.now_ns, written, budget)
    assert ints[6] == 0
    assert 0 < ints[5] < last / 2  # it was interrupted in most of its turns
    bench.cycles(3)
    assert ints[7] == last  # what came meanwhile is not lost


def test_program_has_its_share_however_much_the_arm_takes_to_compute(bench, monkeypatch):
    """Else an arm that moves at 500 Hz on a slow machine is told nothing any more."""
    bench.run("n = 0\nwhile True:\n n = n + 1\nwrite_output_integer_register(5, n)\nsync()\nend")
    update = bench.motion.update

    def slowly(now_ns):
        until_s = time.thread_time() + 0.003
        while time.thread_time() < until_s:
            pass
        return update(now_ns)

    monkeypatch.setattr(bench.motion, "update", slowly)
    budget = Budget(0.2)  # 1.6 ms of a cycle
    for _ in range(30):
        bench.now_ns += PERIOD_NS
        bench.controller.step(bench.now_ns, {}, budget)
    assert bench.controller.registers.values["output", "int"][5] > 15


COUNT = "n = 0\nwhile True:\n n = n + 1\nwrite_output_integer_register(1, n)\n{}sync()\nend"


def sliced(bench, meanwhile):
    """A cycle with more time than a slice."""
    bench.now_ns += PERIOD_NS
    budget = Budget(1.0)
    bench.controller.step(bench.now_ns, {}, budget, meanwhile)


@pytest.mark.parametrize(
    "hog",
    ["def f():\n while True:\n i = 0\n while i < 3000:\n i = i + 1\n end\n sync()\n end\n end\n",
     "def f():\n" + " a = [1, 2]\n" * 3000 + "end\n",
     "sec f():\n i = 0\n while i < 30000:\n i = i + 1\n end\n end\n"],
    ids=["program", "compilation", "secondary program"],
)  # fmt: skip
def test_clients_have_a_turn_while_a_program_computes_or_is_compiled(bench, hog):
    bench.controller.load(hog)
    turns = []
    for _ in range(3):
        sliced(bench, lambda: turns.append(0))
    bench.controller.close()
    assert len(turns) >= 5


def test_main_program_has_one_turn_a_cycle_however_many_slices_there_are(bench):
    bench.run(COUNT.format(""))
    bench.cycles(3)
    ints = bench.controller.registers.values["output", "int"]
    bench.controller.load("sec f():\n i = 0\n while i < 20000:\n i = i + 1\n end\n end\n")
    before, turns = ints[1], []
    for _ in range(5):
        sliced(bench, lambda: turns.append(0))
    assert turns
    assert ints[1] - before == 5


@pytest.mark.parametrize("what", ["stop", "pause", "replace", "protective stop"])
def test_program_that_is_stopped_between_two_of_its_slices_is_stopped(bench, what):
    bench.run(COUNT.format("i = 0\nwhile i < 30000:\n i = i + 1\nend\n"))
    controller, done = bench.controller, []
    other = "write_output_integer_register(2, 2)\n"

    def meanwhile():
        if controller.runtime_state is RuntimeState.PLAYING and not done:
            done.append({
                "stop": lambda: controller.stop_program("asked"),
                "pause": controller.pause_program,
                "replace": lambda: controller.load(other),
                "protective stop": controller.protective_stop,
            }[what]())  # fmt: skip

    for _ in range(20):
        sliced(bench, meanwhile)
    ints = controller.registers.values["output", "int"]
    assert done and ints[1] == 1
    assert ints[2] == (2 if what == "replace" else 0)
    paused = what in ("pause", "protective stop")
    assert controller.runtime_state is (RuntimeState.PAUSED if paused else RuntimeState.STOPPED)


def test_secondary_programs_wait_for_each_other_but_not_any_number(bench):
    for number in range(20):
        bench.controller.load(f"sec s():\n write_output_integer_register({number}, 1)\nend\n")
    assert "8 are waiting" in bench.last
    bench.cycles(20)
    assert bench.controller.registers.values["output", "int"][:20] == [1] * 8 + [0] * 12


def test_secondary_program_may_stop_the_arm_and_none_is_left_for_afterwards(bench):
    bench.controller.load("sec s():\n protective_stop()\nend\n")
    bench.controller.load("sec s():\n set_standard_digital_out(2, True)\nend\n")
    bench.cycles(3)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    bench.now_ns += 10_000_000_000
    bench.cycles(1)
    assert bench.controller.unlock_protective_stop()
    bench.cycles(3)
    assert bench.controller.ports.digital_out == 0
    assert not bench.controller.script_errors


def test_program_that_is_replaced_before_its_turn_costs_no_thread(bench, monkeypatch):
    started = []
    monkeypatch.setattr(
        "drivers.ur.emulator.compiling.Slowly", lambda work: started.append(work) or Slowly(work)
    )
    for number in range(200):
        bench.controller.load(f"write_output_integer_register({number % 24}, {number})\n")
    bench.cycles(3)
    assert len(started) == 1
    assert sum(bench.controller.registers.values["output", "int"]) == 199


def test_motion_out_of_reach_is_a_protective_stop(bench):
    bench.run("while True:\n speedl([0.5, 0, 0, 0, 0, 0], a=5)\n end")
    bench.cycles(400)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert bench.motion.velocity == (0.0, 0.0, 0.0)
    assert bench.motion.position[0] < 1.5


def told(bench, body, cycles=600):
    """The program runs to its end without an error."""
    bench.run(body)
    for _ in range(cycles):
        bench.cycles(1)
        if bench.controller.runtime_state is RuntimeState.STOPPED:
            break
    assert not bench.controller.script_errors, bench.last
    assert bench.controller.safety_mode is SafetyMode.NORMAL, bench.last
    assert bench.controller.runtime_state is RuntimeState.STOPPED
    bench.cycles(3)


def test_joints_move_together_and_the_tool_turns_with_them(bench):
    """Of 0.6 rad and 0.3 rad at 1 rad/s and 2 rad/s2: 0.6 / 1 + 1 / 2 s."""
    before = bench.motion.q
    bench.run(
        "q = get_actual_joint_positions()\nq[5] = q[5] + 0.6\nq[3] = q[3] + 0.3\n"
        "movej(q, a=2, v=1)\nwrite_output_integer_register(5, 7)"
    )
    done = bench.controller.registers.values["output", "int"]
    fastest, ratios, cycles = 0.0, set(), 0
    while done[5] != 7:
        bench.cycles(1)
        cycles += 1
        fastest = max(fastest, abs(bench.motion.qd[5]))
        if bench.motion.qd[5]:
            ratios.add(round(bench.motion.qd[3] / bench.motion.qd[5], 6))
    assert cycles * 0.008 == pytest.approx(1.1, abs=0.04)
    assert fastest == pytest.approx(1.0)
    assert ratios == {0.5}
    expected = [b - a for a, b in zip(before, bench.motion.q, strict=True)]
    assert expected == pytest.approx((0, 0, 0, 0.3, 0, 0.6), abs=1e-6)
    assert bench.motion.tcp_pose[:3] == pytest.approx(bench.arm.position(bench.now_ns), abs=1e-9)


# example_control_loop.py of UR's Python RTDE client
SET_POINTS = ((-0.12, -0.43, 0.14, 0, 3.11, 0.04), (-0.12, -0.51, 0.21, 0, 3.11, 0.04))


@pytest.mark.parametrize("pose", SET_POINTS)
def test_inverse_gives_the_joints_within_their_range_and_nearest(bench, pose):
    from_here = bench.motion.q
    values = ", ".join(map(str, pose))
    told(
        bench,
        f"q = get_inverse_kin(p[{values}])\nwrite_output_boolean_register(0, "
        "is_within_safety_limits(q))\ni = 0\nwhile i < 6:\n"
        " write_output_float_register(i, q[i])\n i = i + 1\n end",
    )
    q = bench.controller.registers.values["output", "double"][:6]
    assert bench.controller.registers.values["output", "bit"][0]
    for angle, start in zip(q, from_here, strict=True):
        others = [angle + turn * 2 * math.pi for turn in (-2, -1, 1, 2)]
        possible = [other for other in others if abs(other) <= 2 * math.pi]
        assert abs(angle) <= 2 * math.pi
        assert all(abs(angle - start) <= abs(other - start) for other in possible)


def test_joints_move_to_both_set_points_of_the_stock_control_loop(bench):
    for pose in (*SET_POINTS, *SET_POINTS):
        told(bench, f"movej(p[{', '.join(map(str, pose))}], a=3, v=2)", cycles=1500)
        assert bench.motion.tcp_pose[:3] == pytest.approx(pose[:3], abs=1e-6)
        assert bench.motion.pose_of(bench.motion.q, None)[3:] == pytest.approx(pose[3:], abs=1e-6)


def test_line_that_turns_a_joint_beyond_its_range_still_ends_in_a_protective_stop(bench):
    """A solution a whole turn away would be a leap on the way."""
    told(
        bench,
        "q = get_actual_joint_positions()\nq[5] = -6.2\nmovej(q, a=3, v=2)",
        cycles=1500,
    )
    bench.run("while True:\n speedl([0, 0, 0, 0, 0, 0.5], a=5)\n end")
    bench.cycles(400)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert any("joint 5 at its limit" in line for line in bench.controller.messages)


def test_line_that_turns_the_tool_ends_in_its_pose_and_keeps_it(bench):
    pose = (0.45, 0.15, 0.35, 2.9, 0.3, 0.2)
    told(bench, f"movel(p[{', '.join(map(str, pose))}], a=1, v=0.3)")
    assert bench.motion.tcp_pose == pytest.approx(pose, abs=1e-6)
    assert not bench.motion.moving
    told(bench, f"movel(p[0.5, 0.1, 0.3, {', '.join(map(str, pose[3:]))}], a=1, v=0.3)")
    assert bench.motion.tcp_pose == pytest.approx((0.5, 0.1, 0.3, *pose[3:]), abs=1e-6)
    assert bench.motion.pose_of(bench.motion.q, None) == pytest.approx(
        bench.motion.tcp_pose, abs=1e-6
    )


def test_motion_that_is_given_a_duration_takes_it(bench):
    bench.run(f"movel(p[0.5, 0.1, 0.35, {DOWN}], t=0.8)\nwrite_output_integer_register(5, 7)")
    done = bench.controller.registers.values["output", "int"]
    count = next(n for n in itertools.count(1) if bench.cycles(1) or done[5] == 7)
    assert count * 0.008 == pytest.approx(0.8, abs=0.04)


def test_speed_about_any_axis_turns_the_tool_about_its_centre_point(bench):
    told(bench, "set_tcp(p[0, 0, 0.1, 0, 0, 0])")
    start = bench.motion.tcp_pose
    bench.run("speedl([0, 0, 0, 0.2, 0, 0], a=2, t=1)\nstopl(2)")
    bench.cycles(60)
    assert bench.motion.tcp_speed == pytest.approx((0, 0, 0, 0.2, 0, 0), abs=1e-3)
    bench.cycles(200)
    turned = bench.motion.tcp_pose
    assert turned[:3] == pytest.approx(start[:3], abs=1e-3)
    angle = math.dist(turned[3:], start[3:])
    assert angle > 0.1
    assert bench.motion.tcp_speed == (0.0,) * 6


def test_state_of_an_arm_that_stands_tells_its_modes_and_the_speed_slider(bench):
    """Layout of the package 0: Client Interfaces, PolyScope 3.5 and later."""
    bench.cycles(3)
    message = state_message(bench.controller, EmulatorSettings(host="127.0.0.2").controller)
    size, kind = struct.unpack_from(">IB", message, 5)
    assert (size, kind) == (struct.calcsize(">IBQ7?BB3dB"), 0)
    now_us, *flags = struct.unpack_from(">Q7?", message, 10)
    assert now_us == 3 * PERIOD_NS // 1000
    assert flags == [True, True, True, False, False, False, False]
    mode, control, wanted, scaling, most, _ = struct.unpack_from(">BB3dB", message, 25)
    assert (mode, control) == (7, 0)  # it runs; by position
    assert (wanted, scaling, most) == (1.0, 1.0, 1.0)


def test_tool_that_spins_about_its_own_axis_goes_on_pointing_where_it_did(bench):
    start = kinematics.rotation(bench.motion.tcp_pose[3:])
    bench.run("speedl([0, 0, 0, 0, 0, 0.5], a=2, t=1)")
    bench.cycles(60)
    turned = kinematics.rotation(bench.motion.tcp_pose[3:])
    assert turned[:, 2] == pytest.approx(start[:, 2], abs=1e-6)
    x, y, z = kinematics.rotation_vector(turned @ start.T)
    assert (x, y) == pytest.approx((0, 0), abs=1e-6) and 0.1 < z < 0.3
    assert bench.motion.tcp_speed == pytest.approx((0, 0, 0, 0, 0, 0.5), abs=1e-6)


def test_joint_speed_is_reached_and_ends_with_its_program(bench):
    bench.run("speedj([0, 0, 0, 0, 0, 0.5], a=2, t=0.5)")
    bench.cycles(50)
    assert bench.motion.qd == pytest.approx((0, 0, 0, 0, 0, 0.5), abs=1e-6)
    bench.cycles(150)
    assert bench.motion.qd == (0.0,) * 6
    assert not bench.motion.moving


def test_servo_follows_its_target_within_its_look_ahead(bench):
    target = bench.motion.q[5] + 0.05
    bench.run(
        "q = get_actual_joint_positions()\nq[5] = q[5] + 0.05\nwhile True:\n"
        " servoj(q, 0, 0, 0.008, 0.05, 300)\n end"
    )
    bench.cycles(5)
    assert bench.motion.q[5] < target - 0.005
    bench.cycles(40)
    assert bench.motion.q[5] == pytest.approx(target, abs=1e-4)
    assert bench.controller.safety_mode is SafetyMode.NORMAL


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("speedj([0, 0, 0, 0, 0, 4], a=40, t=1)", "joint 5 too fast"),
        ("speedj([0, 0, 0, 0, 0, -3], a=40, t=3)", "joint 5 at its limit"),
        ("while True:\n speedl([-0.5, 0, 0, 0, 0, 0], a=5)\n end", "joint"),
        ("servoj([0, 0, 0, 0, 0, 0])", "too fast"),
    ],
)
def test_what_no_joint_can_do_is_a_protective_stop(bench, body, said):
    bench.run(body)
    bench.cycles(600)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert any(said in line for line in bench.controller.messages), bench.controller.messages
    assert bench.motion.tcp_speed == (0.0,) * 6


def test_speed_slider_slows_a_move_down(bench):
    bench.cycles(1, {"speed_slider_mask": (1,), "speed_slider_fraction": (0.5,)})
    bench.cycles(40)  # the arm does not come to it at once
    bench.run(
        "q = get_actual_joint_positions()\nq[5] = q[5] + 0.6\nmovej(q, a=2, v=1)\n"
        "write_output_integer_register(5, 7)"
    )
    done = bench.controller.registers.values["output", "int"]
    count = next(n for n in itertools.count(1) if bench.cycles(1) or done[5] == 7)
    assert count * 0.008 == pytest.approx(2.2, abs=0.05)


def test_line_under_way_follows_the_speed_slider_as_the_arm_of_virtual_time_does(bench):
    """0.1 m at 0.25 m/s, slowed down to two fifths after 0.2 s, and let go on after another 2."""
    virtual = ArmModel(ArmModelSettings(command_latency_s=0.0), 0)
    bench.run(f"movel(p[0.5, 0.1, 0.4, {DOWN}], a=1.2, v=0.25)")
    until = bench.now_ns + PERIOD_NS
    virtual.move_l((0.5, 0.1, 0.4), 0.25, 1.2, until)
    for cycles, fraction in ((25, 0.4), (12, 0.0), (250, 1.0)):
        bench.cycles(cycles)
        virtual.turn_slider(fraction, bench.now_ns)
        bench.controller.ports.set_speed(fraction)
    places, told = [], []
    for _ in range(60):
        bench.cycles(1)
        places.append(bench.motion.position)
        told.append(virtual.position(bench.now_ns))
    assert places == told
    assert len(set(places)) > 10 and places[-1] == (0.5, 0.1, 0.4)


@pytest.mark.parametrize("fraction", [-0.1, 1.1, math.nan])
def test_slider_has_two_ends(bench, fraction):
    bench.cycles(1, {"speed_slider_mask": (1,), "speed_slider_fraction": (0.4,)})
    bench.cycles(1, {"speed_slider_mask": (1,), "speed_slider_fraction": (fraction,)})
    assert bench.arm.read(bench.now_ns).speed_fraction == 0.4


def test_outputs_are_read_back(bench):
    told(
        bench,
        "digital_out[1] = True\nset_configurable_digital_out(0, True)\nset_tool_digital_out(1,"
        " True)\nset_standard_analog_out(0, 0.5)\nset_analog_outputdomain(1, 0)\n"
        "write_output_boolean_register(70, get_digital_out(1))\n"
        "write_output_boolean_register(3, not get_digital_out(0))",
    )
    values = output_values(bench.controller)
    assert values["actual_digital_output_bits"] == (1 << 1 | 1 << 8 | 1 << 17,)
    assert values["standard_analog_output0"] == (5.0,)
    assert values["standard_analog_output1"] == (0.004,)
    assert values["output_bit_register_70"] == (True,)
    assert values["output_bit_registers0_to_31"] == (1 << 3,)
    bench.cycles(1, {"standard_digital_output_mask": (3,), "standard_digital_output": (1,)})
    values = output_values(bench.controller)
    assert values["actual_digital_output_bits"] == (1 << 0 | 1 << 8 | 1 << 17,)


def test_flags_and_the_voltage_of_the_tool_are_read_back_by_later_programs(bench):
    told(bench, "set_flag(31, True)\nset_flag(0, False)\nset_tool_voltage(24)")
    told(
        bench,
        "write_output_boolean_register(0, get_flag(31))\n"
        "write_output_boolean_register(1, get_flag(0))",
    )
    assert bench.controller.registers.values["output", "bit"][:2] == [True, False]
    assert output_values(bench.controller)["tool_output_voltage"] == (24,)
    profile = EmulatorSettings(host="").controller
    tool = dict(packages(state_message(bench.controller, profile)[5:]))[2]
    assert tool[22] == 24  # behind two ranges, two readings and the box's voltage


@pytest.mark.parametrize(
    ("call", "why"),
    [
        ("force_mode_set_damping(0.1)", "force mode is not emulated"),
        ("force_mode_set_gain_scaling(0.5)", "force mode is not emulated"),
        ("set_gravity([0, 0, 9.82])", "gravity is not modelled"),
    ],
)
def test_settings_without_effect_are_told_in_the_log(bench, call, why):
    """Not refused: ur_rtde's own script sets those of force mode as it starts."""
    told(bench, call)
    said = f"{call.partition('(')[0]} has no effect: {why}"
    assert said in " ".join(bench.controller.messages)


def test_inputs_are_what_the_control_channel_says(bench):
    channel = FaultChannel(bench.controller, RtdeServer(EmulatorSettings(host="").controller), None)
    for wrong in ("[1, 2]", "[-1, 0, 0]", "[262144, 0, 0]", "[1e999, 0, 0]"):
        assert '"ok":false' in channel.answer(f'{{"do": "inputs", "value": {wrong}}}')
    assert '"ok":true' in channel.answer('{"do": "inputs", "value": [258, 1.5, 0.0]}')
    assert '"ok":false' in channel.answer('{"do": "speed_slider", "fraction": 1.5}')
    assert '"ok":true' in channel.answer('{"do": "speed_slider", "fraction": 0.5}')
    bench.cycles(1)
    assert bench.arm.read(bench.now_ns).speed_fraction == 0.5
    told(
        bench,
        "write_output_boolean_register(0, get_standard_digital_in(1))\n"
        "write_output_boolean_register(1, get_configurable_digital_in(0))\n"
        "write_output_boolean_register(2, get_digital_in(0))\n"
        "write_output_float_register(0, get_standard_analog_in(0))",
    )
    assert bench.controller.registers.values["output", "bit"][:3] == [True, True, False]
    assert bench.controller.registers.values["output", "double"][0] == 1.5
    assert output_values(bench.controller)["actual_digital_input_bits"] == (258,)


CALCULATIONS = {
    "sin(d2r(30))": 0.5,
    "atan2(1, 1)": math.pi / 4,
    "pow(2, 10)": 1024.0,
    "log(2, 8)": 3.0,
    "floor(sqrt(17))": 4.0,
    "length([1, 2, 3])": 3,
    'str_len(str_cat("ab", 12))': 4,
    'to_num("2.5") * 2': 5.0,
    'str_find("abcd", "cd")': 2,
    "binary_list_to_integer([True, False, True])": 5,
    "norm(pose_sub(p[1,0,0,0,0,0], p[0,0,0,0,0,0]))": 1.0,
    "point_dist(p[0,0,0,0,0,0], p[3,4,0,0,0,0])": 5.0,
    "norm(normalize([3, 4]))": 1.0,
    "point_dist(pose_trans(p[1,2,3,0,1,0], pose_inv(p[1,2,3,0,1,0])), p[0,0,0,0,0,0])": 0.0,
    "point_dist(interpolate_pose(p[0,0,0,0,0,0], p[2,0,0,0,0,1], 0.5), p[1,0,0,0,0,0])": 0.0,
    "force()": 5.0,
    "get_target_speed_fraction()": 1.0,
}


def test_program_that_plays_is_paused_where_it_stands_and_goes_on_from_there(bench):
    assert not bench.controller.pause_program()
    assert "no program plays" in bench.last
    bench.run("i = 0\nwhile True:\n i = i + 1\n write_output_integer_register(5, i)\n sync()\n end")
    bench.cycles(10)
    counted = bench.controller.registers.values["output", "int"]
    assert bench.controller.pause_program()
    assert bench.controller.runtime_state is RuntimeState.PAUSED
    paused_at = counted[5]
    bench.cycles(10)
    assert counted[5] == paused_at > 0
    assert not bench.controller.pause_program()
    assert bench.controller.resume_program()
    bench.cycles(5)
    assert counted[5] == paused_at + 5


@pytest.mark.parametrize("calculation", CALCULATIONS)
def test_ordinary_programs_compute(bench, calculation):
    bench.controller.apply_wrench((0.0, 3.0, -4.0, 0.0, 0.0, 0.0))
    told(bench, f"write_output_float_register(0, {calculation})")
    found = bench.controller.registers.values["output", "double"][0]
    assert found == pytest.approx(CALCULATIONS[calculation], abs=1e-9)


def test_watchdog_counts_writes_of_its_input(bench):
    bench.run('rtde_set_watchdog("input_int_register_0", 10, "stop")\nwhile True:\n sync()\n end')
    bench.cycles(2)
    for _ in range(5):
        bench.cycles(10)
        bench.cycles(1, {"input_int_register_0": (0,)})
    assert bench.controller.runtime_state is RuntimeState.PLAYING
    bench.cycles(14)
    assert bench.controller.runtime_state is RuntimeState.STOPPED


def test_stop_by_the_world_is_a_protective_stop(bench):
    bench.run(f"movel(p[0.5, 0.1, 0.5, {DOWN}], a=1, v=0.1)")
    bench.cycles(50)
    bench.arm.trip(bench.now_ns)
    bench.cycles(2)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert bench.controller.runtime_state is RuntimeState.PAUSED
    assert not bench.controller.unlock_protective_stop()
    bench.cycles(700)
    assert bench.controller.unlock_protective_stop()
    assert not bench.arm.protective_stop
    assert bench.controller.runtime_state is RuntimeState.STOPPED


def test_world_of_somebody_else_is_advanced_before_it_is_read(emulate):
    """One loop, one clock: every cycle hands its time to the owner of the arm."""
    host = emulate().host.rsplit(".", 1)[0] + ".253"
    times = []
    arm = ArmModel(ArmModelSettings(start_m=(0.6, 0.0, 0.4)), 0)
    settings = EmulatorSettings(host=host)
    with UrEmulator(settings, arm, threading.Lock(), times.append) as emulator:
        emulator.run(lambda: emulator.controller.cycles >= 5)
        assert emulator.controller.motion.position == (0.6, 0.0, 0.4)
    assert len(times) >= 5
    assert all((b - a) % PERIOD_NS == 0 for a, b in itertools.pairwise(times))


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "localhost"])
def test_only_loopback_addresses_are_served(host):
    with pytest.raises(ValueError, match="address"):
        UrEmulator(EmulatorSettings(host=host))


def test_beyond_loopback_its_control_channel_asks_for_a_token(bench):
    rtde = RtdeServer(EmulatorSettings(host="").controller)
    channel = FaultChannel(bench.controller, rtde, None, "secret")
    for wrong in ('{"do": "state"}', '{"do": "state", "token": "secre"}'):
        assert "token" in channel.answer(wrong)
    assert '"ok":true' in channel.answer('{"do": "protective_stop", "token": "secret"}')
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
