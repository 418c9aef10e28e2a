"""The command on a page runs the same trial, and its settings say what was chosen."""

import shlex
from pathlib import Path

from grasp.cli.commands import build_parser
from scenarios.campaign.config import load_config
from scenarios.report.run_record import RunRecord, read_run
from scenarios.report.run_settings import command_of
from scenarios.tap.tap import tap
from scenarios.trial.config import TrialConfig


def meant(words: list[str]) -> TrialConfig:
    """The settings with which that command would run."""
    args = build_parser().parse_args(words[1:])
    own = load_config(args.object, args.rig, args.detector, None, args.set, args.profile)
    return tap.configure(own.for_tap()) if args.scenario == "tap" else own.for_lift()


def told(run: RunRecord) -> str:
    return run.metadata["config_hash"]


def test_the_command_has_the_settings_of_the_run(recorded: Path) -> None:
    run = read_run(recorded)
    words = shlex.split(command_of(run.settings, run.seed))
    assert meant(words).digest() == told(run)
    assert "--detector" in words and "energy.threshold_counts=3" in " ".join(words)
