"""Which recordings a data set has: a pure function of its TOML file.

A recording's seed lies in the block of its split, so that nothing random of one split (textures,
objects, noise) comes again in another, whatever the set's size.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.recordings import SUFFIX, Metadata, Split
from drivers.errors import ConfigError
from drivers.interfaces import PERIOD_S
from grasp.settings import load, read_toml
from scenarios.acquire.config import AcquireConfig, load_acquire_config
from scenarios.acquire.datasets import bodies
from scenarios.acquire.datasets.acts import Acts
from scenarios.acquire.datasets.draws import layout_file, with_values
from scenarios.acquire.datasets.grasped import GRASPED, GraspedCause, bare_config
from scenarios.acquire.datasets.own import beside, called, check, fingerprints
from scenarios.acquire.datasets.pressed import FixedCause
from scenarios.acquire.press import TURNS, StrokeMotion, motion
from scenarios.trial.result import versions
from scenarios.world.objects import Name

DIRECTIONS = {
    "primary": ("0", "90", "180", "270"),
    "oblique": ("45", "135", "225", "315"),
    "rotation": tuple(TURNS),
}
SEEDS = 1_000_000  # seeds of one data set; those of trials are below
BLOCKS: dict[Split, int] = {"train": 0, "validation": 400_000, "test": 700_000}
MOST_DRAWS = 1000
LEAST_RECORDINGS = 3  # of a cause: one a split
PRESSED = ("surface.", "press.", "control.", "sampling.")  # what a grasp knows nothing of
Range = tuple[float, float]


class DatasetRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One row of Table I: percent of the samples a surface. Speed in m/s, of a rotation rad/s."""

    motion: Literal["primary", "oblique", "rotation"]
    speed: Annotated[float, Meta(gt=0.0, le=2.0)]
    percent: dict[str, Annotated[float, Meta(ge=0.0, le=100.0)]]


def _check_ranges(*tables: Mapping[str, Range]) -> None:
    """Raises ValueError for a range the wrong way round, and for what is held: it keeps its
    distance from the objects of the experiments as config/bodies draws it, and no other way."""
    for key, (low, high) in ((key, bounds) for table in tables for key, bounds in table.items()):
        if low > high:
            raise ValueError(f"{key}: {low:g} is above {high:g}")
        if key.startswith("object."):
            raise ValueError(f"{key}: what is held is drawn by config/bodies")


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Some of the recordings, with ranges of their own over those that all share."""

    name: Name
    share: Annotated[float, Meta(gt=0.0, le=1.0)]  # of the recordings
    randomise: dict[str, Range] = {}
    on: dict[str, dict[str, Range]] = {}  # of one surface

    def __post_init__(self) -> None:
        _check_ranges(self.randomise, *self.on.values())

    def ranges(self, surface: str) -> dict[str, Range]:
        return self.randomise | self.on.get(surface, {})


class CauseRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Recordings in which something shakes or moves what is touched: ``pressed``, ``grasped``."""

    cause: FixedCause | GraspedCause
    on: Annotated[list[str], Meta(min_length=1)]  # surfaces, or bodies (config/bodies) of a grasp
    share: Annotated[float, Meta(gt=0.0, le=1.0)]  # of the recordings, in proportion to the others
    seconds: Annotated[float, Meta(ge=1.0, le=600.0)]
    strokes: bool = False
    load: Range | None = (
        None  # weight, of what the first grip's friction carries; none: held firmly
    )
    acts: Acts | None = None
    randomise: dict[str, Range] = {}

    def __post_init__(self) -> None:
        _check_ranges(self.randomise)
        if self.load is not None and not 0.0 < self.load[0] <= self.load[1]:
            raise ValueError(f"load: {self.load[0]:g} to {self.load[1]:g} is no range above 0")
        firm = self.acts is not None and self.acts.firm
        if self.cause not in GRASPED and (self.load is not None or self.acts is not None):
            raise ValueError(f"{self.cause}: nothing is held, so it has neither load nor acts")
        if self.cause in GRASPED and firm == (self.load is not None):
            raise ValueError(f"{self.cause}: either a load for its first grip, or firm acts")


class DatasetConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A data set's TOML file: rows of Table I, or causes, or both. Surfaces, layout and bodies are
    named, or are files of one's own by their paths."""

    name: Name
    seed: Annotated[int, Meta(ge=1, lt=2**31)]
    layout: str = ""  # of taxels; empty: the kit's
    static_samples: Annotated[int, Meta(ge=0, le=10_000_000)] = 0
    slip_samples: Annotated[int, Meta(ge=0, le=10_000_000)] = 0
    recording_samples: Annotated[int, Meta(ge=100, le=100_000)] = 1200
    least_recordings: Annotated[int, Meta(ge=3, le=1000)] = 10
    held_out: Annotated[float, Meta(gt=0.0, le=0.4)] = 0.1  # for validation, and as much for test
    rows: list[DatasetRow] = []
    parts: list[Part] = []  # their shares are taken in proportion
    causes: list[CauseRow] = []
    recordings: Annotated[int, Meta(ge=0, le=100_000)] = 0  # of the causes, each at least three
    randomise: dict[str, Range] = {}
    on: dict[str, dict[str, Range]] = {}  # of one surface

    def __post_init__(self) -> None:
        _check_ranges(self.randomise, *self.on.values())


