"""Every setting of the arm link has its effect."""

import os
from typing import Any

import msgspec
import pytest

from drivers.errors import DeviceFault
from drivers.ur.link import client
from drivers.ur.link.client import UrLink
from drivers.ur.link.messages import ROBOT_RUNNING, Outcome, Setup, State
from drivers.ur.settings import UrSettings

SETTINGS = UrSettings(
    host="10.0.0.9", tcp_offset=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), cog_m=(0.01, 0.02, 0.03),
    upper_registers=True, watchdog_hz=11.0, heartbeat_timeout_s=0.31, step_timeout_s=1.7,
)  # fmt: skip
SPEED_MPS, BRAKING_MPS2 = 0.2, 0.5
MOVING = State(
    timestamp_s=0.0, pose=(0.0,) * 6, velocity_mps=(0.0, 0.0, SPEED_MPS),
    angular_velocity_radps=(0.0,) * 3, moving=True, robot_mode=ROBOT_RUNNING,
    safety_bits=0, program_running=True,
)  # fmt: skip


class RecordingWorker:
    """A worker that records its settings; it accepts every command, and its arm never stops."""

    state = MOVING

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.seconds: dict[str, float] = {}

    def wait_ready(self, timeout_s: float) -> None:
        self.seconds["start_timeout_s"] = timeout_s

    def post(self, command: Any, timeout_s: float) -> None:
        self.seconds[f"command_timeout_s of {type(command).__name__}"] = timeout_s

    def call(self, command: Any, timeout_s: float) -> Outcome:
        self.post(command, timeout_s)
        return Outcome.DONE

    def close(self, timeout_s: float) -> None:
        self.seconds["close_timeout_s"] = timeout_s

    def next_number(self) -> int:
        return 1

    def is_pending(self, number: int) -> bool:
        return False

    def send_heartbeat(self) -> None: ...

    def check(self) -> None: ...

    def kill(self) -> None: ...

    def next_failure(self) -> None: ...


@pytest.fixture
def workers(monkeypatch: pytest.MonkeyPatch) -> list[RecordingWorker]:
    """The workers that were started."""
    started: list[RecordingWorker] = []

    def start(setup: Setup) -> RecordingWorker:
        started.append(RecordingWorker(setup))
        return started[-1]

    def preflight(host: str, step_timeout_s: float, upper_registers: bool = True) -> None:
        assert host == SETTINGS.host and step_timeout_s > 0.0 and upper_registers

    monkeypatch.setattr(client, "require_ur_rtde", lambda: None)
    monkeypatch.setattr(client, "preflight", preflight)
    monkeypatch.setattr(client, "raise_failures", lambda *_: None)
    monkeypatch.setattr(client, "require_stationary", preflight)
    monkeypatch.setattr(client, "WorkerProcess", start)
    return started


def test_the_worker_gets_the_settings_of_the_link(workers: list[RecordingWorker]) -> None:
    UrLink(SETTINGS).connect()
    values = msgspec.structs.asdict(workers[0].setup)
    assert values.pop("payload_kg") is None
    assert values.pop("client_pid") == os.getpid()
    assert values == {name: getattr(SETTINGS, name) for name in values}


def test_a_stop_may_take_the_braking_time_and_a_margin(workers: list[RecordingWorker]) -> None:
    for step_timeout_s in [1.2, 6.0]:
        link = UrLink(msgspec.structs.replace(SETTINGS, step_timeout_s=step_timeout_s))
        link.connect()
        link.stop_l(BRAKING_MPS2, 0)
        due_s = SPEED_MPS / BRAKING_MPS2 + 0.25 * step_timeout_s
        link.read(round((due_s - 1e-3) * 1e9))
        with pytest.raises(DeviceFault, match="did not stop"):
            link.read(round((due_s + 1e-3) * 1e9))
