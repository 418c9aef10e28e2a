"""Data sets: which recordings, in what order of chance, and how they are made.

A data set is a folder of recordings (``detector.recordings``) and ``dataset.json``, which says what
it was built from. The plan is a pure function of its TOML file; each recording is one of its seed.
So a build that was ended goes on where it was, and two builds give the same files.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.recordings import SUFFIX, Metadata, Recording, Split, write
from drivers.errors import ConfigError, UsageError
from drivers.interfaces import PERIOD_S
from grasp.files import make_private_folder, write_whole
from grasp.settings import load, named_layer, read_toml
from scenarios.acquire.config import AcquireConfig, load_acquire_config
from scenarios.acquire.datasets.confusers import GRASPED, FixedCause, GraspedCause, make_confuser
from scenarios.acquire.datasets.draws import layout_file, with_values
from scenarios.acquire.labels import recording
from scenarios.acquire.press import TURNS, StrokeMotion, motion
from scenarios.acquire.rig import open_acquire_rig
from scenarios.acquire.session import Session
from scenarios.rigs.workers import Workers, results
from scenarios.trial.result import versions
from scenarios.world.objects import Name

DIRECTIONS = {
    "primary": ("0", "90", "180", "270"),
    "oblique": ("45", "135", "225", "315"),
    "rotation": tuple(TURNS),
}
INDEX = "dataset.json"
SPARE = (1.1, 1.3, 1.6, 2.0, 3.0)  # samples recorded for each one wanted, try after try
SPARE_SAMPLES = 250
SEEDS = 1_000_000  # seeds of one data set
Range = tuple[float, float]


class DatasetRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One row of Table I: percent of the samples a surface. Speed in m/s, of a rotation rad/s."""

    motion: Literal["primary", "oblique", "rotation"]
    speed: Annotated[float, Meta(gt=0.0, le=2.0)]
    percent: dict[Name, Annotated[float, Meta(ge=0.0, le=100.0)]]


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Some of the strokes, with ranges of their own over those that all share."""

    name: Name
    share: Annotated[float, Meta(gt=0.0, le=1.0)]  # of the recordings of strokes
    randomise: dict[str, Range] = {}
    on: dict[Name, dict[str, Range]] = {}  # of one surface

    def ranges(self, surface: str) -> dict[str, Range]:
        return self.randomise | self.on.get(surface, {})


class CauseRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Recordings in which something shakes the fingertip; see ``confusers``."""

    cause: FixedCause | GraspedCause
    on: Annotated[list[Name], Meta(min_length=1)]  # surfaces, or objects of a grasp
    recordings: Annotated[int, Meta(ge=3, le=10_000)]
    seconds: Annotated[float, Meta(ge=1.0, le=600.0)]
    strokes: bool = False
    randomise: dict[str, Range] = {}


class DatasetConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A data set's TOML file: rows of Table I, or causes, or both."""

    name: Name
    seed: Annotated[int, Meta(ge=0, lt=2**31)]
    layout: Name | Literal[""] = ""  # of taxels, from config/layouts; empty: the kit's
    static_samples: Annotated[int, Meta(ge=0)] = 0
    slip_samples: Annotated[int, Meta(ge=0)] = 0
    recording_samples: Annotated[int, Meta(ge=100, le=100_000)] = 1200
    least_recordings: Annotated[int, Meta(ge=3, le=1000)] = 10
    held_out: Annotated[float, Meta(gt=0.0, le=0.4)] = 0.1  # for validation, and as much for test
    rows: list[DatasetRow] = []
    parts: list[Part] = []  # of the rows; their shares are taken in proportion
    causes: list[CauseRow] = []
    randomise: dict[str, Range] = {}


class Job(msgspec.Struct, frozen=True):
    """One recording to be made."""

    path: str  # in the data set's folder
    surface: str
    motion: StrokeMotion | None  # None: no strokes
    static: int
    slip: int  # of a cause, static and slip are not told apart
    metadata: Metadata

    @property
    def samples(self) -> int:
        return self.static + self.slip


Progress = Callable[[int, int], None]
WHOLE = Part(name="whole", share=1.0)  # of a set that has no parts


