"""The experiments by name."""

from typing import Any

from scenarios.lift.lift import lift
from scenarios.tap.tap import tap
from scenarios.trial.experiment import Experiment

EXPERIMENTS: dict[str, Experiment[Any, Any, Any]] = {each.name: each for each in (lift, tap)}