class Job(msgspec.Struct, frozen=True):
    """One recording to be made."""

    path: str  # in the data set's folder
    surface: str  # its name or path, or that of what is held
    motion: StrokeMotion | None  # None: no strokes
    static: int
    slip: int  # of a cause, static and slip are not told apart
    metadata: Metadata
    acts: Acts | None = None

    @property
    def samples(self) -> int:
        return self.static + self.slip


WHOLE = Part(name="whole", share=1.0)  # of a set that has no parts


def load_dataset_config(path: Path) -> DatasetConfig:
    """Raises ConfigError for a file that is missing or not allowed, or names what is unknown; of
    its own files too, and where two of them give one name."""
    config: DatasetConfig = beside(load(DatasetConfig, [read_toml(path)]), path.parent)
    pressed = [word for row in config.rows for word in row.percent]
    pressed += [*config.on, *(word for part in config.parts for word in part.on)]
    for cause in config.causes:
        if cause.cause not in GRASPED:
            pressed += cause.on
    held = [word for cause in config.causes if cause.cause in GRASPED for word in cause.on]
    check(pressed, held)
    pressing("planar", config.layout)
    if held:
        bare_config(config.layout)
    if not config.causes and not any(sum(row.percent.values()) for row in config.rows):
        raise ConfigError(str(path), "rows", "there is nothing to record", "percent above 0")
    return config


def _some(samples: int, share: float) -> int:
    """Of none none, of any at least one."""
    return min(samples, max(1, round(samples * share)))


def reduced(config: DatasetConfig, share: float) -> DatasetConfig:
    """The same distribution with fewer samples and recordings."""
    return msgspec.structs.replace(
        config,
        static_samples=_some(config.static_samples, share),
        slip_samples=_some(config.slip_samples, share),
        least_recordings=max(3, round(config.least_recordings * share)),
        recordings=round(config.recordings * share),
    )


def plan(config: DatasetConfig) -> list[Job]:
    """All recordings; split by recording within each cause or group of Table I."""
    jobs = _slide_jobs(config) if config.rows else []
    return jobs + _cause_jobs(config, len(jobs))


def _cause_jobs(config: DatasetConfig, first: int) -> list[Job]:
    jobs: list[Job] = []
    commit = versions()["commit"]
    counts = apportion(config.recordings, np.array([row.share for row in config.causes]))
    for row, count in zip(config.causes, counts, strict=True):
        index = first + len(jobs)
        rng = np.random.default_rng([config.seed, index])
        splits = _splits(max(LEAST_RECORDINGS, count), config.held_out, rng)
        for k, split in enumerate(splits):
            seed = _seed(config, split, first + len(jobs))
            course = motion(DIRECTIONS["primary"][k % 4], 0.05, 1.0) if row.strokes else None
            word = row.on[k % len(row.on)]
            name = called("bodies" if row.cause in GRASPED else "surfaces", word)
            part = part_of_job(config.parts, first + len(jobs))
            metadata = Metadata(
                set="confusers", split=split, surface=name, cause=row.cause,
                motion=course.kind if course else "none",
                speed_mps=course.speed_mps if course else 0.0, spin_radps=0.0,
                direction=course.direction if course else "", seed=seed, commit=commit,
                layout=config.layout,
                part=part.name if config.parts else "",
                parameters=_parameters(config, row, part, word, seed),
                object=_object(row, word, seed) if row.cause in GRASPED else {},
                files=fingerprints(word, config.layout),
            )  # fmt: skip
            path = f"{row.cause}/{k:03d}-{name}{SUFFIX}"
            samples = round(row.seconds / PERIOD_S)
            jobs.append(Job(path, word, course, samples, 0, metadata, row.acts))
    return jobs


def _seed(config: DatasetConfig, split: Split, index: int) -> int:
    return config.seed * SEEDS + BLOCKS[split] + index


def _parameters(
    config: DatasetConfig, row: CauseRow, part: Part, word: str, seed: int
) -> dict[str, float]:
    ranges = config.randomise | config.on.get(word, {}) | part.ranges(word) | row.randomise
    if row.cause in GRASPED:
        held = {key: bounds for key, bounds in ranges.items() if not key.startswith(PRESSED)}
        return drawn(held, seed)
    return drawn_on(pressing(word, config.layout), ranges, seed)


