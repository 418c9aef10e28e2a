"""docs/emulators.md: which client can do what with the emulated devices, by the tests that show it.

    python scripts/emulators.py          run those tests, and write the table of the page anew

A row whose test fails is written as failing, and the script ends with 1.
"""

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

HOME = Path(__file__).resolve().parent.parent
PAGE = HOME / "docs" / "emulators.md"
BEGIN, END = "<!-- clients -->\n<!-- reference -->", "<!-- end of clients -->"
UR = "tests/wire/drivers/ur/emulator"
RTDE, STOCK = f"{UR}/test_ur_rtde.py::test", f"{UR}/test_stock_clients.py::test"
BUS = "tests/wire/drivers/takktile/test_bus.py::test"
EMULATE = "tests/wire/scenarios/cell/test_emulate.py::test"

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
    _ur_rtde("dashboard", "dashboard: power, load, play, pause, stop, log"),
    _ur_rtde("stop_after_speed", "stopL after speedL", "ends the program, as on a robot"),
    _ur_rtde("in_use", "a second controlling client", "refused: registers in use"),
    _ur_rtde("not_emulated", "servoC, forceMode", REFUSED),
    _ur_rtde("move_l", "moveL, moveJ at 500 Hz", "works", "e_series_at_500_hz"),
    _ur_rtde("speed_l", "speedL at 500 Hz", "works", "e_series_at_500_hz"),
    _ur_rtde("not_remote", "without remote control", "refused", "e_series_at_500_hz"),
    _ur_rtde("contact_refused", "moveUntilContact, freedriveMode", REFUSED, "e_series_at_500_hz"),
    Row("UR's Python RTDE client, exchange", "record.py with its stock recipe", "works",
        f"{STOCK}_stock_recipes_are_recorded_without_a_gap[cb3-125-names0]"),
    Row("UR's Python RTDE client, exchange", "record.py, all that its recipe comments out", "works",
        f"{STOCK}_stock_recipes_are_recorded_without_a_gap[cb3-125-names2]"),
    Row("UR's Python RTDE client, exchange", "example_control_loop.py", "works",
        f"{STOCK}_control_loop_of_rtde_registers"),
    Row("UR's C++ client library, exchange", "rtde_client: fields of its stock recipe", "works",
        f"{STOCK}_stock_recipes_are_recorded_without_a_gap[e-series-500-names3]"),
    Row("UR's C++ client library, exchange",
        "dashboard_example (`wait_program.urp` is the one file)", "works",
        f"{STOCK}_dashboard_example"),
    Row("UR's C++ client library, exchange", "primary_pipeline: version and state", "works",
        f"{STOCK}_version_comes_first_then_the_state_ten_times_a_second[30001]"),
    Row("UR's C++ client library, exchange", "primary_pipeline_calibration: kinematics", "works",
        f"{STOCK}_kinematics_of_the_primary_interface_are_those_of_the_arm"),
    Row("python-urx, exchange", "monitor and programs on port 30002", "works",
        f"{STOCK}_state_has_the_sizes_and_values_that_python_urx_reads"),
    Row("pymodbus 3", "gripper: activation, on Modbus TCP", "works",
        f"{EMULATE}_gripper_answers_on_tcp_and_on_a_serial_line"),
    Row("pymodbus 3", "gripper on Modbus RTU (`--rtu`)", "works",
        f"{EMULATE}_gripper_answers_on_tcp_and_on_a_serial_line"),
    Row("pyusb 1.3", "board: descriptors, strings", "works",
        f"{BUS}_descriptors_are_those_of_the_firmware"),
    Row("pyusb 1.3", "board: versions, scan, sampling", "works",
        f"{BUS}_a_started_board_streams_frames_of_72_bytes"),
    Row("pyusb 1.3", "board: request 0xBB (boot loader)", "refused: STALL",
        f"{BUS}_unknown_requests_stall[request_1]"),
)  # fmt: skip


def passed(tests: list[str]) -> set[str]:
    """Those of the tests that pass, run one after the other."""
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "found.xml"
        subprocess.run(
            [sys.executable, "-m", "pytest", "-q", f"--junitxml={found}", *tests],
            cwd=HOME, check=False,
        )  # fmt: skip
        cases = ET.parse(found).getroot().iter("testcase")
        good = [case for case in cases if not any(child.tag != "properties" for child in case)]
    return {
        f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}" for case in good
    }


def table(rows: tuple[Row, ...], good: set[str]) -> str:
    lines = ["| client | does | status |", "|---|---|---|"]
    for row in rows:
        status = row.status if row.test in good else "**fails**"
        lines.append(f"| {row.client} | {row.function} | {status} |")
    return "\n".join(lines)


def main() -> int:
    good = passed(sorted({row.test for row in ROWS}))
    before, _, rest = PAGE.read_text().partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n{table(ROWS, good)}\n{END}{after}")
    lost = [row.test for row in ROWS if row.test not in good]
    print(*lost, sep="\n")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
