"""A hand's calibration is a file, by name or by path; its errors name file, key and range."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp.settings import names
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.rig import calibration
from scenarios.trial.execution import make_guard

LAB = """[calibration]
source = "a scale"
least_force_n = 9.5
most_force_n = 58.0
m_per_count = 0.0006
"""


def resolved(*assignments: str, rig: str = "simulated") -> RunConfig:
    return load_config("can", rig, "energy", None, assignments)


def test_packaged_calibrations_are_chosen_by_name() -> None:
    assert names("calibrations") == ["manual", "paper"]
    least = {name: calibration(resolved(f"gripper.calibration={name}")).least_force_n
             for name in names("calibrations")}  # fmt: skip
    assert least == {"manual": 15.0, "paper": 10.0}
    assert calibration(resolved()).name == "paper"


def test_a_file_of_ones_own_is_chosen_by_path_and_reaches_the_guard(tmp_path: Path) -> None:
    file = tmp_path / "hand3.toml"
    file.write_text(LAB)
    config = resolved(f"gripper.calibration={file}", "guard.force_limit_n=9.6",
                      "controller.grip_force_n=9.6", "guard.force_limit_n=9.6")  # fmt: skip
    own = calibration(config)
    assert (own.name, own.least_force_n, own.m_per_count) == ("hand3", 9.5, 0.0006)
    make_guard(config)
    with pytest.raises(ConfigError):
        make_guard(resolved("guard.force_limit_n=9.6"))


def test_settings_of_equal_names_but_other_figures_have_other_hashes(tmp_path: Path) -> None:
    file = tmp_path / "paper.toml"
    file.write_text(LAB)
    choice = f"gripper.calibration={file}"
    before = resolved(choice).digest()
    file.write_text(LAB.replace("9.5", "9.4"))
    assert resolved(choice).digest() != before


@pytest.mark.parametrize(
    ("line", "key", "allowed"),
    [
        ("least_force_n = 0.1", "calibration.least_force_n", ">= 1 and <= 30"),
        ("leest_force_n = 9.5", "calibration.leest_force_n", "least_force_n"),
        ("least_force_n = 20.0", "calibration", "goes together"),
    ],
)
def test_an_error_names_the_file_the_key_and_what_is_allowed(
    tmp_path: Path, line: str, key: str, allowed: str
) -> None:
    file = tmp_path / "hand3.toml"
    file.write_text(LAB.replace("least_force_n = 9.5", line).replace("58.0", "20.0"))
    with pytest.raises(ConfigError) as caught:
        resolved(f"gripper.calibration={file}")
    assert (caught.value.file, caught.value.key) == (str(file), key)
    assert allowed in caught.value.allowed


def test_unknown_names_missing_files_and_what_is_no_name_are_refused() -> None:
    for choice in ("papr", "./none.toml", "none.toml", "5"):
        with pytest.raises(ConfigError):
            resolved(f"gripper.calibration={choice}")


def test_hardware_has_no_calibration_unless_somebody_chooses() -> None:
    config = resolved(rig="hardware")
    assert config.calibration is None
    with pytest.raises(ConfigError, match="by hand") as caught:
        calibration(config)
    assert "paper" in caught.value.allowed and "path" in caught.value.allowed
    assert calibration(resolved("gripper.calibration=manual", rig="hardware")).name == "manual"
