"""The lifts that a ROS 2 node may start, and their command lines."""

import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from drivers.errors import ConfigError, UsageError
from drivers.interfaces import FINGER_NAMES
from grasp.cli.child import Child
from grasp.cli.commands import RosOptions
from grasp.cli.detector import check_weights
from grasp.cli.lab import motion_permit
from grasp.cli.output import JsonObject
from grasp.settings import is_path, names
from scenarios.campaign.config import RunConfig, load_lift
from scenarios.rigs.calibration import calibration, config_files
from scenarios.rigs.permission import check_devices
from scenarios.trial.execution import make_guard


class Goal(NamedTuple):
    """What a client may choose of a lift; empty: as on the node's command line."""

    object: str = ""
    profile: str = ""


class ClientResult(NamedTuple):
    """Result of a lift for its client; NaN: unknown."""

    success: bool
    verdict: str
    message: str
    slip_distance_m: float
    peak_force_n: tuple[float, ...]  # A, B, C

    @classmethod
    def of(cls, printed: JsonObject) -> "ClientResult":
        """Of what `grasp run lift --json` printed."""
        error = printed.get("error") or {}
        result = (printed.get("result") or {}) if error else printed
        forces = result.get("peak_force_n") or result.get("peak_estimated_n") or {}
        slipped_m = result.get("slip_distance_m")
        return cls(
            result.get("success") is True,
            str(result.get("outcome") or error.get("kind")),
            " ".join(filter(None, (error.get("message"), error.get("remedy")))),
            math.nan if slipped_m is None else slipped_m,
            tuple(float(forces.get(name, math.nan)) for name in FINGER_NAMES),
        )


class Slot:
    """The one command that a node runs at a time. A stop reaches one that is starting, too."""

    def __init__(self) -> None:
        self.busy = threading.Lock()
        self.stopping = False  # since a lift was accepted
        self._child: Child | None = None

    @contextmanager
    def taken(self) -> Iterator[bool]:
        """Hold the slot; False if it is taken. Stops what an exception left running."""
        free = self.busy.acquire(blocking=False)
        try:
            yield free
        finally:
            if free:
                if self._child is not None:
                    self._child.stop()
                self._child = None
                self.busy.release()

    def start(self, words: Sequence[str], lift: bool = False) -> Child:
        """Start a command; a lift that was told to stop before its process existed stops now."""
        self._child = child = Child(words, feeds=lift)
        if lift and self.stopping:
            child.stop()
        return child

    def stop(self) -> bool:
        """Stop what runs or starts; returns whether anything runs."""
        self.stopping = True
        if (child := self._child) is not None:
            child.stop()
        return self.busy.locked()


class Lifts:
    """The lifts that this node may start: settings and permission of its own command line."""

    def __init__(self, args: RosOptions) -> None:
        """Raises ConfigError and UsageError as `grasp run lift` would."""
        self._args, self._started = args, 0
        if args.pace == "max" and args.rig == "emulated":
            raise UsageError("--pace max is of the rig simulated", "--rig simulated")
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
    def stop_without_client(self) -> bool:
        """Whether a lift stops once its client is gone."""
        return self._args.stop_without_client

    @property
    def m_per_count(self) -> float:
        """Fingertip travel of a motor count, m."""
        return calibration(self._config).m_per_count

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
        words += ["--runs", str(args.runs)]
        words += ["--object", name] if (name := goal.object or args.object) else []
        words += ["--profile", goal.profile or args.profile, "--seed", str(seed)]
        words += ["--detector", args.detector] if args.detector else []
        words += [word for file in args.config or () for word in ("--config", str(file))]
        words += [word for text in args.set for word in ("--set", text)]
        return words + (["--confirm-motion", "--unattended"] if self.permit is not None else [])

    def _load(self, goal: Goal) -> RunConfig:
        args = self._args
        for file in (*config_files(args.config), *map(Path, filter(is_path, [args.rig]))):
            if file.exists() and not file.is_file():  # reading a pipe may never end
                raise ConfigError(str(file), "-", "is no regular file", "one that stays readable")
        return load_lift(
            goal.object or args.object, args.rig, args.detector, args.config, args.set,
            goal.profile or args.profile,
        )  # fmt: skip
