"""User files for objects, surfaces, rigs and settings, given by their path."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp import settings
from grasp.cli.main import main
from grasp.settings import config_dir
from scenarios.campaign.config import load_config

UserFile = Callable[..., Path]


@pytest.fixture
def user_file(tmp_path: Path) -> UserFile:
    """Writes a packaged object under another name."""

    def write(name: str = "mine", kind: str = "objects", like: str = "can", more: str = "") -> Path:
        text = (config_dir() / kind / f"{like}.toml").read_text()
        file = tmp_path / f"{name}.toml"
        file.write_text(text.replace(f'name = "{like}"', f'name = "{name}"') + more)
        return file

    return write


def test_a_user_object_is_named_by_its_path(user_file: UserFile) -> None:
    config = load_config(str(user_file()), "simulated", "energy")
    can = load_config("can", "simulated", "energy")
    assert config.object.name == "mine"
    assert config.object.grip_counts == can.object.grip_counts
    heavier = load_config(str(user_file()), "simulated", "energy", None, ["object.mass_kg=0.4"])
    assert heavier.object.mass_kg == 0.4


@pytest.mark.parametrize(
    ("text", "key", "problem"),
    [
        ("[guard]\nforce_limit_n = 12\n[object]\n", "guard", "does not belong to the object"),
        ("mass_kg = 1.0\n", "mass_kg", "does not belong to the object"),
        ("", "object", "missing"),
        ("object = 3\n", "object", "missing"),
        ('[object]\nname = "can"\n', "object.name", "--object can"),
        ('[object]\nname = "mug"\n', "object.name", "--object mug"),
        ('[object]\nname = "mine"\n', "object.mass_kg", "missing"),
        ('[object]\nname = "mine"\nmass = 1\n', "object.mass", "mass_kg"),
        ('[object]\nname = "../x"\n', "object.name", "letter or digit first"),
    ],
)
def test_a_file_that_is_no_object_is_refused_by_its_path(
    text: str, key: str, problem: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(str(file), "simulated", "energy")
    output = f"{caught.value.message} {caught.value.remedy}"
    assert str(file) in output and key in output and problem in output


def test_a_packaged_object_may_be_given_by_its_path(capsys: pytest.CaptureFixture[str]) -> None:
    for kind, name in (("objects", "can"), ("objects/unseen", "mug"), ("surfaces", "sphere")):
        assert main(["config", str(config_dir() / kind / f"{name}.toml")]) == 0
        assert f"{name!r}" in capsys.readouterr().out


def test_an_object_with_the_name_of_a_held_out_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, user_file: UserFile
) -> None:
    copy = shutil.copytree(config_dir(), tmp_path / "config")
    mine = shutil.copy(copy / "objects/unseen/jar.toml", copy / "objects")
    monkeypatch.setattr(settings, "config_dir", lambda: copy)
    for word in ("jar", str(mine)):
        with pytest.raises(ConfigError, match="also the name of a file in config/objects/unseen"):
            settings.item_layer("objects", "object", word)
    wrong = shutil.copy(copy / "objects/can.toml", copy / "objects/tin.toml")
    with pytest.raises(ConfigError, match="is 'can', a name in config/objects"):
        settings.item_layer("objects", "object", str(wrong))


# Rigs


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "rig: missing"),
        ('rig = "mine"\n', "rig: unknown rig 'mine'"),
        ("rig = 3\n", "rig: unknown rig 3"),
        ('rig = "simulated"\nprofile = "paper"\n', "profile: is no setting"),
        ('rig = "simulated"\n[gripper]\ncalibrations = "x"\n', "did you mean 'calibration'"),
    ],
)
def test_a_file_that_is_no_rig_is_refused_by_its_path(
    text: str, expected: str, tmp_path: Path
) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=expected) as caught:
        load_config("can", str(file), "energy")
    assert str(file) in caught.value.message


# `grasp config`


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, "an object for --object, 'mine'"),
        ('rig = "hardware"\n[modbus]\nhost = "10.0.0.7"\n', "a rig for --rig, opened as hardware"),
        ('name = "c"\nobjects = ["can", "ball"]\n', "a campaign of 2 combinations"),
        ("[guard]\nforce_limit_n = 9.0\n[rule]\nconsecutive = 3\n", "settings for --config, guard"),
        ("[control]\nforce_n = 5.0\n", "settings for --config, of an acquisition: control"),
    ],
)
def test_kind_of_a_file_is_found_from_its_content(
    text: str | None,
    expected: str,
    user_file: UserFile,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = user_file()
    if text is not None:
        file.write_text(text)
    assert main(["config", str(file)]) == 0
    output = capsys.readouterr().out
    assert output.startswith(f"{file}: {expected}")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[guard]\nforce_limit_n = 99.0\n", "guard.force_limit_n"),
        ("[gard]\nforce_limit_n = 9.0\n", "did you mean 'guard'"),
        ("x = = 1", "cannot be read"),
        ('name = "c"\nobjects = ["elephant"]\n', "elephant"),
        ('rig = "lab"\n', "unknown rig 'lab'"),
        ('rig = "hardware"\ndetector_name = "tcn"\n', "is no setting"),
        ('[rule]\nkind = "cusum"\nconsecutive = 2\n', "rule.consecutive: is not read"),
        (
            '[rule]\nkind = "consecutive"\nlimit = 9.0\n',
            "is not read by a rule of kind consecutive and fusion mean",
        ),
        ("[controller]\nmargin_steps = 2\n", "controller.margin_steps"),
    ],
)
def test_each_wrong_file_is_one_line_and_all_files_are_checked(
    text: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong, right = tmp_path / "wrong.toml", tmp_path / "right.toml"
    wrong.write_text(text)
    right.write_text("[guard]\nforce_limit_n = 9.0\n")
    assert main(["config", str(wrong), str(right)]) == 2
    output = capsys.readouterr()
    assert expected in output.err
    assert "Traceback" not in output.err
    assert f"{right}: settings" in output.out
    assert main(["config", "can"]) == 2
