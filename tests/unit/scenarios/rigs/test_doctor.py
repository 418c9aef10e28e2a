"""`grasp doctor` finds what a run would be refused for, and says it once."""

import os
from collections.abc import Iterable
from itertools import chain, cycle, repeat
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from drivers.errors import ConfigError
from drivers.interfaces import TactileFrame
from drivers.robotiq.protocol import AxisStatus, StatusRegisters
from drivers.ur.link.look import ArmLook
from grasp.cli.main import main
from scenarios.campaign.config import load_config
from scenarios.rigs import device_checks, doctor
from scenarios.rigs.permission import devices_of, driving
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


@pytest.mark.usefixtures("no_arm")
@pytest.mark.parametrize(
    ("chosen", "status"),
    [
        ("", "fail"),
        ("[gripper]\ncalibration='manual'", "ok"),
        ("[gripper]\ncalibration='paper'", "fail"),  # less than the manual says, unpressed
        (f"[gripper]\ncalibration='paper'\n{PRESSED}", "warn"),
    ],
)
def test_hand_that_nobody_has_chosen_stands_against_a_run(
    tmp_path: Path, chosen: str, status: str
) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(chosen + ADDRESSES)
    checks = doctor._devices(
        "hardware", lambda rig, name: load_config("can", rig, name, lab), make_guard
    )
    found = next(check for check in checks if check.name == "calibration")
    assert found.status == status
    assert ("chosen by hand" in found.detail) == (not chosen)
    assert ("less than the manual's 15 N" in found.detail) == ("paper" in chosen)


@pytest.mark.usefixtures("no_arm")
def test_source_of_each_calibration_is_told_or_that_there_is_none(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("lab.toml", "hand.toml", "force.toml", "rule.toml")]
    lab, hand, force, rule = files
    strong = "[guard]\nforce_limit_n = 20\n[controller]\ngrip_force_n = 20\n"
    lab.write_text(f'[gripper]\ncalibration = "{hand}"\n{strong}{ADDRESSES}')
    hand.write_text('[calibration]\nsource = "a load cell; new pads"\nleast_force_n = 16.0\n')
    force.write_text('[source]\ncounts_per_newton = "a kitchen scale"\n')
    rule.write_text('[source]\nrule = "a hold of three minutes"\n')

    def told(*given: Path) -> str:
        checks = doctor._devices(
            "hardware", lambda rig, name: load_config("can", rig, name, given), make_guard
        )
        assert {c.status for c in checks if c.name in ("calibration", "force guard")} == {"ok"}
        return " ".join(check.detail for check in checks)

    assert device_checks.ASSUMED in told(lab)
    everything = told(*(lab, force, rule))
    assert device_checks.ASSUMED not in everything
    for known in ("16 N, by: a load cell; new pads", "counts a newton by: a kitchen scale",
                  "rule on slip by: a hold of three minutes"):  # fmt: skip
        assert known in everything


@pytest.mark.usefixtures("no_arm")
@pytest.mark.parametrize(
    ("active", "at", "status", "remedy"),
    [(True, 6, "ok", ""), (False, 6, "fail", "gripper activate"), (True, 90, "fail", "release"),
     (False, 90, "fail", "release --activate")],
    ids=["ready", "not active", "closed", "closed and not active"],
)  # fmt: skip
def test_hand_that_a_run_would_refuse_stands_against_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, active: bool, at: int, status: str, remedy: str
) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text("[gripper]\ncalibration='manual'" + ADDRESSES)
    said = StatusRegisters(
        active=active, initialization=3 if active else 0, a=AxisStatus(position=at)
    )
    monkeypatch.setattr(device_checks, "read_gripper", lambda config: (said, said))
    monkeypatch.setattr(device_checks, "doubts", lambda *looks: [])
    checks = doctor._devices(
        "hardware", lambda rig, name: load_config("can", rig, name, lab), make_guard
    )
    found = next(check for check in checks if check.name == "gripper")
    assert found.status == status, found
    assert remedy in found.remedy


@pytest.mark.usefixtures("no_arm")
@pytest.mark.parametrize(
    ("mode", "at", "status", "told"),
    [(1, 6, "warn", "open at (6, 0, 0) counts, in pinch mode"), (2, 6, "warn", "in wide mode"),
     (3, 6, "fail", "in scissor mode, in which it is only opened"), (3, 90, "fail", "scissor mode"),
     (2, 90, "fail", "not open")],
)  # fmt: skip
def test_mode_in_which_no_hand_closes_stands_against_a_run_and_any_other_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, at: int, status: str, told: str
) -> None:
    said = StatusRegisters(active=True, mode=mode, initialization=3, a=AxisStatus(position=at))
    monkeypatch.setattr(device_checks, "read_gripper", lambda config: (said, said))
    monkeypatch.setattr(device_checks, "doubts", lambda *looks: [])
    found = only("gripper", tmp_path)
    assert (found.status, found.kind) == (status, "refused" if status == "fail" else "")
    assert told in found.detail
    assert ("`grasp gripper activate`" in found.remedy) == (told != "not open")


