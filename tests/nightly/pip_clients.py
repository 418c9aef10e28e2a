"""Clients that pip installs and this project does not need, as programs of their own.

pip install --no-deps urx==0.11.0 'math3d<4' urinterface==0.0.5
python pip_clients.py SCENARIO HOST FAULT_PORT        exit code 77: the client is not installed
"""

import collections
import collections.abc
import contextlib
import itertools
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

NOT_INSTALLED = 77
PATIENCE_S = 100.0
WITHOUT_A_GAP = 20  # cycles in a row: 50 are more than a busy machine may give
PLACE_M = (0.5, 0.1, 0.3)
FIELDS = {
    "timestamp": "DOUBLE", "actual_q": "VECTOR6D", "actual_qd": "VECTOR6D",
    "actual_TCP_pose": "VECTOR6D", "robot_mode": "INT32", "safety_mode": "INT32",
    "safety_status": "INT32", "runtime_state": "UINT32",
}  # fmt: skip
# record_configuration.xml as it is shipped
STOCK = {
    "timestamp": "DOUBLE", "target_q": "VECTOR6D", "target_qd": "VECTOR6D",
    **dict.fromkeys(
        ("target_qdd", "target_current", "target_moment", "actual_q", "actual_qd", "actual_current",
         "joint_control_output", "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force",
         "target_TCP_pose", "target_TCP_speed"), "VECTOR6D",
    ),
    "actual_digital_input_bits": "UINT64", "joint_temperatures": "VECTOR6D",
    "actual_execution_time": "DOUBLE", "robot_mode": "INT32", "joint_mode": "VECTOR6INT32",
    "safety_mode": "INT32", "actual_tool_accelerometer": "VECTOR3D",
    **dict.fromkeys(
        ("speed_scaling", "target_speed_fraction", "actual_momentum", "actual_main_voltage",
         "actual_robot_voltage", "actual_robot_current"), "DOUBLE",
    ),
    "actual_joint_voltage": "VECTOR6D", "actual_digital_output_bits": "UINT64",
    "runtime_state": "UINT32",
}  # fmt: skip