def load_dataset_config(path: Path) -> DatasetConfig:
    """Raises ConfigError for a file that is missing or not allowed, or names what is unknown."""
    config = load(DatasetConfig, [read_toml(path)])
    for row in config.rows:
        for surface in row.percent:
            named_layer("surfaces", surface)
    if config.layout:
        named_layer("layouts", config.layout)
    for part in config.parts:
        for surface in part.on:
            named_layer("surfaces", surface)
    for cause in config.causes:
        for name in cause.on:
            named_layer("objects" if cause.cause in GRASPED else "surfaces", name)
    if not config.causes and not any(sum(row.percent.values()) for row in config.rows):
        raise ConfigError(str(path), "rows", "there is nothing to record", "percent above 0")
    return config


def reduced(config: DatasetConfig, share: float) -> DatasetConfig:
    """The same distribution with fewer samples and recordings."""
    return msgspec.structs.replace(
        config,
        static_samples=max(1, round(config.static_samples * share)),
        slip_samples=max(1, round(config.slip_samples * share)),
        least_recordings=max(3, round(config.least_recordings * share)),
        causes=[
            msgspec.structs.replace(row, recordings=max(3, round(row.recordings * share)))
            for row in config.causes
        ],
    )


def plan(config: DatasetConfig) -> list[Job]:
    """All recordings; split by recording within each cause or group of Table I."""
    jobs = _slide_jobs(config) if config.rows else []
    return jobs + _cause_jobs(config, len(jobs))


def _cause_jobs(config: DatasetConfig, first: int) -> list[Job]:
    jobs: list[Job] = []
    commit = versions()["commit"]
    for row in config.causes:
        index = first + len(jobs)
        rng = np.random.default_rng([config.seed, index])
        splits = _splits(row.recordings, config.held_out, rng)
        for k, split in enumerate(splits):
            seed = config.seed * SEEDS + first + len(jobs)
            course = motion(DIRECTIONS["primary"][k % 4], 0.05, 1.0) if row.strokes else None
            name = row.on[k % len(row.on)]
            metadata = Metadata(
                set="confusers", split=split, surface=name, cause=row.cause,
                motion=course.kind if course else "none",
                speed_mps=course.speed_mps if course else 0.0, spin_radps=0.0,
                direction=course.direction if course else "", seed=seed, commit=commit,
                layout=config.layout,
                parameters=drawn(config.randomise | row.randomise, seed),
            )  # fmt: skip
            path = f"{row.cause}/{k:03d}-{name}{SUFFIX}"
            jobs.append(Job(path, name, course, round(row.seconds / PERIOD_S), 0, metadata))
    return jobs


def _slide_jobs(config: DatasetConfig) -> list[Job]:
    groups = [(row, name, share) for row in config.rows for name, share in row.percent.items()]
    shares = np.array([share for _, _, share in groups])
    slips = apportion(config.slip_samples, shares)
    statics = apportion(config.static_samples, shares)
    jobs: list[Job] = []
    commit = versions()["commit"]
    for (row, surface, share), slip, static in zip(groups, slips, statics, strict=True):
        if share == 0.0:
            continue
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
            seed = config.seed * SEEDS + len(jobs)
            part = part_of_job(config.parts, len(jobs))
            metadata = Metadata(
                set="slide", split=split, surface=surface, motion=row.motion,
                part=part.name if config.parts else "",
                speed_mps=course.speed_mps, spin_radps=course.spin_radps,
                direction=course.direction, seed=seed, commit=commit, layout=config.layout,
                parameters=drawn(config.randomise | part.ranges(surface), seed),
            )  # fmt: skip
            name = f"{surface}/{row.motion}-{row.speed:g}-{k:02d}-{course.direction}{SUFFIX}"
            jobs.append(Job(name, surface, course, static_part, slip_part, metadata))
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
    rng = np.random.default_rng([seed, 2])
    return {key: float(rng.uniform(low, high)) for key, (low, high) in ranges.items()}


