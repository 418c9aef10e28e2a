"""Building of data sets: from a plan of simulated recordings, or from a lab's recordings.

A data set is a folder of recordings (``detector.recordings``) and ``dataset.json`` with its
settings. The plan depends on the TOML file only, each recording on its seed. So an interrupted
build can be continued, and two builds give the same files.
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import INDEX, SUFFIX, Metadata, Recording, Split, files_in, read_all, write
from drivers.errors import BadFile, ConfigError, UsageError
from grasp.files import make_private_folder, write_whole
from scenarios.acquire.config import AcquireConfig, with_values
from scenarios.acquire.datasets.causes import GRASPED, grasped_recording, pressed_recording
from scenarios.acquire.datasets.plan import MIN_RECORDINGS, Job, press_config
from scenarios.acquire.labels import recording
from scenarios.acquire.session import Session, open_acquire_rig
from scenarios.rigs.workers import Workers, results
from scenarios.trial.result import versions

OVERSAMPLING = (1.1, 1.3, 1.6, 2.0, 3.0)  # recorded samples over needed ones, try after try
EXTRA_SAMPLES = 250
SPLIT_CYCLE: tuple[Split, ...] = ("train", "validation", "test", "train", "train")
OWN: Final = "own"  # surface of a file without metadata
NO_MOTION: Final = "none"
UNKNOWN = "no known motion"

Progress = Callable[[int, int], None]  # done, total


def make(job: Job) -> Recording:
    """Make the recording of a job: a session on the simulated rig, cut to the part with the planned
    numbers of static and slip samples. Raises ConfigError if there is none."""
    samples, metadata = job.samples, job.metadata
    if metadata.cause in GRASPED:
        return grasped_recording(metadata, samples, job.disturbances, job.path)
    base = press_config(job.surface, metadata.layout)
    if metadata.cause:
        return pressed_recording(base, metadata, samples, job.motion, job.path)
    config = with_values(base, metadata.parameters)
    for factor in OVERSAMPLING:
        with open_acquire_rig(config, metadata.seed, paced=False) as rig:
            session = Session(config, job.motion, metadata.seed, rig)
            session.run(round(samples * factor) + EXTRA_SAMPLES)
        whole = recording(session.ticks, config, metadata, job.path)
        first = window(whole.slip, samples, job.slip)
        if first is not None:
            return part_of(whole, first, first + samples)
        config = _with_other_pauses(config, job, float(whole.slip.mean()))
    raise ConfigError(
        job.path, "control.pause_share", f"no {samples} samples with {job.slip} of slip found",
        "a share near that of the labels",
    )  # fmt: skip


def _with_other_pauses(config: AcquireConfig, job: Job, slip_share: float) -> AcquireConfig:
    """The configuration with pauses scaled towards the planned ratio of static to slip samples."""
    ratio = (1.0 - slip_share) / max(slip_share, 0.01)
    share = config.control.pause_share * job.static / max(1, job.slip) / max(ratio, 0.01)
    control = msgspec.structs.replace(config.control, pause_share=min(max(share, 0.1), 20.0))
    return msgspec.structs.replace(config, control=control)


def window(slip: NDArray[np.bool_], length: int, count: int) -> int | None:
    """First sample of the earliest window of ``length`` samples with ``count`` of slip, or None."""
    total = np.concatenate(([0], np.cumsum(slip)))
    hits = np.flatnonzero(total[length:] - total[:-length] == count)
    return int(hits[0]) if len(hits) else None


def part_of(whole: Recording, first: int, end: int) -> Recording:
    """Samples from ``first`` to ``end`` (exclusive), with time 0 at the first."""
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
    """Content of ``dataset.json``."""

    digest: str
    commit: str
    recordings: int
    dataset: Any


def build(jobs: Sequence[Job], origin: Any, out: Path, workers: Workers, progress: Progress) -> int:
    """Make the recordings that are missing in ``out``; returns their number.

    Raises UsageError if it has another data set, OSError if it cannot be written.
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
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            found = None
        if found is None or found.digest != digest:
            raise UsageError(
                f"{out} holds a data set of other settings or of another program version",
                "give the same --share and settings, or another folder with --out",
            )
        return
    _require_empty(out)
    make_private_folder(out)
    index = _Index(digest, versions()["commit"], len(jobs), msgspec.to_builtins(origin))
    write_whole(
        path, msgspec.json.format(msgspec.json.encode(index), indent=1) + b"\n", private=True
    )


def _require_empty(out: Path) -> None:
    if out.exists() and any(out.iterdir()):
        raise UsageError(f"{out} is not empty", "give a new folder with --out")


# Recordings of a lab: acquisitions and files of counts, each assigned to a split


