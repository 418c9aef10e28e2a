"""One lift on real wires: the emulated rig, and the hardware rig pointed at an emulated cell."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from grasp.clock import WallClock
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.rigs.cell_process import cell_process
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import activate
from scenarios.rigs.wired import wired_gripper
from tests.calibrations import OF_A_LAB
from tests.unit.scenarios.conftest import by_default

ROOT = Path(__file__).parents[3]
GRASP = [sys.executable, "-c", "import sys; from grasp.cli.main import main; sys.exit(main())"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
QUICK = (
    "hand.activation_s=0.5", "controller.hold_s=0.3", "controller.lift_height_m=0.08",
    "controller.lower_speed_mps=0.2", "controller.relax_s=0.2", "controller.listen_s=0.2",
)  # fmt: skip
TRUTH_FIELDS = ("slip_onset_s", "slip_distance_m", "peak_force_n", "settled_force_n")


def sets() -> list[str]:
    return [word for assignment in QUICK for word in ("--set", assignment)]


def call(*words: str, environment: dict[str, str] | None = None) -> tuple[int, dict[str, Any]]:
    done = subprocess.run(
        [*GRASP, *words, "--json"],
        env={**ENVIRONMENT, **(environment or {})},
        stdin=subprocess.DEVNULL,  # nobody is there to answer
        capture_output=True,
        text=True,
        check=False,
        timeout=200,  # several set a cell up, and one compiles its world
    )
    assert done.stdout.count("\n") == 1, done.stderr
    return done.returncode, json.loads(done.stdout)


@contextmanager
def emulate(*words: str) -> Iterator[dict[str, Any]]:
    with subprocess.Popen(
        [*GRASP, "emulate", *sets(), *words], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30)
    assert process.returncode == 0


def lab_file(path: Path, endpoints: dict[str, Any]) -> Path:
    gripper, arm = endpoints["gripper"], endpoints["arm"]
    hand = path.with_name("paper.toml")
    hand.write_text(OF_A_LAB)
    path.write_text(
        f'[gripper]\ncalibration = "{hand}"\n'
        f'[modbus]\nhost = "{gripper["host"]}"\nport = {gripper["port"]}\ntimeout_s = 0.4\n'
        f'[usb]\nurl = "{endpoints["tactile"]["url"]}"\n'
        f'[ur]\nhost = "{arm["host"]}"\nwatchdog_hz = 4.0\nheartbeat_timeout_s = 0.5\n'
        "[arm]\nstale_after_s = 0.5\n[controller]\nstale_after_s = 0.5\n"
        "[tactile]\nstale_after_missed = 20\nmax_age_ms = 200\n"
        "[doubt]\nstandstill_s = 0.4\ndetector_s = 0.3\necho_s = 0.5\nfinger_start_s = 0.6\n"
        "stands_s = 0.4\narm_start_s = 0.6\narm_frozen_s = 0.3\n"
    )
    return path


def woken(lab: Path) -> Path:
    """Its hand activated, as by `grasp gripper activate`: a run does that to no real one."""
    config, clock = load_config("can", "hardware", "energy", lab), WallClock()
    with wired_gripper(config, lambda: clock.now_ns) as gripper:
        activate(gripper, clock)
    return lab


def test_lift_on_the_emulated_rig_is_that_of_the_simulated_one(tmp_path: Path) -> None:
    code, wired = call("run", "lift", "--rig", "emulated", "--runs", str(tmp_path), *sets())
    simulated = lift.run(by_default(*QUICK), 0, None).result
    assert simulated is not None
    assert code == 0, wired
    assert wired["outcome"] == simulated.outcome
    # noise decides how often the arm stops on its way up, and on its way to the table
    landing = {"land", "touch", "probe"}
    expected = [p for p in dict.fromkeys(p.phase for p in simulated.phases) if p not in landing]
    found = dict.fromkeys(p["phase"] for p in wired["phases"])
    assert [p for p in found if p not in landing] == expected
    assert simulated.slip_distance_m is not None
    assert simulated.reaction_latency_ms is not None
    # 0.1 mm for each millisecond that the wall-clock loop reacted later or earlier, and 2 mm
    later_ms = abs(wired["reaction_latency_ms"] - simulated.reaction_latency_ms)
    assert abs(wired["slip_distance_m"] - simulated.slip_distance_m) < 0.002 + 1e-4 * later_ms
    assert wired["commanded_force_n"] <= 10.0
    assert Path(wired["recording"]).is_file()
    replayed = subprocess.run(
        [*GRASP, "replay", wired["recording"], "--check"], env=ENVIRONMENT, check=False,
        capture_output=True, text=True,
    )  # fmt: skip
    assert replayed.returncode == 0, replayed.stdout


def test_hardware_rig_pointed_at_a_cell_gives_the_verdict_without_the_truth(tmp_path: Path) -> None:
    with emulate() as endpoints:
        lab = woken(lab_file(tmp_path / "lab.toml", endpoints))
        code, result = call(
            "run", "lift", "--rig", "hardware", "--confirm-motion", "--config", str(lab),
            "--runs", str(tmp_path / "runs"), *sets(),
        )  # fmt: skip
    assert code == 0, result
    assert result["success"] is True
    assert result["outcome"] == "held"
    assert all(result[name] is None for name in TRUTH_FIELDS)
    assert 5.0 < result["peak_measured_n"]["A"] < 13.0  # nobody knows better there
    assert [p["phase"] for p in result["phases"]][6:10] == [
        "lift", "compensate", "lift", "hold",
    ]  # fmt: skip


def test_hardware_needs_a_confirmation_on_every_run() -> None:
    code, answer = call("run", "lift", "--rig", "hardware", "--set", "gripper.calibration=paper")
    assert code == 2
    assert "--confirm-motion" in answer["error"]["remedy"]


def test_hardware_has_no_calibration_of_its_own() -> None:
    code, answer = call("run", "lift", "--rig", "hardware", "--confirm-motion")
    assert code == 2
    assert "chosen by hand" in answer["error"]["message"]


def test_devices_that_are_not_there_are_a_device_error_with_a_remedy(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(
        '[gripper]\ncalibration = "paper"\n[calibration]\npressed_bytes = [0]\npresses = 10\n'
        '[modbus]\nhost = "127.0.0.99"\nport = 9\n'
        '[usb]\nurl = "tcp://127.0.0.99:9"\n[ur]\nhost = "127.0.0.99"\n'
    )
    runs = tmp_path / "runs"
    code, answer = call(
        "run", "lift", "--rig", "hardware", "--confirm-motion", "--config", str(lab), "--runs",
        str(runs),
    )  # fmt: skip
    assert code == 3
    assert answer["error"]["kind"] == "link_lost"
    assert answer["error"]["remedy"]
    assert list(runs.iterdir()) == []  # it could be written, and nothing was


def test_cell_on_an_address_that_is_taken_is_refused() -> None:
    with emulate() as endpoints:
        done = subprocess.run(
            [*GRASP, "emulate", "--host", endpoints["host"]], env=ENVIRONMENT, check=False,
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
    assert done.returncode == 3
    assert "another --host" in done.stderr


def test_address_where_a_check_would_be_skipped_is_refused() -> None:
    done = subprocess.run(
        [*GRASP, "emulate", "--host", "127.0.0.1"], env=ENVIRONMENT, check=False,
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_cell_ends_with_its_parent_even_when_that_is_killed() -> None:
    script = (
        "from scenarios.campaign.config import load_config\n"
        "from scenarios.rigs.cell_process import CellProcess\n"
        "import time\n"
        "cell = CellProcess(load_config('can', 'emulated', 'energy'), 0)\n"
        "print(cell.endpoints['pid'], flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert alive(pid)
        parent.kill()
    deadline = time.monotonic() + 30
    while alive(pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(pid)


def test_doctor_finds_the_emulated_devices_well() -> None:
    code, answer = call("doctor", "--rig", "emulated")
    assert code == 0, answer
    checks = {c["name"]: c for c in answer["checks"]}
    assert {"python", "configuration", "detector energy", "gripper", "arm rtde port", "fingertips",
            "loop jitter", "real-time scheduling", "disk"} <= set(checks)  # fmt: skip


def test_doctor_names_everything_that_is_missing_at_once(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(
        '[gripper]\ncalibration = "paper"\n[modbus]\nhost = "127.0.0.99"\nport = 9\n'
        '[ur]\nhost = "127.0.0.99"\n[usb]\nurl = "tcp://127.0.0.99:9"\n'
    )
    code, answer = call("doctor", "--rig", "hardware", "--config", str(lab))
    assert code == 3
    failed = [c for c in answer["checks"] if c["status"] == "fail"]
    assert {"gripper", "arm rtde port", "fingertips"} <= {c["name"] for c in failed}
    assert all(c["remedy"] for c in failed)


@pytest.mark.parametrize("name", ["emulated", "hardware", "simulated"])
def test_every_rig_is_a_file_of_the_configuration(name: str) -> None:
    assert (ROOT / "config" / "rigs" / f"{name}.toml").is_file()


def test_all_devices_of_a_wired_rig_tell_the_time_of_its_clock() -> None:
    with open_rig(load_config("can", "emulated", "energy", None, QUICK), 0, paced=False) as rig:
        rig.devices.tactile.begin_rest()
        deadline_ns = rig.clock.now_ns + 20_000_000_000
        while rig.devices.tactile.frame is None and rig.clock.now_ns < deadline_ns:
            rig.clock.sleep_until_ns(rig.clock.now_ns + 10_000_000)
            rig.devices.tactile.pump(rig.clock.now_ns)
        rig.devices.gripper.pump(rig.clock.now_ns)
        rig.devices.arm.pump(rig.clock.now_ns)
        now_ns = rig.clock.now_ns
        gripper, arm = rig.devices.gripper.state, rig.devices.arm.state
        frame = rig.devices.tactile.frame
        assert gripper is not None and arm is not None and frame is not None
        truth = rig.truth()
        assert truth is not None
        for t_ns in (gripper.t_ns, arm.t_ns, frame.sampled_ns):
            assert -1_000_000 <= now_ns - t_ns < 5_000_000_000
        assert rig.acknowledgements is not None
        before = len(rig.acknowledgements())
        rig.devices.gripper.move_to((20, 20, 20), 0.05, 10.0)
        while len(rig.acknowledgements()) == before and rig.clock.now_ns < deadline_ns:
            rig.clock.sleep_until_ns(rig.clock.now_ns + 5_000_000)
        verb_ns, reply_ns = rig.acknowledgements()[-1]
        assert 0 < reply_ns - verb_ns < 5_000_000_000


def test_control_channel_loads_another_scene_and_taps_its_object() -> None:
    first = load_config("can", "emulated", "energy", None, QUICK)
    ball = load_config("ball", "emulated", "energy", None, QUICK)
    with cell_process(first, 0) as cell:
        assert not cell.truth().touched
        cell.load(ball, 3)
        assert cell.control.ask("truth")["placed"] is False
        cell.control.ask("tap", impulse_n_s=0.1, duration_s=0.008)
        verbs = "load, place, take, tap, press, lay, home, truth, motion, fault"
        with pytest.raises(ValueError, match=verbs):
            cell.control.ask("dance")
        with pytest.raises(ValueError, match="impulse_n_s"):
            cell.control.ask("tap")
        assert cell.truth().height_m == 0.0


def test_cell_has_compiled_its_world_before_it_answers(tmp_path: Path) -> None:
    code, result = call(
        "run", "lift", "--rig", "emulated", "--runs", str(tmp_path / "runs"), *sets(),
        environment={"NUMBA_CACHE_DIR": str(tmp_path / "empty")},
    )  # fmt: skip
    assert code == 0, result
