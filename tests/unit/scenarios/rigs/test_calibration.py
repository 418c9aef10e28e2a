"""Calibration files of a hand: choice by name or path, and plausibility on real devices."""

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.errors import ConfigError
from drivers.robotiq.calibration import GripperCalibration
from scenarios.campaign.config import RunConfig, load_config
from scenarios.lab.hand import hand_guard, step_counts
from scenarios.rigs.calibration import calibration, settings_to_open, weak_claim
from scenarios.rigs.permission import check_devices
from scenarios.trial.execution import make_guard
from tests.calibrations import PRESSED

LAB = """[calibration]
source = "a scale"
least_force_n = 9.5
most_force_n = 58.0
m_per_count = 0.0006
"""


def resolved(*assignments: str, rig: str = "simulated") -> RunConfig:
    return load_config("can", rig, "energy", None, assignments)


def test_calibration_file_is_chosen_by_path_and_used_by_the_guard(tmp_path: Path) -> None:
    file = tmp_path / "hand3.toml"
    file.write_text(LAB)
    config = resolved(f"gripper.calibration={file}", "guard.force_limit_n=9.6",
                      "controller.grip_force_n=9.6", "guard.force_limit_n=9.6")  # fmt: skip
    chosen = calibration(config)
    assert (chosen.name, chosen.least_force_n, chosen.m_per_count) == ("hand3", 9.5, 0.0006)
    make_guard(config)
    with pytest.raises(ConfigError):
        make_guard(resolved("guard.force_limit_n=9.6"))


# Forces of a file compared with the manual's

EDITED = {"least_force_n": 15.0, "most_force_n": 15.1, "force_exponent": 3.0}
EVIDENCE = {"pressed_bytes": (0, 255), "presses": 10}


def stated(**figures: Any) -> GripperCalibration:
    return GripperCalibration(
        **{"name": "own", "source": "edited", "least_force_n": 15.0, **figures}
    )


def file_of(known: GripperCalibration, folder: Path) -> Path:
    file = folder / "own.toml"
    lines = [f"{key} = {json.dumps(value)}" for key, value in msgspec.to_builtins(known).items()
             if key != "name"]  # fmt: skip
    file.write_text("\n".join(["[calibration]", *lines]) + "\n")
    return file


def test_force_below_a_third_of_the_manuals_is_refused_on_real_devices(tmp_path: Path) -> None:
    """With this file a limit of 15.1 N would command byte 255, which is 60 N."""
    choice = f"gripper.calibration={file_of(stated(**EDITED, **EVIDENCE), tmp_path)}"
    limits = ("guard.force_limit_n=15.1", "controller.grip_force_n=15.1")
    hosts = ("modbus.host=127.0.0.1", "ur.host=127.0.0.1", "usb.serial=any")
    lab = resolved(choice, *limits, *hosts, rig="hardware")
    assert lab.calibration is not None
    assert lab.calibration.byte_at_most(15.1) == 255
    for opened in (
        make_guard,
        hand_guard,
        check_devices,
        calibration,
        lambda c: step_counts(c, 2e-3),
    ):
        with pytest.raises(ConfigError, match="less than a third of the manual's 60 N"):
            opened(lab)
    make_guard(resolved(choice, *limits))  # a simulated hand is what it is said to be


@pytest.mark.parametrize(
    ("evidence", "accepted"),
    [({}, False), ({"presses": 10}, False), ({"pressed_bytes": (0,)}, False),
     ({"pressed_bytes": (0,), "presses": 9}, False),
     ({"pressed_bytes": (9,), "presses": 10}, False),
     ({"pressed_bytes": (0,), "presses": 10}, True)],
    ids=str,
)  # fmt: skip
def test_force_below_the_manuals_is_refused_on_real_devices_without_ten_presses(
    evidence: dict[str, Any], accepted: bool, tmp_path: Path
) -> None:
    choice = f"gripper.calibration={file_of(stated(least_force_n=14.9, **evidence), tmp_path)}"
    limits = ("guard.force_limit_n=20", "controller.grip_force_n=20")
    lab = resolved(choice, *limits, rig="hardware")
    if accepted:
        make_guard(lab)
        assert weak_claim(calibration(lab))
        return
    with pytest.raises(ConfigError, match="does not state 10 presses of byte 0") as refused:
        make_guard(lab)
    assert refused.value.allowed == "a file written by `grasp calibrate hand`; until then manual"
    make_guard(resolved(choice, *limits))  # a simulated hand is what it is said to be


def test_hand_opens_with_any_calibration_but_not_without_one(tmp_path: Path) -> None:
    lab = resolved(f"gripper.calibration={file_of(stated(**EDITED), tmp_path)}", rig="hardware")
    assert calibration(settings_to_open(lab)).name == "manual"
    plausible = resolved("gripper.calibration=paper", *PRESSED, rig="hardware")
    assert settings_to_open(plausible) is plausible
    with pytest.raises(ConfigError, match="no default"):
        settings_to_open(resolved(rig="hardware"))