def _object(row: CauseRow, word: str, seed: int) -> dict[str, Any]:
    """What is held, drawn far from the objects of the experiments; its settings by their names."""
    config = bare_config("")
    body = bodies.draw_object(
        bodies.body_ranges(word), row.load, config.contact, config.hand.m_per_count,
        sum(config.guard.full_grip_n), np.random.default_rng([seed, 4]),
    )  # fmt: skip
    return {key: value for key, value in msgspec.to_builtins(body).items() if value is not None}


def _slide_jobs(config: DatasetConfig) -> list[Job]:
    groups = [(row, name, share) for row in config.rows for name, share in row.percent.items()]
    shares = np.array([share for _, _, share in groups])
    slips = apportion(config.slip_samples, shares)
    statics = apportion(config.static_samples, shares)
    jobs: list[Job] = []
    commit = versions()["commit"]
    for (row, word, share), slip, static in zip(groups, slips, statics, strict=True):
        if share == 0.0:
            continue
        surface = called("surfaces", word)
        wanted = round((slip + static) / config.recording_samples)
        count = max(config.least_recordings, wanted)
        parts = zip(
            apportion(slip, np.ones(count)), apportion(static, np.ones(count)),
            _splits(count, config.held_out, np.random.default_rng([config.seed, len(jobs)])),
            strict=True,
        )  # fmt: skip
        for k, (slip_part, static_part, split) in enumerate(parts):
            directions = DIRECTIONS[row.motion]
            course = motion(directions[k % len(directions)], row.speed, row.speed)
            seed = _seed(config, split, len(jobs))
            part = part_of_job(config.parts, len(jobs))
            metadata = Metadata(
                set="slide", split=split, surface=surface, motion=row.motion,
                part=part.name if config.parts else "",
                speed_mps=course.speed_mps, spin_radps=course.spin_radps,
                direction=course.direction, seed=seed, commit=commit, layout=config.layout,
                parameters=drawn_on(
                    pressing(word, config.layout), config.randomise | part.ranges(word), seed
                ),
                files=fingerprints(word, config.layout),
            )  # fmt: skip
            name = f"{surface}/{row.motion}-{row.speed:g}-{k:02d}-{course.direction}{SUFFIX}"
            jobs.append(Job(name, word, course, static_part, slip_part, metadata))
    return jobs


def part_of_job(parts: Sequence[Part], index: int) -> Part:
    """The part of the index-th recording: as evenly mixed as the golden ratio does it."""
    at = (index * (math.sqrt(5.0) - 1.0) / 2.0) % 1.0 * sum(part.share for part in parts)
    for part in parts:
        at -= part.share
        if at < 0.0:
            return part
    return parts[-1] if parts else WHOLE


def apportion(total: int, shares: NDArray[np.float64]) -> list[int]:
    """Whole parts in these proportions that sum to the total: largest remainders."""
    exact = total * shares / shares.sum()
    parts = np.floor(exact).astype(int)
    order = np.argsort(parts - exact, kind="stable")
    parts[order[: total - parts.sum()]] += 1
    return [int(part) for part in parts]


def _splits(count: int, held_out: float, rng: np.random.Generator) -> list[Split]:
    """The rest is for training; at least one recording each, in random order."""
    part = max(1, round(held_out * count))
    sizes: dict[Split, int] = {"train": count - 2 * part, "validation": part, "test": part}
    ordered = [split for split, size in sizes.items() for _ in range(size)]
    return [ordered[i] for i in rng.permutation(count)]


def drawn(ranges: Mapping[str, Range], seed: int) -> dict[str, float]:
    """One value a setting, evenly between its bounds."""
    return _draw(ranges, np.random.default_rng([seed, 2]))


def drawn_on(config: AcquireConfig, ranges: Mapping[str, Range], seed: int) -> dict[str, float]:
    """The same for a pressed fingertip, drawn again while its surface is too near an object of the
    experiments."""
    rng = np.random.default_rng([seed, 2])
    for _ in range(MOST_DRAWS):
        values = _draw(ranges, rng)
        if bodies.far(bodies.of_surface(with_values(config, values).surface)):
            return values
    raise ConfigError(
        "randomise", "surface", "no surface far from the objects of the experiments was drawn",
        'wider ranges of "surface.friction_kinetic", "surface.texture_rms_m", "surface.radius_x_m"',
    )  # fmt: skip


def _draw(ranges: Mapping[str, Range], rng: np.random.Generator) -> dict[str, float]:
    return {key: float(rng.uniform(low, high)) for key, (low, high) in ranges.items()}


@cache
def pressing(surface: str, layout: str) -> AcquireConfig:
    """Settings of a session on that surface before anything is drawn."""
    return load_acquire_config(surface, "simulated", layout_file(layout))


def first_of_each(jobs: Sequence[Job], share: float) -> list[Job]:
    """So many of the recordings of every cause, the first in the plan."""
    found: list[Job] = []
    for cause in dict.fromkeys(job.metadata.cause for job in jobs):
        its = [job for job in jobs if job.metadata.cause == cause]
        found += its[: math.ceil(share * len(its))]
    return found
