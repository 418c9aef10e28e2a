"""Specification of a campaign, and the trials of its grid."""

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from detector.network_file import is_weights
from detector.plugins import is_plugin_file
from drivers.errors import ConfigError, GraspError
from grasp.settings import is_path, load, read_toml
from scenarios.campaign.config import RunConfig, load_config
from scenarios.campaign.experiments import EXPERIMENTS
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard
from scenarios.world.objects import Name

MOST_TRIALS = 1_000_000
SEEDS_APART = 10_000  # so that campaigns with different `seeds` share no trial seed
# A trial of a campaign ends when nothing that is scored can still change, with the object in the
# air. A set-down takes as long as all before it, so only every tenth trial includes it.
IN_THE_AIR = "controller.keep=true"  # overridden by the campaign's own settings
SET_DOWN_EVERY = 10


Listed = Annotated[tuple[str, ...], Meta(min_length=1)]
Seed = Annotated[int, Meta(ge=0, lt=100)]


class CampaignSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A grid of trials: every combination of the lists, each ``repetitions`` times.

    Empty ``detectors``: the profile's. Paths are relative to the campaign's file."""

    name: Name
    scenarios: Annotated[tuple[Literal["lift", "tap"], ...], Meta(min_length=1)] = ("lift",)
    objects: Listed  # names in config/objects, or paths
    profiles: Listed = ("default",)
    detectors: tuple[str, ...] = ()  # names in config/detectors, FILE.py:NAME or FILE.onnx
    sweep: dict[str, tuple[Any, ...]] = {}  # settings, section.key = [values]
    config: tuple[str, ...] = ()  # TOML files for every trial; later ones override earlier ones
    settings: tuple[str, ...] = ()  # section.key=value, for every trial
    seeds: Annotated[tuple[Seed, ...], Meta(min_length=1)] = (0,)  # times SEEDS_APART
    repetitions: Annotated[int, Meta(ge=1, le=SEEDS_APART)] = 20  # of every combination (paper: 20)
    recordings: Literal["failures", "all", "none"] = "failures"


class Task(msgspec.Struct, frozen=True):
    """One trial of a campaign, with everything that determines its result."""

    number: int  # in the order of execution, from 0
    scenario: str
    repetition: int
    seed: int
    swept: dict[str, Any]  # settings that differ between the combinations
    config: TrialConfig  # of its combination
    recordings: str
    set_down: bool  # whether it also sets the object down

    @property
    def run_config(self) -> TrialConfig:
        """The settings with which it is run."""
        controller = msgspec.structs.replace(self.config.controller, keep=not self.set_down)
        return msgspec.structs.replace(self.config, controller=controller)


class Combination(msgspec.Struct, frozen=True):
    """One combination of the grid, with resolved settings."""

    scenario: str
    swept: dict[str, Any]
    config: TrialConfig


def read_spec(path: Path) -> CampaignSpec:
    """Read a campaign file. Raises ConfigError for a missing or malformed file or unknown keys."""
    spec = load(CampaignSpec, [read_toml(path)])

    def resolved(name: str) -> str:
        user_file = is_path(name) or is_plugin_file(name) or is_weights(name)
        return str(path.parent / name) if user_file else name

    return msgspec.structs.replace(
        spec,
        objects=tuple(map(resolved, spec.objects)),
        detectors=tuple(map(resolved, spec.detectors)),
        config=tuple(str(path.parent / name) for name in spec.config),
    )


def combinations(spec: CampaignSpec) -> list[Combination]:
    """Every combination once, checked as far as possible without running it.

    Raises ConfigError for an empty axis or a repeated value, an unknown name, a setting out of
    range, a force limit that the gripper cannot keep, or a detector that cannot be loaded.
    """
    _check_axes(spec)
    found, sources = [], dict[str, str]()
    files = [Path(name) for name in spec.config]
    for scenario, profile, detector, name, *values in itertools.product(
        spec.scenarios, spec.profiles, spec.detectors or (None,), spec.objects, *spec.sweep.values()
    ):
        swept = dict(zip(spec.sweep, values, strict=True))
        settings = [IN_THE_AIR, *spec.settings]
        settings += [f"{key}={_literal(x)}" for key, x in swept.items()]
        base = _load(name, detector, files, settings, profile, swept)
        if sources.setdefault(base.object.name, name) != name:
            both = f"{sources[base.object.name]} and {name} are both named {base.object.name!r}"
            raise ConfigError("campaign", "objects", both, "a different object.name for each")
        make_guard(base)
        experiment = EXPERIMENTS[scenario]
        config: TrialConfig = experiment.select(base)
        experiment.configure(config)
        found.append(Combination(scenario, swept, config))
    _check_detectors([each.config for each in found])
    return found


def _load(
    name: str, detector: str | None, files: list[Path], settings: list[str], profile: str,
    swept: dict[str, Any],
) -> RunConfig:  # fmt: skip
    """Settings of a combination. Raises ConfigError, with the campaign as the source of a value
    that its file sets."""
    try:
        return load_config(name, "simulated", detector, files, settings, profile)
    except ConfigError as error:
        file, key, problem, allowed = error.args
        if file != "--set":
            raise
        at = f" (at {', '.join(f'{k} = {_literal(v)}' for k, v in swept.items())})" if swept else ""
        raise ConfigError("campaign", key, f"{problem}{at}", allowed) from None


def _check_axes(spec: CampaignSpec) -> None:
    """Raises ConfigError for a repeated value, an empty sweep or too many trials."""
    lists = ("scenarios", "objects", "profiles", "detectors", "seeds")
    axes = {name: getattr(spec, name) for name in lists}
    axes |= {f"sweep.{key}": values for key, values in spec.sweep.items()}
    if math.prod(len(values) or 1 for values in axes.values()) * spec.repetitions > MOST_TRIALS:
        raise ConfigError("campaign", "-", "is too large", f"at most {MOST_TRIALS} trials")
    for axis, values in axes.items():
        for text, times in Counter(map(_literal, values)).items():
            if times > 1:
                raise ConfigError("campaign", axis, f"{text} twice", "each value once")
        if not values and axis.startswith("sweep."):
            raise ConfigError("campaign", axis, "is empty", "one value or more")


def _check_detectors(configs: Sequence[TrialConfig]) -> None:
    """Read each detector once, so that missing weights are found before anything runs."""
    for config in {config.detector_name: config for config in configs}.values():
        try:
            _ = config.memory_s
        except (OSError, GraspError) as error:
            raise ConfigError(
                "campaign", f"detector {config.detector_name!r}", str(error),
                "one that can be loaded; name it with detectors = [...]",
            ) from None  # fmt: skip


def _literal(value: Any) -> str:
    """A value as `--set` reads it."""
    return msgspec.json.encode(value).decode()


def trials(spec: CampaignSpec, grid: list[Combination]) -> Iterator[Task]:
    """All trials, with repetitions outermost: a campaign that was cut short has run every
    combination about equally often, with the same seeds. In ten repetitions each combination sets
    the object down once."""
    numbers = itertools.count()
    for seed, repetition in itertools.product(spec.seeds, range(spec.repetitions)):
        for place, each in enumerate(grid, start=1):
            sampled = (place + repetition) % SET_DOWN_EVERY == 0
            yield Task(
                number=next(numbers), scenario=each.scenario, repetition=repetition,
                seed=seed * SEEDS_APART + repetition, swept=each.swept, config=each.config,
                recordings=spec.recordings, set_down=sampled or not each.config.controller.keep,
            )  # fmt: skip
