"""What a campaign file says, and the trials that it stands for."""

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
from drivers.interfaces import FINGERS
from grasp.settings import is_path, load, read_toml
from scenarios.campaign.config import EXPERIMENTS, RunConfig, load_config
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_guard
from scenarios.world.objects import Name

MOST_TRIALS = 1_000_000
SEEDS_APART = 10_000  # so the seeds of two campaigns with different `seeds` never meet


Listed = Annotated[tuple[str, ...], Meta(min_length=1)]
Seed = Annotated[int, Meta(ge=0, lt=100)]


class CampaignSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A grid: every combination of what is listed, each so many times. Empty: as the profile.
    Paths are relative to the campaign's file."""

    name: Name
    scenarios: Annotated[tuple[Literal["lift", "tap"], ...], Meta(min_length=1)] = ("lift",)
    objects: Listed  # of config/objects, or paths
    profiles: Listed = ("default",)
    detectors: tuple[str, ...] = ()  # of config/detectors, or FILE.py:NAME, or FILE.onnx
    sweep: dict[str, tuple[Any, ...]] = {}  # settings, section.key = [values]
    config: tuple[str, ...] = ()  # TOML files for every trial; later ones on top
    settings: tuple[str, ...] = ()  # section.key=value, for every trial
    seeds: Annotated[tuple[Seed, ...], Meta(min_length=1)] = (0,)  # times SEEDS_APART
    repetitions: Annotated[int, Meta(ge=1, le=SEEDS_APART)] = 20  # of every combination (paper: 20)
    recordings: Literal["failures", "all", "none"] = "failures"


class Task(msgspec.Struct, frozen=True):
    """One trial of a campaign: everything that decides its outcome."""

    number: int  # place in the grid, from 0
    scenario: str
    repetition: int
    seed: int
    swept: dict[str, Any]  # settings that differ between the combinations
    config: TrialConfig
    recordings: str


class Combination(msgspec.Struct, frozen=True):
    """One place of the grid, settings resolved."""

    scenario: str
    swept: dict[str, Any]
    config: TrialConfig


def read_spec(path: Path) -> CampaignSpec:
    """Raises ConfigError for a file that is missing, malformed or says something unknown."""
    spec = load(CampaignSpec, [read_toml(path)])

    def found(word: str) -> str:
        own = is_path(word) or is_plugin_file(word) or is_weights(word)
        return str(path.parent / word) if own else word

    return msgspec.structs.replace(
        spec,
        objects=tuple(map(found, spec.objects)),
        detectors=tuple(map(found, spec.detectors)),
        config=tuple(str(path.parent / word) for word in spec.config),
    )


def combinations(spec: CampaignSpec) -> list[Combination]:
    """Every combination once, checked as far as can be without running it.

    Raises ConfigError for an axis that is empty or says something twice, an unknown name, a
    setting out of range, a force limit that the gripper cannot keep, or a detector that cannot be
    loaded.
    """
    _check_axes(spec)
    found, called = [], dict[str, str]()
    files = [Path(word) for word in spec.config]
    for scenario, profile, detector, name, *values in itertools.product(
        spec.scenarios, spec.profiles, spec.detectors or (None,), spec.objects, *spec.sweep.values()
    ):
        swept = dict(zip(spec.sweep, values, strict=True))
        words = [*spec.settings, *(f"{key}={_literal(value)}" for key, value in swept.items())]
        base = _load(name, detector, files, words, profile, swept)
        if called.setdefault(base.object.name, name) != name:
            both = f"{called[base.object.name]} and {name} are both called {base.object.name!r}"
            raise ConfigError("campaign", "objects", both, "an object.name of its own for each")
        make_guard(base)
        experiment = EXPERIMENTS[scenario]
        own: TrialConfig = experiment.own(base)
        experiment.configure(own)
        found.append(Combination(scenario, swept, own))
    _check_detectors([each.config for each in found])
    return found


def _load(
    name: str, detector: str | None, files: list[Path], words: list[str], profile: str,
    swept: dict[str, Any],
) -> RunConfig:  # fmt: skip
    """A place's settings. Raises ConfigError, which names the campaign where a word is its own."""
    try:
        return load_config(name, "simulated", detector, files, words, profile)
    except ConfigError as error:
        file, key, problem, allowed = error.args
        if file != "--set":
            raise
        at = f" (at {', '.join(f'{k} = {_literal(v)}' for k, v in swept.items())})" if swept else ""
        raise ConfigError("campaign", key, f"{problem}{at}", allowed) from None


def _check_axes(spec: CampaignSpec) -> None:
    """Nothing is run twice and counted twice, and a sweep sweeps."""
    named = ("scenarios", "objects", "profiles", "detectors", "seeds")
    axes = {name: getattr(spec, name) for name in named}
    axes |= {f"sweep.{key}": values for key, values in spec.sweep.items()}
    if math.prod(len(values) or 1 for values in axes.values()) * spec.repetitions > MOST_TRIALS:
        raise ConfigError("campaign", "-", "is too large", f"{MOST_TRIALS} trials")
    for axis, values in axes.items():
        for text, times in Counter(map(_literal, values)).items():
            if times > 1:
                raise ConfigError("campaign", axis, f"{text} twice", "each value once")
        if not values and axis.startswith("sweep."):
            raise ConfigError("campaign", axis, "is empty", "one value or more")


def _check_detectors(configs: Sequence[TrialConfig]) -> None:
    """Load each detector once: weights that are missing are found before anything runs."""
    for config in {config.detector_name: config for config in configs}.values():
        try:
            config.make_detector(FINGERS)
        except (OSError, GraspError) as error:
            raise ConfigError(
                "campaign", f"detector {config.detector_name!r}", str(error),
                "one that can be loaded; name it with detectors = [...]",
            ) from None  # fmt: skip


def _literal(value: Any) -> str:
    """A value as `--set` reads it."""
    return msgspec.json.encode(value).decode()


def trials(spec: CampaignSpec, places: list[Combination]) -> Iterator[Task]:
    """All trials. Repetitions are outermost: a campaign that was cut short has run every
    combination about equally often, on the same seeds."""
    numbers = itertools.count()
    for seed, repetition in itertools.product(spec.seeds, range(spec.repetitions)):
        for place in places:
            yield Task(
                number=next(numbers), scenario=place.scenario, repetition=repetition,
                seed=seed * SEEDS_APART + repetition, swept=place.swept, config=place.config,
                recordings=spec.recordings,
            )  # fmt: skip
