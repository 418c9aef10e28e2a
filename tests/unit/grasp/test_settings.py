"""Settings: layers, violations and what their errors say."""

import os
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp import settings
from grasp.settings import (
    Layer,
    assignment_layer,
    file_of,
    load,
    named_layer,
    read_toml,
    thing_layer,
)
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs.calibration import own_files_of


def lift(*assignments: str, file: Path | None = None) -> RunConfig:
    return load_config("can", "simulated", "energy", file, assignments)


def test_later_layers_win_key_by_key(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[guard]\nforce_limit_n = 12.0\ntip_mass_kg = 0.2\n")
    config = lift("guard.force_limit_n=11", file=file)
    assert config.guard.force_limit_n == 11.0
    assert config.guard.tip_mass_kg == 0.2
    assert config.object.name == "can"


def test_a_section_that_stands_twice_is_told_to_be_joined(tmp_path: Path) -> None:
    """As blocks that were pasted one after the other make it."""
    file = tmp_path / "lab.toml"
    file.write_text('[modbus]\nhost = "a"\n[modbus]\ntimeout_s = 0.4\n')
    with pytest.raises(ConfigError, match="twice") as refused:
        read_toml(file)
    assert "a section stands once, with all its keys" in refused.value.remedy
    file.write_text("[modbus\n")
    with pytest.raises(ConfigError) as refused:
        read_toml(file)
    assert "once" not in refused.value.remedy


def test_configuration_file_of_the_environment_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[controller]\nhold_s = 2.5\n")
    monkeypatch.setenv("GRASP_CONFIG", str(file))
    assert lift().controller.hold_s == 2.5


def test_empty_variable_of_the_environment_names_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASP_CONFIG", "")
    assert lift().controller.hold_s == 1.0
    assert own_files_of(None) == []


@pytest.mark.parametrize("said", ["", "# to be measured\n", "[rule]\n"])
def test_file_of_ones_own_that_says_nothing_is_refused_with_what_writes_a_rule(
    said: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(said)
    with pytest.raises(ConfigError, match="says nothing") as refused:
        lift(file=file)
    assert f"`grasp detector tune ... > {file}`" in str(refused.value.remedy)


@pytest.mark.parametrize(
    ("assignment", "key", "says"),
    [
        ("guard.force_limt_n=9", "guard.force_limt_n", "force_limit_n"),
        ("guard.force_limit_n=900", "guard.force_limit_n", "<= 60"),
        ("guard.force_limit_n=much", "guard.force_limit_n", "float"),
        ("guard.cap_mode=none", "guard.cap_mode", "each_motor"),
        ("gard.force_limit_n=9", "gard", "guard"),
        ("object.grip_counts=[1,2]", "object.grip_counts", "int"),
        ("controller.lift_height_m=-1", "controller.lift_height_m", ">= 0.01"),
        ("loop.period_s=nan", "loop.period_s", ">= 0.002"),
        ("arm.workspace_low_m=[0.0, nan, 0.0]", "arm.workspace_low_m", "finite numbers"),
        ("ur.cog_m=[nan, nan, nan]", "ur.cog_m", "finite numbers"),
    ],
)
def test_violation_names_source_key_and_what_is_allowed(
    assignment: str, key: str, says: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        lift(assignment)
    assert caught.value.file == "--set"
    assert caught.value.key == key
    assert says in f"{caught.value.message} {caught.value.allowed}"


@pytest.mark.parametrize("text", ["guard.force_limit_n", "=9", "guard..force_limit_n=9", ".=9", ""])
def test_a_word_that_assigns_nothing_is_no_assignment(text: str) -> None:
    with pytest.raises(ConfigError, match="not an assignment"):
        assignment_layer([text])


@pytest.mark.parametrize(("more", "is_read"), [(0, True), (1, False)])
def test_a_file_may_have_a_million_bytes_and_no_more(
    more: int, is_read: bool, tmp_path: Path
) -> None:
    file = tmp_path / "large.toml"
    file.write_text("a = 1".ljust(settings.MOST_BYTES + more))
    try:
        assert read_toml(file).table == {"a": 1}
    except ConfigError as error:
        assert "more than 1000000 bytes" in error.message
        assert not is_read
    else:
        assert is_read


@pytest.mark.parametrize("text", ["[guard]\nforce_limit_n = 9.0\n", "object = 3\n", ""])
def test_a_file_of_ones_own_has_the_section_of_its_thing_alone(text: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[object]\nname = "mine"\n')
    assert thing_layer("objects", "object", str(file)).table == {"object": {"name": "mine"}}
    file.write_text(text)
    with pytest.raises(ConfigError):
        thing_layer("objects", "object", str(file))


@pytest.mark.parametrize("text", ["guard", "=3", "guard..x=1", "guard=1"])
def test_malformed_assignment_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        lift(text)


def test_unknown_object_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError) as caught:
        load_config("cann", "simulated", "energy")
    assert "did you mean 'can'" in caught.value.message
    assert "football" in caught.value.allowed


def test_missing_and_malformed_files_are_refused_by_name(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("[guard\n")
    for path in (tmp_path / "none.toml", broken):
        with pytest.raises(ConfigError) as caught:
            read_toml(path)
        assert caught.value.file == str(path)


def test_every_packaged_object_and_detector_resolves() -> None:
    for name in settings.names("objects"):
        for detector in settings.names("detectors"):
            assert load_config(name, "simulated", detector).object.name == name


def test_text_values_need_no_quotes() -> None:
    assert assignment_layer(["gripper.calibration=manual"]).table == {
        "gripper": {"calibration": "manual"}
    }


def test_missing_required_setting_is_named() -> None:
    table = dict(named_layer("objects", "can").table["object"])
    del table["mass_kg"]
    with pytest.raises(ConfigError) as caught:
        load(RunConfig, [Layer("x", {"rig": "r", "detector_name": "d", "object": table})])
    assert caught.value.key == "object.mass_kg"


def test_what_is_missing_in_the_only_file_is_told_with_its_name() -> None:
    with pytest.raises(ConfigError) as caught:
        load(RunConfig, [Layer("mine.toml", {"rig": "r"})])
    assert caught.value.file == "mine.toml"


@pytest.mark.parametrize("word", ["paper.toml", "sets/paper"])
def test_a_path_is_not_looked_up_by_name(word: str) -> None:
    assert file_of("datasets", word) == Path(word)


def test_a_packaged_file_is_found_by_its_name_from_any_folder() -> None:
    assert file_of("datasets", "paper").is_file()
    with pytest.raises(ConfigError, match="papr") as caught:
        file_of("datasets", "papr")
    assert "confusers" in caught.value.allowed


def test_digest_changes_with_any_setting() -> None:
    assert lift().digest() == lift().digest()
    assert lift().digest() != lift("guard.overshoot_n=0.9").digest()


def test_a_named_pipe_that_nobody_writes_to_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "lab.toml")
    with pytest.raises(ConfigError, match="a named pipe"):
        read_toml(tmp_path / "lab.toml")


def test_a_pipe_that_a_shell_hands_over_is_read() -> None:
    ours, theirs = os.pipe()
    os.write(theirs, b"a = 1")
    os.close(theirs)
    try:
        assert read_toml(Path(f"/dev/fd/{ours}")).table == {"a": 1}
    finally:
        os.close(ours)
