"""Which recordings a data set has: a pure function of its TOML file.

A recording's seed lies in the block of its split, so that nothing random of one split (textures,
objects, noise) comes again in another, whatever the set's size.
"""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
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
from grasp.settings import Layer, is_path, item_layer, load, named_layer, read_toml
from scenarios.acquire.config import (
    AcquireConfig,
    layout_file,
    load_acquire_config,
    with_values,
)
from scenarios.acquire.datasets import drawn_objects
from scenarios.acquire.datasets.causes import GRASPED, FixedCause, GraspedCause, bare_config
from scenarios.acquire.datasets.disturbances import Disturbances
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
Share = Annotated[float, Meta(gt=0.0, le=1.0)]  # of the recordings, in proportion to the others
Number = Annotated[int, Meta(ge=0, le=10_000_000)]


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
    share: Share
    randomise: dict[str, Range] = {}
    on: dict[str, dict[str, Range]] = {}  # of one surface

    def __post_init__(self) -> None:
        _check_ranges(self.randomise, *self.on.values())

    def ranges(self, surface: str) -> dict[str, Range]:
        return self.randomise | self.on.get(surface, {})


class CauseRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Recordings in which something shakes or moves what is touched: see ``causes``."""

    cause: FixedCause | GraspedCause
    on: Annotated[list[str], Meta(min_length=1)]  # surfaces, or bodies (config/bodies) of a grasp
    share: Share
    seconds: Annotated[float, Meta(ge=1.0, le=600.0)]
    strokes: bool = False
    load: Range | None = None  # weight over the first grip's friction; none: held firmly
    acts: Disturbances | None = None
    randomise: dict[str, Range] = {}

    def __post_init__(self) -> None:
        _check_ranges(self.randomise)
        if self.load is not None and not 0.0 < self.load[0] <= self.load[1]:
            raise ValueError(f"load: {self.load[0]:g} to {self.load[1]:g} is no range above 0")
        firm = self.acts is not None and self.acts.firm
        if not self.grasped and (self.load is not None or self.acts is not None):
            raise ValueError(f"{self.cause}: nothing is held, so it has neither load nor acts")
        if self.grasped and firm == (self.load is not None):
            raise ValueError(f"{self.cause}: either a load for its first grip, or firm acts")

    @property
    def grasped(self) -> bool:
        return self.cause in GRASPED


class DatasetConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A data set's TOML file: rows of Table I, or causes, or both. Surfaces, layout and bodies are
    named, or are files by their paths."""

    name: Name
    seed: Annotated[int, Meta(ge=1, lt=2**31)]
    layout: str = ""  # of taxels; empty: the kit's
    static_samples: Number = 0
    slip_samples: Number = 0
    recording_samples: Annotated[int, Meta(ge=100, le=100_000)] = 1200
    least_recordings: Annotated[int, Meta(ge=3, le=1000)] = 10
    held_out: Annotated[float, Meta(gt=0.0, le=0.4)] = 0.1  # for validation, and as much for test
    rows: list[DatasetRow] = []
    parts: list[Part] = []  # their shares are taken in proportion
    causes: list[CauseRow] = []
    recordings: Number = 0  # of the causes, each at least three
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
    slip: int  # of a cause, static and slip are not distinguished
    metadata: Metadata
    acts: Disturbances | None = None

    @property
    def samples(self) -> int:
        return self.static + self.slip


WHOLE = Part(name="whole", share=1.0)  # of a set that has no parts


class _Named(msgspec.Struct, frozen=True):
    name: Name


@cache
def called(kind: str, word: str) -> str:
    """The name of a surface or body; raises ConfigError for what is unknown or no such thing."""
    if not is_path(word):
        named_layer(kind, word)
        return word
    section = {"surfaces": "surface", "bodies": "body"}[kind]
    return load(_Named, [Layer(word, item_layer(kind, section, word).table[section])]).name


def beside(value: Any, folder: Path) -> Any:
    """A data set's settings, or a part of them, whose paths count from that folder."""
    if isinstance(value, dict):
        return {beside(key, folder): beside(each, folder) for key, each in value.items()}
    if isinstance(value, list):
        return [beside(each, folder) for each in value]
    return str(folder / value) if isinstance(value, str) and is_path(value) else value


def fingerprints(*words: str) -> dict[str, str]:
    """Of the files among them."""
    files = [word for word in words if is_path(word)]
    return {file: hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16] for file in files}


def load_dataset_config(path: Path) -> DatasetConfig:
    """Raises ConfigError for a file that is missing or not allowed, or names what is unknown."""
    layer = read_toml(path)
    settings = msgspec.structs.replace(layer, table=beside(layer.table, path.parent))
    config = load(DatasetConfig, [settings])
    surfaces = [*config.on, *(word for part in config.parts for word in part.on)]
    surfaces += [word for row in config.rows for word in row.percent]
    for cause in config.causes:
        for word in cause.on if cause.grasped else ():
            called("bodies", word)
        surfaces += [] if cause.grasped else cause.on
    for word in surfaces:
        called("surfaces", word)
    pressing("planar", config.layout)
    if any(cause.grasped for cause in config.causes):
        bare_config(config.layout)
    if not config.causes and not any(sum(row.percent.values()) for row in config.rows):
        raise ConfigError(str(path), "rows", "there is nothing to record", "percent above 0")
    return config


