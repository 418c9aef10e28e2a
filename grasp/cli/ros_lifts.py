"""The lifts that a ROS 2 node may start, and their command lines."""

import argparse
from typing import Any, NamedTuple

from drivers.errors import ConfigError, UsageError
from grasp.cli.detector import check_weights
from grasp.cli.lab import motion_permit
from grasp.settings import names
from scenarios.campaign.config import load_config
from scenarios.rigs.permission import check_devices
from scenarios.trial.execution import make_guard


class Goal(NamedTuple):
    """What a client may choose of a lift; empty: as on the node's command line."""

    object: str = ""
    profile: str = ""


class Lifts:
    """The lifts that this node may start: settings and permission of its own command line."""

    def __init__(self, args: argparse.Namespace) -> None:
        """Raises ConfigError and UsageError as `grasp run lift` would."""
        self._args, self._started = args, 0
        self._config = self._load(Goal())
        self.permit = motion_permit(self._config, args)
        check_devices(self._config)
        check_weights(self._config)
        make_guard(self._config)

    @property
    def rig(self) -> str:
        """The rig, as on the command line."""
        return str(self._args.rig)

    @property
    def m_per_count(self) -> float:
        """Fingertip travel of a motor count, m."""
        return float(self._config.calibration.m_per_count)

    def problem(self, goal: Goal) -> str:
        """Why this lift is refused; empty if it is allowed. A goal names an object and a profile of
        this package, no file, and changes no limit."""
        for kind, word in (("objects", goal.object), ("profiles", goal.profile)):
            if word and word not in names(kind):
                return f"{word!r} is unknown in {kind}: {', '.join(names(kind))}"
        try:
            config = self._load(goal)
            make_guard(config)
        except (ConfigError, UsageError) as error:
            return f"{error.message} ({error.remedy})"
        if config.guard != self._config.guard:
            return (f"profile {goal.profile} changes the force guard: start the node with "
                    f"--profile {goal.profile}")  # fmt: skip
        return ""

    def words(self, goal: Goal) -> list[str]:
        """Command line of the next lift, without `grasp`. Each has its own seed."""
        args, seed = self._args, self._args.seed + self._started
        self._started += 1
        words = ["run", "lift", "--json", "--rig", args.rig, "--pace", args.pace]
        words += ["--object", goal.object or args.object, "--runs", str(args.runs)]
        words += ["--profile", goal.profile or args.profile, "--seed", str(seed)]
        words += ["--detector", args.detector] if args.detector else []
        words += [word for file in args.config or () for word in ("--config", str(file))]
        words += [word for text in args.set for word in ("--set", text)]
        return words + (["--confirm-motion"] if self.permit is not None else [])

    def _load(self, goal: Goal) -> Any:
        args = self._args
        return load_config(
            goal.object or str(args.object), args.rig, args.detector, args.config, args.set,
            goal.profile or args.profile,
        )  # fmt: skip
