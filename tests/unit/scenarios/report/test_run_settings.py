"""The command on a page runs the same trial, and its settings say what was chosen."""

import shlex
from pathlib import Path

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


def meant(words: list[str]) -> TrialConfig:
    """The settings with which that command would run."""
    args = build_parser().parse_args(words[1:])
    own = load_config(args.object, args.rig, args.detector, None, args.set, args.profile)
    return tap.tap_config(own.for_tap()) if args.scenario == "tap" else own.for_lift()


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
