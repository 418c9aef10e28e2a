"""Settings: layers, violations and their error messages."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp import settings
from scenarios.campaign.config import RunConfig, load_config


def lift(*assignments: str, file: Path | None = None) -> RunConfig:
    return load_config("can", "simulated", "energy", file, assignments)


def test_later_layers_win_key_by_key(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[guard]\nforce_limit_n = 12.0\ntip_mass_kg = 0.2\n")
    config = lift("guard.force_limit_n=11", file=file)
    assert config.guard.force_limit_n == 11.0
    assert config.guard.tip_mass_kg == 0.2
    assert config.object.name == "can"


@pytest.mark.parametrize(
    ("assignment", "key", "expected"),
    [
        ("guard.force_limt_n=9", "guard.force_limt_n", "force_limit_n"),
        ("controller.force_limit_n=9", "controller.force_limit_n", "mean 'guard.force_limit_n'"),
        ("guard.force_limit_n=900", "guard.force_limit_n", "<= 60"),
        ("guard.force_limit_n=much", "guard.force_limit_n", "float"),
        ("guard.limit_mode=none", "guard.limit_mode", "each_motor"),
        ("gard.force_limit_n=9", "gard", "guard"),
        ("guard.counts_per_newton=[150,160]", "guard.counts_per_newton", "or three, of A, B and C"),
        ("guard.counts_per_newton=[150,0,170]", "guard.counts_per_newton[1]", ">= 1"),
        ("guard.counts_per_newton=0.5", "guard.counts_per_newton", ">= 1"),
        ("object.grip_counts=[1,2]", "object.grip_counts", "int"),
        ("controller.lift_height_m=-1", "controller.lift_height_m", ">= 0.01"),
        ("loop.period_s=nan", "loop.period_s", "finite numbers"),
        ("arm.workspace_low_m=[0.0, nan, 0.0]", "arm.workspace_low_m", "finite numbers"),
        ("ur.cog_m=[nan, nan, nan]", "ur.cog_m", "finite numbers"),
    ],
)
def test_violation_names_source_key_and_what_is_allowed(
    assignment: str, key: str, expected: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        lift(assignment)
    assert caught.value.file == "--set"
    assert caught.value.key == key
    assert expected in f"{caught.value.message} {caught.value.allowed}"


def test_key_without_its_section_is_refused_with_the_full_name(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("force_limit_n = 12.0\n")
    with pytest.raises(ConfigError, match=r"did you mean 'guard\.force_limit_n'"):
        lift(file=file)


def test_allowed_sections_do_not_include_names_that_only_an_option_chooses() -> None:
    with pytest.raises(ConfigError) as caught:
        lift("nosuch.key=1")
    allowed = caught.value.allowed.split(", ")
    assert "guard" in allowed
    assert not {"rig", "profile", "detector_name"} & set(allowed)


def test_unknown_rig_is_reported_as_the_value_of_its_option() -> None:
    with pytest.raises(ConfigError) as caught:
        load_config("can", "emulatd", "energy")
    assert caught.value.message == "--rig: 'emulatd' is unknown (did you mean 'emulated'?)"
    assert "simulated" in caught.value.allowed


def test_unknown_object_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError) as caught:
        load_config("cann", "simulated", "energy")
    assert "did you mean 'can'" in caught.value.message
    assert "football" in caught.value.allowed


def test_every_packaged_object_and_detector_resolves() -> None:
    for name in settings.names("objects"):
        for detector in settings.names("detectors"):
            assert load_config(name, "simulated", detector).object.name == name


def test_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[guard]\nforce_limit_n = 12.0\n", encoding="utf-8-sig")
    assert lift(file=file).guard.force_limit_n == 12.0


@pytest.mark.parametrize(
    ("encoding", "named"),
    [("utf-16", "UTF-16"), ("utf-16-le", "UTF-16"), ("latin-1", "Latin-1 or Windows-1252")],
)
def test_another_encoding_is_named(encoding: str, named: str, tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    text = "[guard]\n# h\N{LATIN SMALL LETTER O WITH DIAERESIS}chstens\nforce_limit_n = 12.0\n"
    file.write_text(text if encoding == "latin-1" else text.replace("\xf6", "o"), encoding)
    with pytest.raises(ConfigError, match=f"is not UTF-8, but probably {named}") as caught:
        lift(file=file)
    assert caught.value.allowed == "save it as UTF-8"


def test_a_decimal_comma_is_answered_with_the_point(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[controller]\nlift_speed_mps = 0,05  # slow\n")
    for given in ({"file": file}, {"assignments": ("controller.lift_speed_mps=0,05",)}):
        with pytest.raises(ConfigError, match=r"lift_speed_mps.*is 0,05, with a comma") as caught:
            lift(*given.get("assignments", ()), file=given.get("file"))
        assert caught.value.allowed == "write a decimal point: 0.05"
    with pytest.raises(ConfigError, match="cannot be read"):  # another error of TOML
        file.write_text("[controller\nlift_speed_mps = 0.05\n")
        lift(file=file)