def until(holds):
    deadline = time.monotonic() + PATIENCE_S
    while not (found := holds()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def in_a_row(rows):
    """The most steps of one cycle, one after the other; every step is of whole cycles."""
    times = [row["timestamp"] for row in rows]
    steps = [round((b - a) / 0.008, 3) for a, b in itertools.pairwise(times)]
    assert all(step == round(step) >= 1 for step in steps)
    return max(
        (len(list(same)) for step, same in itertools.groupby(steps) if step == 1.0), default=0
    )


def near(found, wanted, within=1e-4):
    return all(abs(a - b) < within for a, b in zip(found, wanted, strict=False))


def connected(host, **options):
    """A robot of urx, which gives up after 0.5 s without news: asked again."""
    collections.Iterable = collections.abc.Iterable  # math3d 3 is for Python 3.9 at most
    import urx

    def robot():
        with contextlib.suppress(urx.ursecmon.TimeoutException):
            return urx.Robot(host, **options)

    return until(robot)


def urx_moves(host, _):
    robot = connected(host)
    base, *others = robot.getj()
    assert near(robot.getl(), PLACE_M)
    robot.movej([base + 0.05, *others], acc=0.5, vel=0.3, wait=False)
    until(lambda: near(robot.getj(), [base + 0.05, *others]))
    x, y, z, *turn = robot.getl()
    robot.movel([x, y, z + 0.02, *turn], acc=0.3, vel=0.1, wait=False)
    until(lambda: near(robot.getl(), (x, y, z + 0.02)))
    robot.movel([x, y, z - 0.1, *turn], acc=0.3, vel=0.02, wait=False)
    until(lambda: robot.getl()[2] < z + 0.015)
    robot.stopl()
    time.sleep(1.0)
    stood = robot.getl()
    assert stood[2] > z - 0.02
    time.sleep(0.3)
    assert near(robot.getl(), stood)


def urx_speeds(host, fault_port):
    """It names the time `t_min`, as URScript did once."""
    connected(host).speedl([0.0, 0.0, 0.02, 0.0, 0.0, 0.0], 0.3, 5.0)

    def told():
        with socket.create_connection((host, fault_port)) as sock:
            sock.sendall(b'{"do": "state"}\n')
            return "t_min" in sock.recv(1 << 16).decode()

    until(told)


def urx_waits(host, _):
    """It knows mode packages of 38 and 46 bytes; those of a robot have had 47 since 3.5."""
    robot = connected(host)
    base, *others = robot.getj()
    try:
        robot.movej([base + 0.05, *others], acc=0.5, vel=0.3)
    except Exception as error:
        assert str(error) == "Robot stopped", error
    else:
        raise AssertionError("it has waited")
    until(lambda: near(robot.getj(), [base + 0.05, *others]))


def urx_real_time(host, fault_port):
    robot = connected(host, use_rt=True)
    base, *others = robot.rtmon.q_actual(wait=True)
    assert near(robot.rtmon.tcf_pose(wait=True), PLACE_M)
    robot.movej([base + 0.05, *others], acc=0.5, vel=0.3, wait=False)
    until(lambda: near(robot.rtmon.q_actual(wait=True), [base + 0.05, *others]))
    with socket.create_connection((host, fault_port)) as sock:
        sock.sendall(json.dumps({"do": "wrench", "value": [1, 2, 3, 0, 0, 0]}).encode() + b"\n")
        until(lambda: near(robot.rtmon.tcf_force(wait=True), (1, 2, 3)))


def record(host, _):
    """UR's own program, as urinterface carries it, with its stock recipe."""
    import third_party.rtde  # noqa: F401  (or it is not there)

    fields = "".join(f'<field name="{name}" type="{kind}"/>' for name, kind in STOCK.items())
    recipe, out = (Path(tempfile.mkdtemp()) / name for name in ("record.xml", "out.csv"))
    recipe.write_text(f'<rtde_config><recipe key="out">{fields}</recipe></rtde_config>')
    program = [sys.executable, "-m", "third_party.rtde.record", "--host", host, "--frequency",
               "125", "--samples", "50", "--config", str(recipe), "--output", str(out)]  # fmt: skip

    def without_a_gap():
        """On a busy machine the client passes over what it has not read in time."""
        done = subprocess.run(program, capture_output=True, text=True, check=False)
        assert done.returncode == 0 and "Complete!" in done.stdout, (done.stdout, done.stderr)
        head, *rows = (line.split(" ") for line in out.read_text().splitlines())
        assert len(rows) >= 49  # it counts from one
        wide = {"VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR3D": 3}
        assert len(head) == sum(wide.get(kind, 1) for kind in STOCK.values())
        found = [dict(zip(head, map(float, row), strict=True)) for row in rows]
        return found if in_a_row(found) >= WITHOUT_A_GAP else None

    last = until(without_a_gap)[-1]
    assert near([last[f"actual_TCP_pose_{i}"] for i in range(3)], PLACE_M)
    assert (last["robot_mode"], last["safety_mode"]) == (7, 1)


def urinterface(host, _):
    """It brings UR's Python RTDE client along, and records as its `record.py` does."""
    from urinterface.robot_connection import RobotConnection

    fields = "".join(f'<field name="{name}" type="{kind}"/>' for name, kind in FIELDS.items())
    recipe, out = (Path(tempfile.mkdtemp()) / name for name in ("record.xml", "out.csv"))
    recipe.write_text(f'<rtde_config><recipe key="out">{fields}</recipe></rtde_config>')
    robot = RobotConnection(host, socket.socket(), socket.socket())

    def recorded(samples):
        robot.record_samples(str(recipe), str(out), overwrite=True, frequency=125, samples=samples)
        head, *rows = (line.split(" ") for line in out.read_text().splitlines())
        return [dict(zip(head, map(float, row), strict=True)) for row in rows]

    def without_a_gap():
        """On a busy machine the client passes over what it has not read in time."""
        rows = recorded(50)
        return rows if in_a_row(rows) >= WITHOUT_A_GAP else None

    rows = until(without_a_gap)
    names = [f"actual_q_{i}" for i in range(6)]
    base, *others = (rows[-1][name] for name in names)
    import numpy as np

    robot.movej(q=np.array([base + 0.05, *others]), v=0.3, a=0.5)
    until(lambda: near([recorded(1)[0][name] for name in names], [base + 0.05, *others]))
    assert robot.load_program("wait_program.urp")
    assert robot.play_program()
    assert robot.stop_program()


def play(scenario):
    """Ends the program, with what came of it: the clients' threads would keep it going."""
    try:
        scenario()
    except ImportError as error:
        print(error)
        code = NOT_INSTALLED
    except BaseException as error:
        print(repr(error))
        code = 1
    else:
        code = 0
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    play(lambda: globals()[sys.argv[1]](sys.argv[2], int(sys.argv[3])))