class Collected(msgspec.Struct, frozen=True):
    """Number of recordings by split, kinds of recordings that a split does not have, and the
    recordings."""

    counts: dict[Split, int]
    lacking: dict[Split, list[str]]
    recordings: list[Recording]


def collect(sources: Sequence[Path], out: Path) -> Collected:
    """Copy recordings (files, and folders of acquisitions) into a new folder. Of each five with the
    same motion and surface, three are for training.

    Raises BadFile for a file that is not a recording. Raises UsageError for fewer than three
    recordings, duplicates, several layouts, and a folder that is not empty. Raises OSError.
    """
    recordings = list(read_all(sources))
    if len(recordings) < MIN_RECORDINGS:
        raise UsageError(
            f"{len(recordings)} recordings are too few", f"give at least {MIN_RECORDINGS}"
        )
    _require_empty(out)
    _require_each_once(recordings)
    if len(layouts := sorted({each.taxels for each in recordings})) > 1:
        mixed = " and ".join(map(str, layouts))
        raise UsageError(f"recordings of {mixed} taxels in one set", "collect one layout")
    kinds = [_kind(each) for each in recordings]
    splits = assign_splits(kinds)
    make_private_folder(out)
    for number, (r, split) in enumerate(zip(recordings, splits, strict=True)):
        write(out / f"{number:03d}{SUFFIX}", _with_split(r, split))
    counts = {s: splits.count(s) for s in SPLIT_CYCLE[:MIN_RECORDINGS]}
    return Collected(counts, _lacking(kinds, splits), recordings)


def _require_each_once(recordings: Sequence[Recording]) -> None:
    """Raise UsageError for duplicates, which could be in both the training and the test split."""
    first: dict[str, Recording] = {}
    for one in recordings:
        other = first.setdefault(hashlib.sha256(one.counts.tobytes()).hexdigest(), one)
        if other is not one:
            twice = "given twice, by itself or in its folder"
            same = f"the same recording as {other.source}" if other.source != one.source else twice
            raise UsageError(f"{one.source} is {same}", "give each once")


def assign_splits(kinds: Sequence[str]) -> list[Split]:
    """Split of each recording, in order. A kind with at least MIN_RECORDINGS is in every split;
    rarer kinds are assigned as one group, because alone all would be for training."""
    totals, assigned = Counter(kinds), Counter[str]()
    splits = []
    for kind in kinds:
        group = kind if totals[kind] >= MIN_RECORDINGS else ""
        splits.append(SPLIT_CYCLE[assigned[group] % len(SPLIT_CYCLE)])
        assigned[group] += 1
    return splits


def divided(folder: Path, report: Callable[[str], None]) -> dict[Split, list[Recording]]:
    """Recordings by split of a folder of imports, which are all for tests until ``collect`` or this
    divides them; ``report`` gets a line. Empty for another data set. Raises BadFile."""
    paths = files_in(folder)
    recordings = list(takewhile(_is_import, read_all(paths)))
    if not paths or len(recordings) < len(paths):
        return {}
    if len(paths) < MIN_RECORDINGS:
        problem = f"{len(paths)} recordings are too few to divide"
        raise BadFile(folder, problem, f"import at least {MIN_RECORDINGS}")
    report(f"{folder}: of each five imports three are for training, one for validation; "
           "`evaluate` scores all, unless `grasp dataset collect` keeps the division")  # fmt: skip
    found: dict[Split, list[Recording]] = {split: [] for split in SPLIT_CYCLE}
    for each, split in zip(recordings, assign_splits([UNKNOWN] * len(paths)), strict=True):
        found[split].append(each)
    return found


def _is_import(recording: Recording) -> bool:
    return _kind(recording) == UNKNOWN and getattr(recording.metadata, "split", "test") == "test"


def _lacking(kinds: Sequence[str], splits: Sequence[Split]) -> dict[Split, list[str]]:
    present = set(zip(kinds, splits, strict=True))
    every, three = sorted(set(kinds)), SPLIT_CYCLE[:MIN_RECORDINGS]
    missing = {split: [kind for kind in every if (kind, split) not in present] for split in three}
    return {split: kinds for split, kinds in missing.items() if kinds}


def _kind(recording: Recording) -> str:
    """Cause or motion, and surface, as far as the metadata has them."""
    known = recording.metadata
    if known is None or (known.surface, known.motion) == (OWN, NO_MOTION):
        return UNKNOWN
    return f"{known.cause or known.motion} on {known.surface}"


def _with_split(recording: Recording, split: Split) -> Recording:
    known = recording.metadata or Metadata(
        set="slide", split=split, surface=OWN, motion=NO_MOTION, speed_mps=0.0, spin_radps=0.0,
        direction="", seed=0,
    )  # fmt: skip
    return msgspec.structs.replace(recording, metadata=msgspec.structs.replace(known, split=split))
