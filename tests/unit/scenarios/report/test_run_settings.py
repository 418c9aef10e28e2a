"""The command on a page repeats the trial with the same settings."""

import shlex
from pathlib import Path

from grasp.cli.commands import build_parser
from scenarios.campaign.config import load_config
from scenarios.report.run_record import RunRecord, read_run
from scenarios.report.run_settings import command_of
from scenarios.tap.tap import tap
from scenarios.trial.config import TrialConfig


def settings_by(arguments: list[str]) -> TrialConfig:
    """The settings of a run of that command."""
    args = build_parser().parse_args(arguments[1:])
    config = load_config(args.object, args.rig, args.detector, None, args.set, args.profile)
    return tap.configure(config.for_tap()) if args.command == "run tap" else config.for_lift()


def config_hash(run: RunRecord) -> str:
    return run.metadata["config_hash"]


def test_the_command_has_the_settings_of_the_run(recorded: Path) -> None:
    run = read_run(recorded)
    arguments = shlex.split(command_of(run.settings, run.seed))
    assert settings_by(arguments).digest() == config_hash(run)
    assert "--detector" in arguments and "energy.threshold_counts=3" in " ".join(arguments)
