"""Locks of devices: one process drives a device at a time; locks of dead processes are void."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.errors import Refused
from scenarios.campaign.config import load_config
from scenarios.rigs.permission import devices_of, driving, gripper_of, lock_path

ROOT = Path(__file__).parents[4]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
HOLD = (
    "import sys, time\n"
    "from scenarios.rigs.permission import driving\n"
    "with driving(*sys.argv[1:]):\n"
    "    print('driving', flush=True)\n"
    "    time.sleep(60)\n"
)
# each locks the device a hundred times; with the lock it creates a file that must not exist yet
CONTEND = (
    "import os, sys, time\n"
    "from drivers.errors import Refused\n"
    "from scenarios.rigs.permission import driving\n"
    "taken = 0\n"
    "while taken < 100:\n"
    "    try:\n"
    "        with driving(sys.argv[1]):\n"
    "            os.close(os.open(sys.argv[2], os.O_CREAT | os.O_EXCL))\n"
    "            os.unlink(sys.argv[2])\n"
    "            taken += 1\n"
    "    except Refused:\n"
    "        time.sleep(0.0005)\n"
)


@pytest.fixture
def device(tmp_path: Path) -> str:
    """Name of a device that no other test drives."""
    return f"gripper at {tmp_path.name}-{os.getpid()}:502"


@contextmanager
def another(*devices: str) -> Iterator["subprocess.Popen[str]"]:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, *devices], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "driving\n"
            yield process
        finally:
            process.kill()


def test_refusal_names_the_process_that_drives_and_how_to_end_it(device: str) -> None:
    with another(device) as process, pytest.raises(Refused) as refused, driving(device):
        pass
    assert device in refused.value.message
    assert f"process {process.pid} since " in refused.value.message
    assert device in refused.value.message.partition(": ")[2]  # its command line
    assert f"`kill {process.pid}`" in refused.value.remedy


def test_lock_of_a_killed_process_is_void(device: str) -> None:
    with another(device) as process:
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert lock_path(device).exists()
        with driving(device):
            assert json.loads(lock_path(device).read_text())["pid"] == os.getpid()


def test_competing_processes_never_drive_at_the_same_time(device: str, tmp_path: Path) -> None:
    words = [sys.executable, "-c", CONTEND, device, str(tmp_path / "inside")]
    many = [subprocess.Popen(words, env=ENVIRONMENT) for _ in range(4)]
    assert [process.wait(60) for process in many] == [0, 0, 0, 0]


def test_lock_of_a_device_does_not_depend_on_the_form_of_its_address() -> None:
    def config(*words: str) -> list[str]:
        return devices_of(load_config("can", "hardware", "energy", None, words))

    by_name = config("modbus.host=localhost", "ur.host=localhost")
    by_number = config("modbus.host=127.0.0.1", "ur.host=127.0.0.1")
    assert by_name == by_number == ["gripper at 127.0.0.1:502", "arm at 127.0.0.1"]
    line = load_config("can", "hardware", "energy", None, ("gripper.link=rtu",
                       "modbus.serial_port=/dev/../dev/null"))  # fmt: skip
    assert gripper_of(line) == "gripper at /dev/null"
