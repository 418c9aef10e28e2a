"""The command on a page runs the same trial, and its settings say what was chosen."""

import json
import shlex
from pathlib import Path
from typing import Any

import msgspec
import pytest

from grasp.cli.main import build_parser
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.report.run_record import RunRecord, read_run
from scenarios.report.run_settings import command_of, object_file, settings_of, shell
from scenarios.tap import tap
from scenarios.trial.config import TrialConfig
from tests.unit.scenarios.conftest import config
from tests.unit.scenarios.report.conftest import changed


def meant(words: list[str]) -> TrialConfig:
    """The settings with which that command would run."""
    args = build_parser().parse_args(words[1:])
    own = load_config(args.object, args.rig, args.detector, None, args.set, args.profile)
    return tap.tap_config(own.for_tap()) if args.scenario == "tap" else own.for_lift()


def command_again(folder: Path) -> list[str]:
    run = read_run(folder)
    return command_of(run.settings, run.seed)


def told(run: RunRecord) -> str:
    return run.metadata["config_hash"]


def test_the_command_has_the_settings_of_the_run(recorded: Path) -> None:
    run = read_run(recorded)
    words = shlex.split(shell(command_of(run.settings, run.seed)))
    assert meant(words).digest() == told(run)
    assert "--detector" in words and "energy.threshold_counts=3" in " ".join(words)


def test_so_has_that_of_a_tap(tmp_path: Path) -> None:
    own = load_config("ball", "simulated", "energy", None, ["tap.height_m=0.1"], "paper")
    result = tap.run(own.for_tap(), 3, tmp_path).result
    assert result is not None and result.recording is not None
    run = read_run(Path(result.recording))
    words = command_of(run.settings, run.seed)
    assert meant(words).digest() == told(run)
    assert words[-2:] == ["--set", "tap.height_m=0.1"]
    assert words[words.index("--seed") + 1] == "3"
    # the tap itself chooses these
    assert not {"controller.firm", "controller.hold_s"} & {
        s.key for s in settings_of(run.settings) if s.own
    }


def test_an_object_of_ones_own_is_given_as_the_file_that_the_command_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = msgspec.structs.replace(config().object, name="flask-of-mine", mass_kg=0.4)
    own = msgspec.structs.replace(config(), object=body)
    result = lift.run(own, 0, tmp_path).result
    assert result is not None and result.recording is not None
    run = read_run(Path(result.recording))
    words = command_of(run.settings, run.seed)
    assert "flask-of-mine.toml" in words and not [
        word for word in words if word.startswith("object.")
    ]
    monkeypatch.chdir(tmp_path)
    Path("flask-of-mine.toml").write_text(object_file(run.settings))
    assert meant(words).digest() == told(run)


def test_an_object_that_is_kept_for_testing_is_called_by_its_name(
    recorded: Path, tmp_path: Path
) -> None:
    def settings(told: dict[str, Any]) -> None:
        told["object"] = msgspec.to_builtins(config(object_name="mug").object)

    run = read_run(changed(recorded, tmp_path / "run", settings=settings))
    assert not object_file(run.settings)
    assert command_of(run.settings, run.seed)[5:8] == ["--object", "mug", "--detector"]


def test_only_what_differs_is_called_ones_own(recorded: Path) -> None:
    own = {
        setting.key: setting for setting in settings_of(read_run(recorded).settings) if setting.own
    }
    assert own.keys() == {"energy.threshold_counts", "fingertip.holding_share"}
    assert json.loads(own["energy.threshold_counts"].value) == 3
    usual = load_config("can", "simulated", "energy").energy.threshold_counts
    assert own["energy.threshold_counts"].usual == str(usual)


def test_what_this_version_cannot_tell_is_not_called_ones_own(
    recorded: Path, tmp_path: Path
) -> None:
    other = changed(
        recorded, tmp_path / "run", settings=lambda told: told.update(profile="of-tomorrow")
    )
    assert not [setting for setting in settings_of(read_run(other).settings) if setting.own]


def test_the_environment_has_no_say_in_what_is_usual(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = command_again(recorded)
    (tmp_path / "mine.toml").write_text("[controller]\nhold_s = 3\n")
    monkeypatch.setenv("GRASP_CONFIG", str(tmp_path / "mine.toml"))
    assert command_again(recorded) == before
