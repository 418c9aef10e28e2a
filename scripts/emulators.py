"""docs/emulators.md: which client can do what with the emulated devices, by the tests that show it.

    python scripts/emulators.py          run those tests, and write the table of the page anew

Clients of the package index that the project does not need are installed by pip into a folder of
their own, which is gone afterwards, and found by `PYTHONPATH`
(`tests/nightly/test_pip_clients.py`). A row whose test fails twice is written as failing; one whose
client cannot be had keeps what it says on the page. Either is named, and the script ends with 1.
"""

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

HOME = Path(__file__).resolve().parent.parent
PAGE = HOME / "docs" / "emulators.md"
HEAD, END = "| client | does | status |", "<!-- end of clients -->"
UR = "tests/wire/drivers/ur/emulator"
RTDE, STOCK = f"{UR}/test_ur_rtde.py::test", f"{UR}/test_stock_clients.py::test"
PIP = "tests/nightly/test_pip_clients.py::test_client_of_the_arm_does_what_the_page_says"
BAD = f"{UR}/test_controller.py::test_bad_arguments_end_the_program_and_nothing_moves"
SENDER = (
    f"{UR}/test_process.py::"
    "test_sender_of_what_is_not_emulated_sees_its_program_end_and_the_log_says_why"
)
BUS = "tests/wire/drivers/takktile/test_bus.py::test"
EMULATE = "tests/wire/scenarios/cell/test_emulate.py::test"
MODBUS = (
    "tests/nightly/test_pip_clients.py::"
    "test_client_of_the_gripper_activates_the_hand_moves_it_and_reads_back"
)

CLIENTS = (  # the versions that rows name
    "urx==0.11.0", "math3d<4", "urinterface==0.0.5",
    "pyModbusTCP==0.3.1", "uModbus==1.0.4", "modbus-tk==1.1.5", "minimalmodbus==2.1.1",
)  # fmt: skip

REFUSED = "refused: the program ends, the next call says so, the log says why"


class Row(NamedTuple):
    """What a client does, how it ends, and the test that plays it."""

    client: str
    function: str
    status: str
    test: str


def _ur_rtde(scenario: str, function: str, status: str = "works", kind: str = "cb3") -> Row:
    return Row("ur_rtde 1.6.5", function, status, f"{RTDE}_{kind}[{scenario}]")


