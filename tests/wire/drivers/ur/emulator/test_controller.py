"""The emulated controller without sockets, in virtual time, and with an external arm model."""

import itertools
import math
import threading

import pytest

from drivers.ur.emulator.controller import EmulatorSettings, RuntimeState, SafetyMode
from drivers.ur.emulator.dashboard import FaultChannel
from drivers.ur.emulator.rtde import RtdeServer
from drivers.ur.emulator.server import UrEmulator
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings
from tests.wire.cases import case
from tests.wire.drivers.ur.emulator.bench import DOWN, PERIOD_NS, Bench, run_to_end


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


def test_join_waits_for_the_end_of_a_thread(bench):
    run_to_end(
        bench,
        "global done = 0\n thread t():\n sleep(0.4)\n done = 7\n return False\n end\n"
        "h = run t()\n join h\n join h\n write_output_integer_register(1, done)",
    )
    assert bench.controller.registers.values["output", "int"][1] == 7


def test_invalid_arguments_end_the_program_without_motion(bench):
    for call in [
        "movel([1e999, 0, 0, 0, 0, 0])",
        "speedl([0, 0, 0, 0, 0.2, 0])",
        "movel(p[0.5, 0.1, 0.4, 2.9, 0.4, 0.1])",
        f"movel(p[5, 0, 0, {DOWN}])",
        f"movel(p[1e300, 0, 0, {DOWN}])",
        f"movel(p[0.5, 0.1, 0.4, {DOWN}], v=0)",
        f"movel(p[0.5, 0.1, 0.4, {DOWN}], t=-3)",
        "movel(p[0.5, 0.1, 1.3, 0, 0, 0])",
        "force_mode(p[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0])",
        "movep(p[0.5, 0.1, 0.3, 0, 0, 0])",
        "stopl(0)",
        "speedl([0, 0, 0.1, 0, 0, 0], a=0)",
        "write_output_integer_register(48, 1)",
        "read_input_float_register(-1)",
        'rtde_set_watchdog("input_int_register_0", 0, "stop")',
        "get_inverse_kin(p[9, 9, 9, 0, 0, 0])",
        "set_tcp(p[0, 0, 0, 0, 0, 1e999])",
        'rtde_set_watchdog("input_int_register_0", 1e-300, "stop")',
        "set_payload(-5)",
        "set_target_payload(-1, [0, 0, 0])",
    ]:
        with case(call):
            bench = Bench()
            bench.run(call)
            bench.cycles(3)
            assert bench.controller.script_errors == 1, bench.last
            assert bench.controller.runtime_state is RuntimeState.STOPPED
            assert math.dist(bench.motion.position, (0.5, 0.1, 0.3)) < 1e-9


def test_a_trip_of_the_arm_model_is_a_protective_stop(bench):
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


def test_the_owner_of_the_world_advances_it_before_each_cycle(emulate):
    """Every cycle passes its time to the owner of the arm model."""
    host = emulate().host.rsplit(".", 1)[0] + ".253"
    times = []
    arm = ArmModel(ArmModelSettings(start_m=(0.6, 0.0, 0.4)), 0)
    settings = EmulatorSettings(host=host)
    with UrEmulator(settings, arm, threading.Lock(), times.append) as emulator:
        emulator.run(lambda: emulator.controller.cycles >= 5)
        assert emulator.controller.motion.position == (0.6, 0.0, 0.4)
    assert len(times) >= 5
    assert all((b - a) % PERIOD_NS == 0 for a, b in itertools.pairwise(times))


def test_only_loopback_addresses_are_served():
    for host in ["0.0.0.0", "192.0.2.1", "localhost"]:
        with case(host), pytest.raises(ValueError, match="address"):
            UrEmulator(EmulatorSettings(host=host))


def test_beyond_loopback_the_control_channel_requires_a_token(bench):
    rtde = RtdeServer(EmulatorSettings(host="").controller)
    channel = FaultChannel(bench.controller, rtde, None, "secret")
    for wrong in ('{"do": "state"}', '{"do": "state", "token": "secre"}'):
        assert "token" in channel.reply(wrong)
    assert '"ok":true' in channel.reply('{"do": "protective_stop", "token": "secret"}')
    assert bench.controller.safety_mode is SafetyMode.PROTECTIVE_STOP
