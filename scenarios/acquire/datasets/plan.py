"""Plan of the recordings of a data set: a pure function of its TOML file.

Each split has its own range of seeds, so no texture, object or noise occurs in two splits,
whatever the size of the set.
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
from grasp.settings import Layer, file_of, is_path, item_layer, load, named_layer, read_toml
from scenarios.acquire.config import (
    AcquireConfig,
    layout_file,
    load_acquire_config,
    with_values,
)
from scenarios.acquire.datasets import random_objects
from scenarios.acquire.datasets.causes import GRASPED, FixedCause, GraspedCause, base_lift_config
from scenarios.acquire.datasets.disturbances import DisturbanceSettings
from scenarios.acquire.datasets.random_objects import MAX_TRIES, Range
from scenarios.acquire.press import TURNS, StrokeMotion, motion
from scenarios.trial.result import versions
from scenarios.world.objects import Name

STROKES = {
    "primary": ("0", "90", "180", "270"),
    "oblique": ("45", "135", "225", "315"),
    "rotation": tuple(TURNS),
}
SEEDS = 1_000_000  # seeds of one data set; trials have lower seeds
BLOCKS: dict[Split, int] = {"train": 0, "validation": 400_000, "test": 700_000}
MIN_RECORDINGS = 3  # of a cause or kind: one a split
PRESSED = ("surface.", "press.", "control.", "sampling.")  # settings that a grasp does not have
Share = Annotated[float, Meta(gt=0.0, le=1.0)]  # of the recordings, relative to the other shares
Number = Annotated[int, Meta(ge=0, le=10_000_000)]


class DatasetRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Row of Table I: percent of the samples by surface. Speed in m/s, of a rotation rad/s."""

    motion: Literal["primary", "oblique", "rotation"]
    speed: Annotated[float, Meta(gt=0.0, le=2.0)]
    percent: dict[str, Annotated[float, Meta(ge=0.0, le=100.0)]]


def _check_ranges(*tables: Mapping[str, Range]) -> None:
    """Raise ValueError for a range whose bounds are exchanged, and for a setting of the held
    object: only config/object_shapes keeps it distinct from the objects of the experiments."""
    for key, (low, high) in ((key, bounds) for table in tables for key, bounds in table.items()):
        if low > high:
            raise ValueError(f"{key}: {low:g} is above {high:g}")
        if key.startswith("object."):
            raise ValueError(f"{key}: config/object_shapes has the ranges of the held object")


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A share of the recordings, with ranges that replace those of the whole set."""

    name: Name
    share: Share
    randomise: dict[str, Range] = {}
    on: dict[str, dict[str, Range]] = {}  # by surface

    def __post_init__(self) -> None:
        _check_ranges(self.randomise, *self.on.values())

    def ranges(self, surface: str) -> dict[str, Range]:
        return self.randomise | self.on.get(surface, {})


class CauseRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Recordings with one cause of disturbance: see ``causes``."""

    cause: FixedCause | GraspedCause
    on: Annotated[list[str], Meta(min_length=1)]  # surfaces; of a grasp, object shapes
    share: Share
    seconds: Annotated[float, Meta(ge=1.0, le=600.0)]
    strokes: bool = False
    load: Range | None = None  # weight over the first grip's friction; None: full grip
    disturbances: DisturbanceSettings | None = None
    randomise: dict[str, Range] = {}

    def __post_init__(self) -> None:
        _check_ranges(self.randomise)
        if self.load is not None and not 0.0 < self.load[0] <= self.load[1]:
            raise ValueError(f"load: {self.load[0]:g} to {self.load[1]:g} is not a range above 0")
        firm = self.disturbances is not None and self.disturbances.firm
        if not self.grasped and (self.load is not None or self.disturbances is not None):
            raise ValueError(f"{self.cause}: load and disturbances need a cause grasped_*")
        if self.grasped and firm == (self.load is not None):
            raise ValueError(f"{self.cause}: give either load, or disturbances with firm = true")

    @property
    def grasped(self) -> bool:
        return self.cause in GRASPED


class DatasetConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A data set's TOML file: rows of Table I, or causes, or both. Surfaces, layout and object
    shapes are names or paths of files."""

    name: Name
    seed: Annotated[int, Meta(ge=1, lt=2**31)]
    like: str = ""  # packaged set whose `randomise`, `on` and `parts` are used unless given
    layout: str = ""  # of taxels; empty: the kit's
    static_samples: Number = 0
    slip_samples: Number = 0
    recording_samples: Annotated[int, Meta(ge=100, le=100_000)] = 1200
    least_recordings: Annotated[int, Meta(ge=3, le=1000)] = 10
    held_out: Annotated[float, Meta(gt=0.0, le=0.4)] = 0.1  # for validation, and as much for test
    rows: list[DatasetRow] = []
    parts: list[Part] = []
    causes: list[CauseRow] = []
    recordings: Number = 0  # of all causes, at least three of each
    randomise: dict[str, Range] = {}
    on: dict[str, dict[str, Range]] = {}  # by surface

    def __post_init__(self) -> None:
        _check_ranges(self.randomise, *self.on.values())


class Job(msgspec.Struct, frozen=True):
    """A planned recording."""

    path: str  # in the data set's folder
    surface: str  # name or path of the surface, or of the object shape
    motion: StrokeMotion | None  # None: no strokes
    static: int  # samples; of a cause, all samples
    slip: int
    metadata: Metadata
    disturbances: DisturbanceSettings | None = msgspec.field(default=None, name="acts")

    @property
    def samples(self) -> int:
        return self.static + self.slip


WHOLE = Part(name="whole", share=1.0)  # the part of a set without parts


class _Named(msgspec.Struct, frozen=True):
    name: Name


@cache
def name_of(kind: str, word: str) -> str:
    """Name of a surface or object shape. Raises ConfigError for an unknown one."""
    if not is_path(word):
        named_layer(kind, word)
        return word
    section = {"surfaces": "surface", "object_shapes": "shape"}[kind]
    return load(_Named, [Layer(word, item_layer(kind, section, word).table[section])]).name


def resolve_paths(value: Any, folder: Path) -> Any:
    """A data set's settings, or a part of them, with paths relative to that folder resolved."""
    if isinstance(value, dict):
        return {resolve_paths(k, folder): resolve_paths(v, folder) for k, v in value.items()}
    if isinstance(value, list):
        return [resolve_paths(each, folder) for each in value]
    return str(folder / value) if isinstance(value, str) and is_path(value) else value


def fingerprints(*words: str) -> dict[str, str]:
    """Digests of the files among these words, by path."""
    files = [word for word in words if is_path(word)]
    return {file: hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16] for file in files}


def load_dataset_config(path: Path) -> DatasetConfig:
    """Read a data set's TOML file. Raises ConfigError for a bad file or unknown names."""
    layer = read_toml(path)
    table = _ranges_of(layer.table.get("like", "")) | layer.table
    settings = msgspec.structs.replace(layer, table=resolve_paths(table, path.parent))
    config = load(DatasetConfig, [settings])
    surfaces = [*config.on, *(word for part in config.parts for word in part.on)]
    surfaces += [word for row in config.rows for word in row.percent]
    for cause in config.causes:
        for word in cause.on if cause.grasped else ():
            name_of("object_shapes", word)
        surfaces += [] if cause.grasped else cause.on
    for word in surfaces:
        name_of("surfaces", word)
    press_config("planar", config.layout)
    if any(cause.grasped for cause in config.causes):
        base_lift_config(config.layout)
    if not config.causes and not any(sum(row.percent.values()) for row in config.rows):
        raise ConfigError(str(path), "rows", "no row has samples", "percent above 0")
    return config


def _ranges_of(name: str) -> dict[str, Any]:
    """Random settings of the packaged data set of that name. Raises ConfigError."""
    if not name:
        return {}
    table = read_toml(file_of("datasets", name)).table
    return {key: table[key] for key in ("randomise", "on", "parts") if key in table}


def reduced(config: DatasetConfig, share: float) -> DatasetConfig:
    """The same distribution with fewer samples and recordings, at least one sample a kind."""

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
    """All recordings, each assigned to a split within its cause or group of Table I."""
    jobs = list(_slide_jobs(config)) if config.rows else []
    return jobs + list(_cause_jobs(config, len(jobs)))