ROWS = (
    _ur_rtde("fields", "receive: pose, joints, modes, bits, time stamps"),
    _ur_rtde("move_l", "moveL, moveJ, forward and inverse kinematics"),
    _ur_rtde("turns", "moveL, moveJ, moveJ_IK, speedL that turn the tool"),
    _ur_rtde("async_move_and_stop", "moveL asynchronous, progress, stopL"),
    _ur_rtde("path", "moveL of a path (blend radii are ignored)"),
    _ur_rtde("speed_l", "speedL, speedStop, isSteady"),
    _ur_rtde("joint_speeds", "speedJ, speedStop"),
    _ur_rtde("servo", "servoJ, servoL, servoStop"),
    _ur_rtde("settings", "setPayload, setTcp, safety limits of a pose"),
    _ur_rtde("io", "digital and analog outputs, speed slider, registers: read back"),
    _ur_rtde("wrench", "force readings, zeroFtSensor (the force is told by the fault channel)"),
    _ur_rtde("watchdog", "setWatchdog, reuploadScript"),
    _ur_rtde("protective_stop", "protective stop, unlocked by the dashboard"),
    _ur_rtde("emergency_stop", "emergency stop, power on, brake release"),
    _ur_rtde("custom_script", "custom script"),
    _ur_rtde("pose_trans", "poseTrans; pose_trans in a custom script"),
    _ur_rtde("dashboard", "dashboard: power, load, play, pause, stop, log"),
    _ur_rtde("stop_after_speed", "stopL after speedL", "ends the program, as on a robot"),
    _ur_rtde("in_use", "a second controlling client", "refused: registers in use"),
    _ur_rtde("not_emulated", "servoC, forceMode, teachMode", REFUSED),
    _ur_rtde("force_settings", "forceModeSetDamping",
             "taken without effect (its own script does so as it starts), the log says so"),
    _ur_rtde("move_l", "moveL, moveJ at 500 Hz", "works", "e_series_at_500_hz"),
    _ur_rtde("speed_l", "speedL at 500 Hz", "works", "e_series_at_500_hz"),
    _ur_rtde("pose_trans", "poseTrans; pose_trans in a custom script, at 500 Hz", "works",
             "e_series_at_500_hz"),
    _ur_rtde("not_remote", "without remote control", "refused", "e_series_at_500_hz"),
    _ur_rtde("contact_refused", "moveUntilContact, freedriveMode", REFUSED, "e_series_at_500_hz"),
    Row("UR's Python RTDE client, exchange", "record.py with its stock recipe", "works",
        f"{STOCK}_stock_recipes_are_recorded_without_a_gap[cb3-125-names0]"),
    Row("UR's Python RTDE client, exchange", "record.py, all that its recipe comments out", "works",
        f"{STOCK}_stock_recipes_are_recorded_without_a_gap[cb3-125-names2]"),
    Row("UR's Python RTDE client, exchange",
        "example_control_loop.py, both set-points (its program as URScript)", "works",
        f"{STOCK}_example_control_loop"),
    Row("UR's C++ client library, exchange", "rtde_client: fields of its stock recipe", "works",
        f"{STOCK}_stock_recipes_are_recorded_without_a_gap[e-series-500-names3]"),
    Row("UR's C++ client library, exchange", "rtde_client: its 13 stock inputs", "works",
        f"{STOCK}_inputs_of_the_stock_recipe_are_taken_and_read_back"),
    Row("UR's C++ client library, exchange",
        "dashboard_example (`wait_program.urp` is the one file)", "works",
        f"{STOCK}_dashboard_example"),
    Row("UR's C++ client library, exchange", "primary_pipeline: version and state", "works",
        f"{STOCK}_version_comes_first_then_the_state_ten_times_a_second[30001]"),
    Row("UR's C++ client library, exchange", "primary_pipeline_calibration: kinematics", "works",
        f"{STOCK}_kinematics_of_the_primary_interface_are_those_of_the_arm"),
    Row("urx 0.11.0", "monitor and programs on port 30002: getj, getl, movej, movel, stopl",
        "works", f"{PIP}[urx_moves]"),
    Row("urx 0.11.0", "real-time monitor on port 30003", "works",
        f"{PIP}[urx_real_time]"),
    Row("urx 0.11.0", "moves that it waits for",
        "the arm moves, the client says \"Robot stopped\": it reads no state newer than 3.4",
        f"{PIP}[urx_waits]"),
    Row("urx 0.11.0", "speedl",
        "refused: its keyword `t_min` is not one of speedl in the manual, the log says so",
        f"{PIP}[urx_speeds]"),
    Row("urinterface 0.0.5, with UR's Python RTDE client", "movej, recording, load, play, stop",
        "works", f"{PIP}[urinterface]"),
    Row("urinterface 0.0.5, with UR's Python RTDE client",
        "that client's `record.py` itself with its stock recipe", "works", f"{PIP}[record]"),
    Row("any, exchange", "port 30003: 1116 bytes every cycle, at 125 and at 500 Hz", "works",
        f"{STOCK}_real_time_port_tells_every_cycle_what_rtde_tells[cb3-0.008]"),
    *(Row("any, URScript", f"`{name}`", "refused: the program ends, the log says why",
          f"{SENDER}[{name}]")
      for name in ("force_mode", "servoc", "teach_mode", "freedrive_mode", "popup", "socket_open")),
    *(Row("any, URScript", f"`{call.partition('(')[0]}`",
          "refused: the program ends, the log says why", f"{BAD}[{call}]")
      for call in ("movep(p[0.5, 0.1, 0.3, 0, 0, 0])", "read_port_bit(0)")),
    Row("pymodbus 3", "gripper: activation, on Modbus TCP", "works",
        f"{EMULATE}_gripper_answers_on_tcp_and_on_a_serial_line"),
    Row("pymodbus 3", "gripper on Modbus RTU (`--rtu`)", "works",
        f"{EMULATE}_gripper_answers_on_tcp_and_on_a_serial_line"),
    *(Row(client, f"gripper on Modbus {line}: activation, status, moves, read back", "works",
          f"{MODBUS}[{name}]")
      for client, line, name in (
          ("pyModbusTCP 0.3.1", "TCP", "pymodbustcp"),
          ("uModbus 1.0.4", "TCP", "umodbus"),
          ("modbus-tk 1.1.5", "TCP", "modbus_tk"),
          ("minimalmodbus 2.1.1", "RTU (`--rtu`)", "minimalmodbus"),
      )),
    Row("pyusb 1.3", "board: descriptors, strings", "works",
        f"{BUS}_descriptors_are_those_of_the_firmware"),
    Row("pyusb 1.3", "board: versions, scan, sampling", "works",
        f"{BUS}_a_started_board_streams_frames_of_72_bytes"),
    Row("pyusb 1.3", "board: request 0xBA (is an address on the sensor bus)", "works",
        f"{BUS}_an_address_on_the_sensor_bus_is_asked_for"),
    Row("pyusb 1.3", "board: request 0xBB (boot loader)", "refused: STALL",
        f"{BUS}_unknown_requests_stall[request_1]"),
)  # fmt: skip


