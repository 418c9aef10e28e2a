"""The emulated controller without sockets, in virtual time; and around a world of somebody else."""

import itertools
import math
import struct
import threading
import time

import pytest

from drivers.fairness import Budget
from drivers.ur.emulator.controller import RuntimeState, SafetyMode
from drivers.ur.emulator.faults import FaultChannel
from drivers.ur.emulator.fields import output_values
from drivers.ur.emulator.primary import state_message
from drivers.ur.emulator.robot import UrEmulator
from drivers.ur.emulator.rtde import RtdeServer
from drivers.ur.emulator.settings import EmulatorSettings
from drivers.ur.model import ArmModel, ArmModelSettings
from tests.wire.drivers.ur.emulator.bench import DOWN, PERIOD_NS, told
from tests.wire.drivers.ur.emulator.test_stock_clients import packages


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
