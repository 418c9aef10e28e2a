"""Exchanges of clients that cannot be installed here, as their sources have them.

UR's Python RTDE client (`record.py`, `example_control_loop.py`), UR's C++ client library
(`rtde_client`, `dashboard_example`, `primary_pipeline`), and python-urx's monitor of port 30002.
"""

import itertools
import struct
import time

import pytest

from tests.wire.drivers.ur.emulator.test_process import Rtde

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