def played(tests: list[str]) -> tuple[set[str], set[str]]:
    """Those of the tests that pass, run one after the other, and those that are skipped. One that
    fails is run once more, for a machine that stands still fails any of them."""
    with tempfile.TemporaryDirectory() as folder:
        clients = Path(folder) / "clients"
        install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target"]
        subprocess.run([*install, str(clients), *CLIENTS], check=False)
        path = os.pathsep.join(filter(None, (str(clients), os.environ.get("PYTHONPATH"))))
        good, skipped = _run(tests, path)
        if failed := [test for test in tests if test not in good | skipped]:
            good |= _run(failed, path)[0]
    return good, skipped


def _run(tests: list[str], path: str) -> tuple[set[str], set[str]]:
    """``path``: for `PYTHONPATH`."""
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "found.xml"
        subprocess.run(
            [sys.executable, "-m", "pytest", "-q", f"--junitxml={found}", *tests],
            cwd=HOME, check=False, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        cases = list(ET.parse(found).getroot().iter("testcase"))
    good = {_name(case) for case in cases if not any(child.tag != "properties" for child in case)}
    return good, {_name(case) for case in cases if case.find("skipped") is not None}


def _name(case: ET.Element) -> str:
    return f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}"


def table(rows: tuple[Row, ...], good: set[str], kept: str = "") -> str:
    """``kept``: lines of the table so far that stay, since their tests were skipped."""
    lines = [HEAD, "|---|---|---|"]
    for row in rows:
        line = f"| {row.client} | {row.function} | {row.status} |"
        well = row.test in good or line in kept.splitlines()
        lines.append(line if well else f"| {row.client} | {row.function} | **fails** |")
    return "\n".join(lines)


def main() -> int:
    good, skipped = played(sorted({row.test for row in ROWS}))
    before, _, rest = PAGE.read_text().partition(HEAD)
    told, _, after = rest.partition(END)
    known = "\n".join(
        line for row in ROWS if row.test in skipped for line in told.splitlines()
        if line.startswith(f"| {row.client} | {row.function} |")
    )  # fmt: skip
    PAGE.write_text(f"{before}{table(ROWS, good, known)}\n{END}{after}")
    for row in ROWS:
        if row.test not in good:
            how = "not run, kept as it was" if row.test in skipped else "FAILS"
            print(f"{how}: {row.client}, {row.function} ({row.test})")
    return 0 if all(row.test in good for row in ROWS) else 1


if __name__ == "__main__":
    sys.exit(main())
