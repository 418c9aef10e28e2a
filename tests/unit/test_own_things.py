"""Objects and surfaces of one's own, by the path of a file."""

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp.cli.main import main
from grasp.settings import config_dir, thing_layer
from scenarios.acquire.config import load_acquire_config
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import combinations, read_spec

Own = Callable[..., Path]


@pytest.fixture
def own(tmp_path: Path) -> Own:
    """Writes a packaged thing under a name of its own."""

    def write(name: str = "mine", kind: str = "objects", like: str = "can", more: str = "") -> Path:
        text = (config_dir() / kind / f"{like}.toml").read_text()
        file = tmp_path / f"{name}.toml"
        file.write_text(text.replace(f'name = "{like}"', f'name = "{name}"') + more)
        return file

    return write


def test_an_object_of_ones_own_is_named_by_its_path(own: Own) -> None:
    config = load_config(str(own()), "simulated", "energy")
    can = load_config("can", "simulated", "energy")
    assert config.object.name == "mine"
    assert config.object.grip_counts == can.object.grip_counts
    heavier = load_config(str(own()), "simulated", "energy", None, ["object.mass_kg=0.4"])
    assert heavier.object.mass_kg == 0.4


def test_a_surface_of_ones_own_is_named_by_its_path(own: Own) -> None:
    file = own("dome", "surfaces", "sphere")
    assert load_acquire_config(str(file), "simulated").surface.name == "dome"


@pytest.mark.parametrize(
    ("text", "key", "problem"),
    [
        ("[guard]\nforce_limit_n = 12\n[object]\n", "guard", "not of the object"),
        ("mass_kg = 1.0\n", "mass_kg", "not of the object"),
        ("", "object", "missing"),
        ("object = 3\n", "object", "missing"),
        ('[object]\nname = "can"\n', "object.name", "--object can"),
        ('[object]\nname = "mug"\n', "object.name", "--object mug"),
        ('[object]\nname = "mine"\n', "object.grip_counts", "missing"),
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
    said = f"{caught.value.message} {caught.value.remedy}"
    assert str(file) in said and key in said and problem in said


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        thing_layer("objects", "object", str(tmp_path / "none.toml"))


def test_a_lift_and_its_plan_take_an_object_of_ones_own(
    own: Own, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(own())
    words = ["run", "lift", "--object", file, "--rig", "simulated", "--runs", str(tmp_path)]
    assert main([*words, "--detector", "energy", "--json"]) in (0, 1)
    assert Path(json.loads(capsys.readouterr().out)["recording"]).parent.name.endswith("-mine")
    assert main(["world", "plan", "tap", "--object", file]) == 0
    assert "choice: L" in capsys.readouterr().out


def test_levels_are_checked_on_objects_of_ones_own(
    own: Own, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "draws.json"
    words = ["world", "check", "--draws", "1", "--objects", str(own()), "--jobs", "1"]
    assert main([*words, "--detector", "energy", "--out", str(out)]) == 0
    assert "detector energy" in capsys.readouterr().out
    (draw,) = json.loads(out.read_text())
    assert draw["object"] == "mine"


def test_a_campaign_finds_objects_beside_its_own_file(
    own: Own, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own()
    file = tmp_path / "c.toml"
    file.write_text('name = "c"\nobjects = ["can", "./mine.toml"]\n')
    monkeypatch.chdir("/")
    places = combinations(read_spec(file))
    assert [place.config.object.name for place in places] == ["can", "mine"]


def test_a_campaign_runs_an_object_of_ones_own_and_goes_on_with_it(
    own: Own, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own()
    monkeypatch.chdir(tmp_path)
    Path("c.toml").write_text(
        'name = "c"\nobjects = ["mine.toml"]\ndetectors = ["energy"]\nrepetitions = 1\n'
    )
    words = ["campaign", "run", "c.toml", "--out", "c.sqlite", "--jobs", "1", "--json"]
    assert main(words) == 0
    with sqlite3.connect("c.sqlite") as db:
        assert db.execute("SELECT object, status FROM trials").fetchall() == [("mine", "done")]
    db.close()
    assert main([*words, "--resume"]) == 0


def test_two_objects_of_a_campaign_that_are_called_the_same_are_refused(
    own: Own, tmp_path: Path
) -> None:
    first = own()
    second = tmp_path / "second.toml"
    second.write_text(first.read_text())
    file = tmp_path / "c.toml"
    file.write_text(f'name = "c"\nobjects = ["{first}", "{second}"]\n')
    with pytest.raises(ConfigError, match="both called 'mine'"):
        combinations(read_spec(file))