def reduced(config: DatasetConfig, share: float) -> DatasetConfig:
    """The same distribution with fewer samples and recordings; of any samples at least one."""

    def some(samples: int) -> int:
        return min(samples, max(1, round(samples * share)))

    return msgspec.structs.replace(
        config,
        static_samples=some(config.static_samples),
        slip_samples=some(config.slip_samples),
        least_recordings=max(3, round(config.least_recordings * share)),
        recordings=round(config.recordings * share),
    )


def plan(config: DatasetConfig) -> list[Job]:
    """All recordings; split by recording within each cause or group of Table I."""
    jobs = list(_slide_jobs(config)) if config.rows else []
    return jobs + list(_cause_jobs(config, len(jobs)))


def _cause_jobs(config: DatasetConfig, index: int) -> Iterator[Job]:
    counts = apportion(config.recordings, np.array([row.share for row in config.causes]))
    for row, count in zip(config.causes, counts, strict=True):
        rng = np.random.default_rng([config.seed, index])
        splits = _splits(max(LEAST_RECORDINGS, count), config.held_out, rng)
        for k, split in enumerate(splits):
            course = motion(DIRECTIONS["primary"][k % 4], 0.05, 1.0) if row.strokes else None
            word = row.on[k % len(row.on)]
            name = called("bodies" if row.grasped else "surfaces", word)
            metadata = _metadata(config, split, index, name, word, course, row)
            samples = round(row.seconds / PERIOD_S)
            path = f"{row.cause}/{k:03d}-{name}{SUFFIX}"
            yield Job(path, word, course, samples, 0, metadata, row.acts)
            index += 1


def _slide_jobs(config: DatasetConfig) -> Iterator[Job]:
    groups = [(row, word, share) for row in config.rows for word, share in row.percent.items()]
    shares = np.array([share for _, _, share in groups])
    slips = apportion(config.slip_samples, shares)
    statics = apportion(config.static_samples, shares)
    index = 0
    for (row, word, share), slip, static in zip(groups, slips, statics, strict=True):
        if share == 0.0:
            continue
        surface = called("surfaces", word)
        count = max(config.least_recordings, round((slip + static) / config.recording_samples))
        rng = np.random.default_rng([config.seed, index])
        parts = zip(
            apportion(slip, np.ones(count)), apportion(static, np.ones(count)),
            _splits(count, config.held_out, rng), strict=True,
        )  # fmt: skip
        for k, (slip_part, static_part, split) in enumerate(parts):
            directions = DIRECTIONS[row.motion]
            course = motion(directions[k % len(directions)], row.speed, row.speed)
            metadata = _metadata(config, split, index, surface, word, course, None)
            path = f"{surface}/{row.motion}-{row.speed:g}-{k:02d}-{course.direction}{SUFFIX}"
            yield Job(path, word, course, static_part, slip_part, metadata)
            index += 1


def _metadata(
    config: DatasetConfig, split: Split, index: int, name: str, word: str,
    course: StrokeMotion | None, row: CauseRow | None,
) -> Metadata:  # fmt: skip
    """Of the index-th recording, on what is called so, of a cause or (none) of Table I."""
    seed = config.seed * SEEDS + BLOCKS[split] + index
    part = part_of_job(config.parts, index)
    ranges = config.randomise | config.on.get(word, {}) | part.ranges(word)
    ranges |= row.randomise if row is not None else {}
    grasped = row is not None and row.grasped
    return Metadata(
        set="disturbances" if row is not None else "slide", split=split, surface=name,
        cause=row.cause if row is not None else "",
        motion=course.kind if course else "none",
        speed_mps=course.speed_mps if course else 0.0,
        spin_radps=course.spin_radps if course else 0.0,
        direction=course.direction if course else "",
        seed=seed, commit=_commit(), layout=config.layout, part=part.name if config.parts else "",
        parameters=drawn(ranges, seed) if grasped
        else drawn_on(pressing(word, config.layout), ranges, seed),
        object=_object(row, word, seed) if row is not None and grasped else {},
        files=fingerprints(word, config.layout),
    )  # fmt: skip


@cache
def _commit() -> str:
    return versions()["commit"]


def _object(row: CauseRow, word: str, seed: int) -> dict[str, Any]:
    """What is held, drawn far from the objects of the experiments; its settings by their names."""
    config = bare_config("")
    body = drawn_objects.draw_object(
        drawn_objects.body_ranges(word), row.load, config.contact, config.hand.m_per_count,
        sum(config.guard.full_grip_n), np.random.default_rng([seed, 4]),
    )  # fmt: skip
    return {key: value for key, value in msgspec.to_builtins(body).items() if value is not None}


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
    """Of a grasp, one value a setting, evenly between its bounds."""
    held = {key: bounds for key, bounds in ranges.items() if not key.startswith(PRESSED)}
    return _draw(held, np.random.default_rng([seed, 2]))


def drawn_on(config: AcquireConfig, ranges: Mapping[str, Range], seed: int) -> dict[str, float]:
    """The same for a pressed fingertip, drawn again while its surface is too near an object of the
    experiments."""
    rng = np.random.default_rng([seed, 2])
    for _ in range(MOST_DRAWS):
        values = _draw(ranges, rng)
        if drawn_objects.far(drawn_objects.of_surface(with_values(config, values).surface)):
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