def _cause_jobs(config: DatasetConfig, index: int) -> Iterator[Job]:
    counts = apportion(config.recordings, np.array([row.share for row in config.causes]))
    for row, count in zip(config.causes, counts, strict=True):
        rng = np.random.default_rng([config.seed, index])
        splits = _splits(max(MIN_RECORDINGS, count), config.held_out, rng)
        for k, split in enumerate(splits):
            course = motion(STROKES["primary"][k % 4], 0.05, 1.0) if row.strokes else None
            word = row.on[k % len(row.on)]
            name = name_of("object_shapes" if row.grasped else "surfaces", word)
            metadata = _metadata(config, split, index, name, word, course, row)
            samples = round(row.seconds / PERIOD_S)
            path = f"{row.cause}/{index:04d}-{name}{SUFFIX}"
            yield Job(path, word, course, samples, 0, metadata, row.disturbances)
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
        surface = name_of("surfaces", word)
        count = max(config.least_recordings, round((slip + static) / config.recording_samples))
        rng = np.random.default_rng([config.seed, index])
        parts = zip(
            apportion(slip, np.ones(count)), apportion(static, np.ones(count)),
            _splits(count, config.held_out, rng), strict=True,
        )  # fmt: skip
        for k, (slip_part, static_part, split) in enumerate(parts):
            directions = STROKES[row.motion]
            course = motion(directions[k % len(directions)], row.speed, row.speed)
            metadata = _metadata(config, split, index, surface, word, course, None)
            path = f"{surface}/{row.motion}-{row.speed:g}-{k:02d}-{course.direction}{SUFFIX}"
            yield Job(path, word, course, static_part, slip_part, metadata)
            index += 1


def _metadata(
    config: DatasetConfig, split: Split, index: int, name: str, word: str,
    course: StrokeMotion | None, row: CauseRow | None,
) -> Metadata:  # fmt: skip
    """Metadata of the index-th recording; ``row`` None: of a row of Table I."""
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
        parameters=random_parameters(ranges, seed) if grasped
        else random_surface(press_config(word, config.layout), ranges, seed),
        object=_object(row, word, seed) if row is not None and grasped else {},
        files=fingerprints(word, config.layout),
    )  # fmt: skip


@cache
def _commit() -> str:
    return versions()["commit"]


def _object(row: CauseRow, word: str, seed: int) -> dict[str, Any]:
    """Settings of a random object, distinct from the objects of the experiments."""
    rng = np.random.default_rng([seed, 4])
    body = random_objects.random_object(word, row.load, base_lift_config(""), rng)
    return {key: value for key, value in msgspec.to_builtins(body).items() if value is not None}


def part_of_job(parts: Sequence[Part], index: int) -> Part:
    """Part of the index-th recording, evenly mixed by multiples of the golden ratio."""
    at = (index * (math.sqrt(5.0) - 1.0) / 2.0) % 1.0 * sum(part.share for part in parts)
    for part in parts:
        at -= part.share
        if at < 0.0:
            return part
    return parts[-1] if parts else WHOLE


def apportion(total: int, shares: NDArray[np.float64]) -> list[int]:
    """Whole numbers in these proportions that sum to the total, by largest remainders."""
    exact = total * shares / shares.sum()
    parts = np.floor(exact).astype(int)
    order = np.argsort(parts - exact, kind="stable")
    parts[order[: total - parts.sum()]] += 1
    return [int(part) for part in parts]


def _splits(count: int, held_out: float, rng: np.random.Generator) -> list[Split]:
    """Splits in random order, with a share ``held_out`` (at least one) of validation and test."""
    part = max(1, round(held_out * count))
    sizes: dict[Split, int] = {"train": count - 2 * part, "validation": part, "test": part}
    ordered = [split for split, size in sizes.items() for _ in range(size)]
    return [ordered[i] for i in rng.permutation(count)]


def random_parameters(ranges: Mapping[str, Range], seed: int) -> dict[str, float]:
    """Random settings of a grasp, uniform within their ranges."""
    chosen = {key: bounds for key, bounds in ranges.items() if not key.startswith(PRESSED)}
    return _uniform(chosen, np.random.default_rng([seed, 2]))


def random_surface(
    config: AcquireConfig, ranges: Mapping[str, Range], seed: int
) -> dict[str, float]:
    """Random settings of a pressed fingertip, with a distinct surface. Raises ConfigError."""
    rng = np.random.default_rng([seed, 2])
    for _ in range(MAX_TRIES):
        values = _uniform(ranges, rng)
        surface = with_values(config, values).surface
        if random_objects.is_distinct(random_objects.surface_properties(surface)):
            return values
    raise ConfigError(
        "randomise", "surface", "no surface found that differs from the objects of the experiments",
        'wider ranges of "surface.friction_kinetic", "surface.texture_rms_m", "surface.radius_x_m"',
    )  # fmt: skip


def _uniform(ranges: Mapping[str, Range], rng: np.random.Generator) -> dict[str, float]:
    return {key: float(rng.uniform(low, high)) for key, (low, high) in ranges.items()}


@cache
def press_config(surface: str, layout: str) -> AcquireConfig:
    """Settings of a session on that surface without random parameters."""
    return load_acquire_config(surface, "simulated", layout_file(layout))
