"""`grasp doctor` reports everything for which a run would be refused."""

from collections.abc import Iterable
from itertools import chain, cycle, repeat
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from drivers.interfaces import TactileFrame
from drivers.robotiq.protocol import AxisStatus, StatusRegisters
from scenarios.campaign.config import load_config
from scenarios.rigs import device_checks, doctor
from scenarios.trial.execution import make_guard
from tests.unit.grasp.builders import frame

ADDRESSES = """
[modbus]
host = "127.0.0.99"
port = 9
[ur]
host = "127.0.0.99"
[usb]
url = "tcp://127.0.0.99:9"
"""


PRESSED = "[calibration]\npressed_bytes=[0]\npresses=10\n"


@pytest.fixture
def no_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_checks, "arm_checks", lambda config: [])


def test_missing_addresses_are_named_before_a_missing_calibration() -> None:
    checks = doctor._devices("hardware", lambda rig, _: load_config("can", rig), make_guard)
    failed = [check.name for check in checks if check.status == "fail"]
    assert failed == ["gripper", "arm", "fingertips", "calibration"]


@pytest.mark.usefixtures("no_arm")
@pytest.mark.parametrize(
    ("chosen", "status"),
    [
        ("", "fail"),
        ("[gripper]\ncalibration='manual'", "ok"),
        ("[gripper]\ncalibration='paper'", "fail"),  # below the manual's force, without presses
        (f"[gripper]\ncalibration='paper'\n{PRESSED}", "warn"),
    ],
)
def test_missing_or_implausible_calibration_is_reported(
    tmp_path: Path, chosen: str, status: str
) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(chosen + ADDRESSES)
    checks = doctor._devices(
        "hardware", lambda rig, name: load_config("can", rig, name, lab), make_guard
    )
    found = next(check for check in checks if check.name == "calibration")
    assert found.status == status
    assert status != "warn" or not found.remedy  # it was measured
    assert ("not set" in found.detail) == (not chosen)
    assert ("less than the manual's 15 N" in found.detail) == ("paper" in chosen)


@pytest.mark.usefixtures("no_arm")
@pytest.mark.parametrize(
    ("active", "at", "status", "remedy"),
    [(True, 6, "ok", ""), (False, 6, "fail", "gripper activate"), (True, 90, "fail", "release"),
     (False, 90, "fail", "release --activate")],
    ids=["ready", "not active", "closed", "closed and not active"],
)  # fmt: skip
def test_hand_that_a_run_would_refuse_fails_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, active: bool, at: int, status: str, remedy: str
) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text("[gripper]\ncalibration='manual'" + ADDRESSES)
    status_registers = StatusRegisters(
        active=active, initialization=3 if active else 0, a=AxisStatus(position=at)
    )
    monkeypatch.setattr(device_checks, "read_gripper", lambda config: (status_registers,) * 2)
    monkeypatch.setattr(device_checks, "implausible_values", lambda *looks: [])
    checks = doctor._devices(
        "hardware", lambda rig, name: load_config("can", rig, name, lab), make_guard
    )
    found = next(check for check in checks if check.name == "gripper")
    assert found.status == status, found
    assert remedy in found.remedy


class ScriptedFingertips:
    """Fingertips that send the next of these codes at every tick; None: no frame."""

    def __init__(self, codes: Iterable[int | None]) -> None:
        self.frame: TactileFrame | None = None
        self._codes = iter(codes)

    def begin_rest(self) -> None: ...

    def poll(self, now_ns: int) -> None:
        code = next(self._codes)
        if code is None and self.frame is not None:
            self.frame = msgspec.structs.replace(self.frame, missed=self.frame.missed + 1)
        elif code is not None:
            rest = frame()
            self.frame = msgspec.structs.replace(rest, raw=rest.raw + np.int16(code))


class FakeClock:
    """Clock that advances without waiting."""

    now_ns = 0

    def sleep_until_ns(self, until_ns: int) -> None:
        self.now_ns = until_ns


@pytest.mark.parametrize(("codes", "status", "reported"), [
    (cycle((0, 1)), "ok", "0% of the frames lost"),
    (repeat(0), "fail", "no code changes at all"),
    (cycle((0, None, 1)), "fail", "33% of the frames lost"),
    (chain((0, 1), repeat(None)), "fail", "sends too few frames"),
    (repeat(None), "fail", "sends too few frames"),
], ids=["ok", "frozen", "lossy", "silent later", "silent"])  # fmt: skip
def test_fingertips_with_frozen_or_lost_frames_fail_the_check(
    codes: Iterable[int | None], status: str, reported: str
) -> None:
    found, detail, *_ = device_checks._check_frames(
        cast(Any, ScriptedFingertips(codes)), cast(Any, FakeClock())
    )
    assert found == status
    assert reported in detail


def test_a_simulated_cell_is_opened() -> None:
    found = doctor._simulation(lambda rig, name: load_config("can", rig, name))
    assert found == ("ok", "a simulated cell opens")
