"""Exchanges of clients that cannot be installed here, as their sources have them.

UR's Python RTDE client (`record.py`, `example_control_loop.py`), UR's C++ client library
(`rtde_client`, `dashboard_example`, `primary_pipeline`), and python-urx's monitor of port 30002.
"""

import itertools
import math
import socket
import struct
import time

import pytest

from drivers.ur import kinematics
from tests.wire.drivers.ur.emulator.test_process import Rtde, send_program

WIDTHS = {
    "DOUBLE": "d", "UINT32": "I", "INT32": "i", "UINT64": "Q", "UINT8": "B", "BOOL": "?",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip

TRIES = 20  # of a recording: a machine that stands still leaves out cycles

# record_configuration.xml as it is shipped, of two versions
RECORD = (  # noqa: SIM905
    "timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd "
    "actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force "
    "target_TCP_pose target_TCP_speed actual_digital_input_bits joint_temperatures "
    "actual_execution_time robot_mode joint_mode safety_mode actual_tool_accelerometer "
    "speed_scaling target_speed_fraction actual_momentum actual_main_voltage actual_robot_voltage "
    "actual_robot_current actual_joint_voltage actual_digital_output_bits runtime_state"
).split()
RECORD_NEWER = [*RECORD, "safety_status", "joint_position_deviation_ratio"]
COMMENTED_OUT = [
    *("payload", "payload_cog", "script_control_line"),
    *(f"output_bit_registers{word}" for word in ("0_to_31", "32_to_63")),
    *(f"output_{kind}_register_{n}" for kind in ("int", "double") for n in range(24)),
]
# of the C++ client library's stock recipe
RECIPE = (  # noqa: SIM905
    "timestamp actual_q actual_qd speed_scaling target_speed_fraction runtime_state "
    "actual_TCP_force actual_TCP_pose actual_digital_input_bits actual_digital_output_bits "
    "standard_analog_input0 standard_analog_input1 standard_analog_output0 standard_analog_output1 "
    "analog_io_types tool_mode tool_analog_input_types tool_analog_input0 tool_analog_input1 "
    "tool_output_voltage tool_output_current tool_temperature robot_mode safety_mode "
    "robot_status_bits safety_status_bits actual_current tcp_offset"
).split()
# its stock inputs
INPUT_RECIPE = {
    "speed_slider_mask": "UINT32", "speed_slider_fraction": "DOUBLE",
    **{f"{group}_digital_output{end}": "UINT8" for group in ("standard", "configurable", "tool")
       for end in ("_mask", "")},
    "standard_analog_output_mask": "UINT8", "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE", "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
}  # fmt: skip


def recorded(host, names, rate_hz, samples):
    """As `record.py` does it: version, recipe, start, so many packets, pause."""
    with Rtde(host) as rtde:
        assert rtde.ask("V", struct.pack(">H", 2)) == ("V", b"\x01")
        assert rtde.ask("v")[0] == "v"
        kind, body = rtde.ask("O", struct.pack(">d", rate_hz) + ",".join(names).encode())
        types = body[1:].decode().split(",")
        assert kind == "O" and body[0] and "NOT_FOUND" not in types
        layout = struct.Struct(">B" + "".join(WIDTHS[one] for one in types))
        assert rtde.ask("S") == ("S", b"\x01")
        found = [layout.unpack(rtde.read()[1]) for _ in range(samples)]
        rtde.sock.sendall(struct.pack(">HB", 3, ord("P")))
        while (answer := rtde.read())[0] == "U":
            pass
        assert answer == ("P", b"\x01")
        return found


@pytest.mark.parametrize("names", [[*RECORD_NEWER, *COMMENTED_OUT], RECIPE])
@pytest.mark.parametrize(("profile", "rate_hz"), [("cb3", 125), ("e-series", 500)])
def test_stock_recipes_are_recorded_without_a_gap(emulate, names, profile, rate_hz):
    host = emulate("--profile", profile).host
    for _ in range(TRIES):
        found = recorded(host, names, rate_hz, 50)
        steps = {round((b[1] - a[1]) * rate_hz, 6) for a, b in itertools.pairwise(found)}
        assert all(step == round(step) >= 1.0 for step in steps)
        if steps == {1.0}:
            return
    raise AssertionError(steps)


# what UR's rtde_control_loop.urp does; its watchdog is of 1 Hz, which a busy machine may not keep
CONTROL_LOOP = """def rtde_control_loop():
 rtde_set_watchdog("input_int_register_0", 0.5, "stop")
 write_output_integer_register(0, 0)
 while True:
  write_output_integer_register(0, 1)
  while read_input_integer_register(0) != 1:
   sync()
  end
  setp = p[0, 0, 0, 0, 0, 0]
  i = 0
  while i < 6:
   setp[i] = read_input_float_register(i)
   i = i + 1
  end
  movej(setp, a=3, v=2)
  write_output_integer_register(0, 0)
  while read_input_integer_register(0) == 1:
   sync()
  end
 end
end
"""
SET_POINTS = ((-0.12, -0.43, 0.14, 0, 3.11, 0.04), (-0.12, -0.51, 0.21, 0, 3.11, 0.04))


def test_example_control_loop(emulator):
    """`example_control_loop.py`: its recipes, its handshake, and both set-points in turn."""
    send_program(emulator.host, CONTROL_LOOP)
    with Rtde(emulator.host) as rtde:
        assert rtde.ask("V", struct.pack(">H", 2)) == ("V", b"\x01")
        assert rtde.ask("v")[0] == "v"
        state = b"target_q,target_qd,output_int_register_0"
        kinds = b"\x01VECTOR6D,VECTOR6D,INT32"
        assert rtde.ask("O", struct.pack(">d", 125.0) + state) == ("O", kinds)
        set_point = ",".join(f"input_double_register_{n}" for n in range(6)).encode()
        assert rtde.ask("I", set_point)[1] == b"\x01" + b",".join([b"DOUBLE"] * 6)
        assert rtde.ask("I", b"input_int_register_0")[1] == b"\x02INT32"
        assert rtde.ask("S") == ("S", b"\x01")
        told, completed, kick, moved, reached = SET_POINTS[0], True, 0, 0.0, []
        deadline = time.monotonic() + 30.0
        while len(reached) < 3:
            assert time.monotonic() < deadline, emulator.fault(do="state")
            kind, body = rtde.read()
            _, *joints, register = struct.unpack(">B12di", body)
            assert kind == "U"
            moved = max(moved, *map(abs, joints[6:]))
            if completed and register == 1:
                completed, told, kick = False, SET_POINTS[told == SET_POINTS[0]], 1
                rtde.sock.sendall(struct.pack(">HBB6d", 52, ord("U"), 1, *told))
            elif not completed and register == 0:
                assert moved > 0.1
                reached.append((told, kinematics.pose(kinematics.forward(joints[:6]))))
                completed, kick, moved = True, 0, 0.0
            rtde.sock.sendall(struct.pack(">HBBi", 8, ord("U"), 2, kick))
    assert [told for told, _ in reached] == [SET_POINTS[n] for n in (1, 0, 1)]
    for told, pose in reached:
        assert pose == pytest.approx(told, abs=1e-6)
    deadline = time.monotonic() + 15.0
    while "watchdog" not in " ".join((said := emulator.fault(do="state"))["messages"]):
        assert time.monotonic() < deadline, said


def test_inputs_of_the_stock_recipe_are_taken_and_read_back(emulate):
    """The C++ client library's `rtde_input_recipe.txt`; what it sends is read in its outputs."""
    with Rtde(emulate("--profile", "e-series").host) as rtde:
        assert rtde.ask("V", struct.pack(">H", 2)) == ("V", b"\x01")
        read_back = (
            "target_speed_fraction,actual_digital_output_bits,analog_io_types,"
            "standard_analog_output0,standard_analog_output1"
        )
        kinds = b"\x01DOUBLE,UINT64,UINT32,DOUBLE,DOUBLE"
        assert rtde.ask("O", struct.pack(">d", 500.0) + read_back.encode())[1] == kinds
        number, *kinds = rtde.ask("I", ",".join(INPUT_RECIPE).encode())[1].decode().split(",")
        assert (number[0], [number[1:], *kinds]) == ("\x01", list(INPUT_RECIPE.values()))
        assert rtde.ask("S") == ("S", b"\x01")
        sent = (1, 0.5, 255, 5, 255, 2, 3, 2, 3, 2, 0.25, 0.75, *range(6))
        layout = struct.Struct(">B" + "".join(WIDTHS[kind] for kind in INPUT_RECIPE.values()))
        rtde.sock.sendall(struct.pack(">HB", 3 + layout.size, ord("U")) + layout.pack(1, *sent))
        bits = 5 | 2 << 8 | 2 << 16
        expected = (0.5, bits, 0b1011, pytest.approx(0.008), pytest.approx(7.5))
        deadline = time.monotonic() + 15.0
        while (found := struct.unpack(">BdQIdd", rtde.read()[1])[1:]) != expected:
            assert time.monotonic() < deadline, found


def test_dashboard_example(emulator):
    """`dashboard_example.cpp`: each command and what the library expects of its answer."""
    steps = [
        ("power off", "Powering off"), ("robotmode", "Robotmode: POWER_OFF"),
        ("close safety popup", "closing safety popup"),
        ("power on", "Powering on"), ("robotmode", "Robotmode: IDLE"),
        ("brake release", "Brake releasing"), ("robotmode", "Robotmode: RUNNING"),
        ("load wait_program.urp", "Loading program: "), ("programState", "STOPPED"),
        ("play", "Starting program"), ("programState", "PLAYING"),
        ("pause", "Pausing program"), ("programState", "PAUSED"),
        ("play", "Starting program"), ("programState", "PLAYING"),
        ("stop", "Stopped"), ("programState", "STOPPED"),
        ("power off", "Powering off"), ("saveLog", "Log saved to disk"),
        ("load nothing.urp", "File not found"), ("popup hello", "Failed to execute"),
    ]  # fmt: skip
    with socket.create_connection((emulator.host, 29999), timeout=10.0) as sock:
        lines = sock.makefile("rw")
        lines.readline()
        deadline = time.monotonic() + 30.0
        for command, expected in steps:
            answer = ""
            while expected not in answer:  # the library asks for a state until it is there
                lines.write(command + "\n")
                lines.flush()
                answer = lines.readline()
                assert time.monotonic() < deadline, (command, answer)
                assert command == "programState" or expected in answer, (command, answer)


class Primary:
    """Packages of port 30001 or 30002."""

    def __init__(self, host, port):
        self.sock = socket.create_connection((host, port), timeout=10.0)
        self.file = self.sock.makefile("rb")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()
        self.sock.close()

    def read(self):
        size, kind = struct.unpack(">IB", self.file.read(5))
        return kind, self.file.read(size - 5)

    def state(self):
        """The next state, by number of its packages."""
        while True:
            kind, body = self.read()
            if kind == 16:
                return dict(packages(body))


def packages(body):
    while body:
        size, kind = struct.unpack_from(">IB", body)
        yield kind, body[5:size]
        body = body[size:]


def test_version_comes_first_then_the_state_ten_times_a_second(emulator):
    with Primary(emulator.host, 30001) as primary:
        kind, body = primary.read()
        assert kind == 20
        _, _, message, length = struct.unpack_from(">QbbB", body)
        assert message == 3
        after = struct.unpack_from(">BBii", body, 11 + length)
        assert (body[11 : 11 + length], after) == (b"URControl", (3, 15, 8, 106339))
        times = [struct.unpack_from(">Q", primary.state()[0])[0] for _ in range(4)]
        gaps = [b - a for a, b in itertools.pairwise(times)]
        assert all(gap % 96_000 == 0 for gap in gaps)  # twelve cycles


def test_state_has_the_sizes_and_values_that_python_urx_reads(emulator):
    """A mode package of 47 bytes says version 3.5 or later to it."""
    with Primary(emulator.host, 30002) as primary:
        found = primary.state()
        sizes = {kind: 5 + len(body) for kind, body in found.items()}
        assert sizes == {0: 47, 1: 251, 2: 37, 3: 72, 4: 101, 5: 225, 6: 445, 7: 61, 8: 8}
        mode = struct.unpack(">Q7?BB3dB", found[0])
        assert mode[1:8] == (True, True, True, False, False, False, False)
        assert mode[8] == 7
        pose = struct.unpack_from(">6d", found[4])
        assert pose == pytest.approx((0.5, 0.1, 0.3, math.pi, 0, 0), abs=1e-6)
        primary.sock.sendall(b"def go():\n set_digital_out(2, True)\n sleep(3)\nend\n")
        deadline = time.monotonic() + 15.0
        while not struct.unpack_from(">ii", (found := primary.state())[3])[1] & 4:
            assert time.monotonic() < deadline
        assert struct.unpack(">Q7?BB3dB", found[0])[6]  # a program runs


@pytest.mark.parametrize(("profile", "period_s"), [("cb3", 0.008), ("e-series", 0.002)])
def test_real_time_port_tells_every_cycle_what_rtde_tells(emulate, profile, period_s):
    """1116 bytes: of PolyScope 3.10 to 3.15, and 5.4 to 5.8."""
    emulator = emulate("--profile", profile)
    emulator.fault(do="wrench", value=[1, 2, 3, 4, 5, 6])
    (known,) = recorded(emulator.host, ["actual_q", "robot_mode", "safety_status"], 125, 1)
    with (
        socket.create_connection((emulator.host, 30003), timeout=10.0) as sock,
        sock.makefile("rb") as file,
    ):
        packets = [struct.unpack(">I139d", file.read(1116)) for _ in range(20)]
    assert {packet[0] for packet in packets} == {1116}
    steps = {round((b[1] - a[1]) / period_s, 3) for a, b in itertools.pairwise(packets)}
    assert all(step == round(step) >= 1.0 for step in steps)  # a busy machine leaves out some
    last = packets[-1]
    assert last[32:38] == known[1:7]
    assert last[56:59] == pytest.approx((0.5, 0.1, 0.3))
    assert last[68:74] == (1, 2, 3, 4, 5, 6)
    assert (last[95], last[102], last[132]) == (known[7], 1.0, 1.0)  # no program: stopped
    assert last[139] == known[8]


def test_kinematics_of_the_primary_interface_are_those_of_the_arm(emulator):
    """`primary_pipeline_calibration`: Denavit-Hartenberg parameters, which give the pose of q."""
    with Primary(emulator.host, 30001) as primary:
        found = primary.state()
    flat = struct.unpack(">6I24dI", found[5])[6:30]
    theta, a, d, alpha = (flat[n : n + 6] for n in (0, 6, 12, 18))
    assert (theta, a[1], d[0]) == ((0.0,) * 6, -0.612, 0.1273)
    assert alpha[0] == pytest.approx(math.pi / 2)