@pytest.mark.usefixtures("no_arm")
@pytest.mark.parametrize(("changes", "doubted"), [
    ({"fault": 0x3}, "unknown fault"), ({"a": AxisStatus(position=6, current=255)}, "mA"),
])  # fmt: skip
def test_gripper_that_says_what_none_can_say_stands_against_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], doubted: str
) -> None:
    said = StatusRegisters(**{"active": True, "initialization": 3, **changes})
    monkeypatch.setattr(device_checks, "read_gripper", lambda config: (said, said))
    found = only("gripper", tmp_path)
    assert (found.status, found.remedy) == ("fail", device_checks.STRANGE), found
    assert doubted in found.detail


def only(name: str, folder: Path) -> doctor.Check:
    """What is said of one device of a lab that has them all."""
    lab = folder / "lab.toml"
    lab.write_text("[gripper]\ncalibration='manual'" + ADDRESSES)
    checks = doctor._devices(
        "hardware", lambda rig, name: load_config("can", rig, name, lab), make_guard
    )
    return next(check for check in checks if check.name == name)


@pytest.mark.parametrize(("changes", "status", "doubted"), [
    ({}, "ok", "stands, tool at x 500, y 100, z 300 mm"),
    ({"joints_rad": (7.0, -1.5, 1.6, -1.6, -1.5, 0.0)}, "fail", "joint base at 401 degrees"),
    ({"t_s": 1.0}, "fail", "the controller's clock stands still"),
])  # fmt: skip
def test_arm_that_says_what_none_can_say_stands_against_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], status: str,
    doubted: str,
) -> None:  # fmt: skip
    before = ArmLook(1.0, (0.1, -1.5, 1.6, -1.6, -1.5, 0.0), (0.5, 0.1, 0.3, 0.0, 3.1, 0.0),
                     (0.0,) * 6, 7, 1, 1, 1.0)  # fmt: skip
    now = msgspec.structs.replace(before, **{"t_s": 1.08, **changes})
    answering = SimpleNamespace(checks=[], version=(5, 11))
    monkeypatch.setattr(device_checks, "preflight", lambda *asked: answering)
    monkeypatch.setattr(device_checks.arm_look, "look", lambda *asked: (before, now))
    found = only("arm pose", tmp_path)
    assert found.status == status
    assert doubted in found.detail


class Tips:
    """Fingertips that say the next of these codes at every tick; None: no frame came."""

    def __init__(self, codes: Iterable[int | None]) -> None:
        self.frame: TactileFrame | None = None
        self._codes = iter(codes)

    def begin_rest(self) -> None: ...

    def pump(self, now_ns: int) -> None:
        code = next(self._codes)
        if code is None and self.frame is not None:
            self.frame = msgspec.structs.replace(self.frame, missed=self.frame.missed + 1)
        elif code is not None:
            still = frame()
            self.frame = msgspec.structs.replace(still, raw=still.raw + np.int16(code))


class Ticking:
    """A clock that nobody waits for."""

    now_ns = 0

    def sleep_until_ns(self, until_ns: int) -> None:
        self.now_ns = until_ns


@pytest.mark.parametrize(("codes", "status", "doubted"), [
    (cycle((0, 1)), "ok", "0% of the frames lost"),
    (repeat(0), "fail", "no code changes at all"),
    (cycle((0, None, 1)), "fail", "33% of the frames lost"),
    (chain((0, 1), repeat(None)), "fail", "sends too few frames"),
    (repeat(None), "fail", "sends too few frames"),
], ids=["well", "frozen", "lossy", "silent later", "silent"])  # fmt: skip
def test_fingertips_that_no_run_could_use_stand_against_it(
    codes: Iterable[int | None], status: str, doubted: str
) -> None:
    found = device_checks._listened(cast(Any, Tips(codes)), cast(Any, Ticking()))
    assert found.status == status
    assert doubted in found.detail


@pytest.mark.usefixtures("no_arm")
def test_cell_that_a_run_drives_is_told_with_how_to_end_that(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(ADDRESSES.replace("127.0.0.99", "127.0.0.98"))  # looked at by no other test

    def found() -> doctor.Check:
        checks = doctor._devices(
            "hardware", lambda rig, name: load_config("can", rig, name, lab), make_guard
        )
        return next(check for check in checks if check.name == "cell")

    with driving(*devices_of(load_config("can", "hardware", "energy", lab))):
        assert found().status == "fail"
        assert f"kill {os.getpid()}" in found().remedy
    assert found().status == "ok"


def test_configuration_that_cannot_be_read_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "JITTER_S", 0.05)

    def load(rig: str, name: str) -> Any:
        return load_config("can", rig, name, tmp_path / "none.toml")

    checks = doctor.examine("hardware", None, load, make_guard)
    assert [check.name for check in checks if "none.toml" in check.detail] == ["configuration"]
    unseen = {check.name for check in checks if check.detail.startswith("not looked at")}
    assert unseen == {"detectors", "devices"}


def test_settings_that_cannot_be_read_are_no_device_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "JITTER_S", 0.05)
    assert main(["doctor", "--config", str(tmp_path / "none.toml")]) == 2
    capsys.readouterr()
    assert main(["doctor", "--set", "modbus.hots=127.0.0.99"]) == 2
    assert "--set: modbus.hots: unknown key" in capsys.readouterr().out


def test_file_as_a_whole_is_told_without_a_key(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as told:
        load_config("can", "simulated", "energy", tmp_path / "none.toml")
    assert told.value.message == f"{tmp_path / 'none.toml'}: no such file"