def make(job: Job) -> Recording:
    """The recording of a job: a session on the simulated rig, of which the part is taken that
    holds so many samples of either label."""
    wanted = job.samples
    if job.metadata.cause:
        return make_confuser(job.metadata, wanted, job.motion, job.path)
    file = layout_file(job.metadata.layout)
    config = load_acquire_config(job.surface, "simulated", file)
    config = with_values(config, job.metadata.parameters)
    for spare in SPARE:
        with open_acquire_rig(config, job.metadata.seed, paced=False) as rig:
            session = Session(config, job.motion, job.metadata.seed, rig)
            session.run(round(wanted * spare) + SPARE_SAMPLES)
        whole = recording(session.ticks, config, job.metadata, job.path)
        first = window(whole.slip, wanted, job.slip)
        if first is not None:
            return part_of(whole, first, first + wanted)
        config = _with_other_pauses(config, job, float(whole.slip.mean()))
    raise ConfigError(
        job.path, "control.pause_share", f"no {wanted} samples with {job.slip} of slip came",
        "a share near that of the labels",
    )  # fmt: skip


def _with_other_pauses(config: AcquireConfig, job: Job, slip_share: float) -> AcquireConfig:
    """Pauses longer or shorter in proportion to the static samples that came too few or many."""
    came = (1.0 - slip_share) / max(slip_share, 0.01)
    share = config.control.pause_share * job.static / max(1, job.slip) / max(came, 0.01)
    control = msgspec.structs.replace(config.control, pause_share=min(max(share, 0.1), 20.0))
    return msgspec.structs.replace(config, control=control)


def window(slip: NDArray[np.bool_], length: int, count: int) -> int | None:
    """Where ``length`` samples begin of which ``count`` are labelled slip, as early as can be."""
    total = np.concatenate(([0], np.cumsum(slip)))
    hits = np.flatnonzero(total[length:] - total[:-length] == count)
    return int(hits[0]) if len(hits) else None


def part_of(whole: Recording, first: int, end: int) -> Recording:
    """Samples first to end, time counted from the first of them."""
    cut = {
        name: array[first:end]
        for name in whole.__struct_fields__
        if isinstance(array := getattr(whole, name), np.ndarray)
    }
    cut["t_s"] = cut["t_s"] - cut["t_s"][0]
    return msgspec.structs.replace(whole, **cut)


def _made(job: Job) -> tuple[Job, Recording]:
    return job, make(job)


class _Index(msgspec.Struct, frozen=True):
    """What a folder was built from."""

    digest: str
    commit: str
    recordings: int
    dataset: Any


def build(jobs: Sequence[Job], origin: Any, out: Path, workers: Workers, progress: Progress) -> int:
    """Make every recording that ``out`` lacks; gives how many those were.

    Raises UsageError when the folder holds another data set, OSError when it cannot be written.
    """
    _claim(out, jobs, origin)
    missing = [job for job in jobs if not (out / job.path).exists()]
    done = len(jobs) - len(missing)
    progress(done, len(jobs))
    for path in {(out / job.path).parent for job in missing}:
        make_private_folder(path)
    with closing(results(_made, missing, workers)) as found:
        for job, made in found:
            write(out / job.path, made)
            done += 1
            progress(done, len(jobs))
    return len(missing)


def _claim(out: Path, jobs: Sequence[Job], origin: Any) -> None:
    digest = hashlib.sha256(msgspec.json.encode(list(jobs))).hexdigest()[:16]
    path = out / INDEX
    if path.exists():
        try:
            found = msgspec.json.decode(path.read_bytes(), type=_Index)
        except (msgspec.DecodeError, RecursionError):
            found = None
        if found is None or found.digest != digest:
            raise UsageError(
                f"{out} holds a data set of other settings or of another version of the program",
                "give another folder with --out, or remove this one",
            )
        return
    make_private_folder(out)
    if any(out.iterdir()):
        raise UsageError(f"{out} is not empty", "give a new folder with --out")
    index = _Index(digest, versions()["commit"], len(jobs), msgspec.to_builtins(origin))
    write_whole(
        path, msgspec.json.format(msgspec.json.encode(index), indent=1) + b"\n", private=True
    )
