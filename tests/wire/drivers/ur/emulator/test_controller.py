"""The emulated controller without sockets, in virtual time; and around a world of somebody else."""

import itertools
import math
import threading
from contextlib import nullcontext

import pytest

from drivers.ur.emulator.controller import Controller, RuntimeState, SafetyMode
from drivers.ur.emulator.faults import FaultChannel
from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.emulator.robot import UrEmulator
from drivers.ur.emulator.rtde import RtdeServer
from drivers.ur.emulator.settings import EmulatorSettings
from drivers.ur.model import ArmModel, ArmModelSettings

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
        f"movel(p[0.5, 0.1, 0.4, {DOWN}], t=3)",
        "movel(p[0.5, 0.1, 0.4, 0, 0, 0])",
        "stopl(0)",
        "stopj(-1)",
        "speedl([0, 0, 0.1, 0.1, 0, 0])",
        "speedl([0, 0, 0.1, 0, 0, 0], a=0)",
        "servoj([0, 0, 0, 0, 0, 0])",
        "sleep(1e999)",
        "write_output_integer_register(48, 1)",
        "write_output_integer_register(0, 1.5)",
        "write_output_float_register(0, 1e999)",
        "read_input_float_register(-1)",
        'rtde_set_watchdog("input_int_register_0", 0, "stop")',
        "get_inverse_kin(p[9, 9, 9, 0, 0, 0])",
        "get_inverse_kin(p[0.5, 0.1, 0.3, 1e300, 1e300, 0])",
        "set_tcp(p[0, 0, 0, 0, 0, 1e999])",
        "set_payload(1, [0])",
    ],
)
def test_bad_arguments_end_the_program_and_nothing_moves(bench, call):
    bench.run(call)
    bench.cycles(3)
    assert bench.controller.script_errors == 1, bench.last
    assert bench.controller.runtime_state is RuntimeState.STOPPED
    assert math.dist(bench.motion.position, (0.5, 0.1, 0.3)) < 1e-9


def test_motion_out_of_reach_is_a_protective_stop(bench):
    bench.run("while True:\n speedl([0.5, 0, 0, 0, 0, 0], a=5)\n end")
    bench.cycles(400)
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert bench.motion.velocity == (0.0, 0.0, 0.0)
    assert bench.motion.position[0] < 1.5


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
