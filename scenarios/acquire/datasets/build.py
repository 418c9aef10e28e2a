"""Data sets made: recordings of a plan, or a lab's own, and the folder that holds them.

A data set is a folder of recordings (``detector.recordings``) and ``dataset.json``, which says what
it was built from. The plan is a pure function of its TOML file (``plan``); each recording is one of
its seed. So a build that was ended goes on where it was, and two builds give the same files.
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import SUFFIX, Metadata, Recording, Split, read, write
from drivers.errors import BadFile, ConfigError, UsageError
from grasp.files import make_private_folder, write_whole
from scenarios.acquire.config import AcquireConfig, with_values
from scenarios.acquire.datasets.causes import GRASPED, make_grasped, make_pressed
from scenarios.acquire.datasets.plan import Job, pressing
from scenarios.acquire.labels import recording
from scenarios.acquire.session import Session, open_acquire_rig
from scenarios.rigs.workers import Workers, results
from scenarios.trial.result import versions

INDEX = "dataset.json"
SPARE = (1.1, 1.3, 1.6, 2.0, 3.0)  # samples recorded for each one wanted, try after try
SPARE_SAMPLES = 250
SHARED_OUT: tuple[Split, ...] = ("train", "validation", "test", "train", "train")
LEAST = 3  # recordings, one a split: the first of SHARED_OUT
OWN: Final = "own"  # surface and motion of a file that names neither
NO_MOTION: Final = "none"
SAMPLES = f"samples*{SUFFIX}"  # of an acquisition's folder

Progress = Callable[[int, int], None]


def make(job: Job) -> Recording:
    """The recording of a job: a session on the simulated rig, of which the part is taken that
    holds so many samples of either label."""
    wanted, metadata = job.samples, job.metadata
    if metadata.cause in GRASPED:
        return make_grasped(metadata, wanted, job.acts, job.path)
    bare = pressing(job.surface, metadata.layout)
    if metadata.cause:
        return make_pressed(bare, metadata, wanted, job.motion, job.path)
    config = with_values(bare, metadata.parameters)
    for spare in SPARE:
        with open_acquire_rig(config, metadata.seed, paced=False) as rig:
            session = Session(config, job.motion, metadata.seed, rig)
            session.run(round(wanted * spare) + SPARE_SAMPLES)
        whole = recording(session.ticks, config, metadata, job.path)
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


def build(
    jobs: Sequence[Job], origin: Any, out: Path, workers: Workers, progress: Progress,
    option: str = "--out",
) -> int:  # fmt: skip
    """Make every recording that ``out`` lacks; gives how many those were.

    Raises UsageError when the folder, which ``option`` names, holds another data set, OSError when
    it cannot be written.
    """
    _claim(out, jobs, origin, option)
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


def _claim(out: Path, jobs: Sequence[Job], origin: Any, option: str) -> None:
    digest = hashlib.sha256(msgspec.json.encode(list(jobs))).hexdigest()[:16]
    path = out / INDEX
    if path.exists():
        try:
            found = msgspec.json.decode(path.read_bytes(), type=_Index)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            found = None
        if found is None or found.digest != digest:
            raise UsageError(
                f"{out} holds a data set of other settings or of another version of the program",
                f"--share and settings as they were then, or another folder with {option}",
            )
        return
    _require_empty(out, option)
    make_private_folder(out)
    index = _Index(digest, versions()["commit"], len(jobs), msgspec.to_builtins(origin))
    write_whole(
        path, msgspec.json.format(msgspec.json.encode(index), indent=1) + b"\n", private=True
    )


def _require_empty(out: Path, option: str) -> None:
    if out.exists() and any(out.iterdir()):
        raise UsageError(f"{out} is not empty", f"give a new folder with {option}")


# A lab's own recordings: acquisitions and files of counts, each given to a split


class Collected(msgspec.Struct, frozen=True):
    """How many recordings are of each split, and of what a split has none, if of anything."""

    counts: dict[Split, int]
    lacking: dict[Split, list[str]]


def collect(sources: Sequence[Path], out: Path) -> Collected:
    """Copy the recordings of acquisitions' folders, and files, into a new folder; of each five of
    a motion on a surface, three are for training.

    Raises BadFile for what is no recording, UsageError for fewer than three, for one that is given
    twice, by whatever name, for several layouts of taxels and for a folder that is not empty,
    OSError where nothing can be written.
    """
    paths = [path for source in sources for path in _files(source)]
    if len(paths) < LEAST:
        raise UsageError(f"{len(paths)} recordings make no data set", "give three at least")
    _require_empty(out, "--out")
    found = [read(path) for path in paths]
    _require_each_once(paths, found)
    if len(layouts := sorted({each.taxels for each in found})) > 1:
        mixed = " and ".join(map(str, layouts))
        raise UsageError(f"fingertips of {mixed} taxels make no data set", "collect one layout")
    kinds = [_kind(each) for each in found]
    splits = shared_out(kinds)
    make_private_folder(out)
    for number, (r, split) in enumerate(zip(found, splits, strict=True)):
        write(out / f"{number:03d}{SUFFIX}", _of_split(r, split))
    return Collected({s: splits.count(s) for s in SHARED_OUT[:LEAST]}, _lacking(kinds, splits))


def _require_each_once(paths: Sequence[Path], found: Sequence[Recording]) -> None:
    """One recording in two splits would be tested on what it was learnt from."""
    first: dict[str, Path] = {}
    for path, one in zip(paths, found, strict=True):
        other = first.setdefault(hashlib.sha256(one.counts.tobytes()).hexdigest(), path)
        if other is not path:
            same = "given twice, itself or in its folder" if other == path else (
                f"the same recording as {other}"
            )  # fmt: skip
            raise UsageError(f"{path} is {same}", "give each once")


def shared_out(kinds: Sequence[str]) -> list[Split]:
    """The split of each recording, in their order. A kind with enough of them is in every split;
    those with fewer are dealt out as if they were one kind, or all would be for training."""
    many, dealt = Counter(kinds), Counter[str]()
    splits = []
    for kind in kinds:
        group = kind if many[kind] >= LEAST else ""
        splits.append(SHARED_OUT[dealt[group] % len(SHARED_OUT)])
        dealt[group] += 1
    return splits


def _lacking(kinds: Sequence[str], splits: Sequence[Split]) -> dict[Split, list[str]]:
    there = set(zip(kinds, splits, strict=True))
    all_kinds = sorted(set(kinds))
    found = {s: [kind for kind in all_kinds if (kind, s) not in there] for s in SHARED_OUT[:LEAST]}
    return {split: missing for split, missing in found.items() if missing}


def _kind(collected: Recording) -> str:
    """What was done on what, as far as it is known."""
    known = collected.metadata
    if known is None or (known.surface, known.motion, known.cause) == (OWN, NO_MOTION, ""):
        return "no known motion"
    return f"{known.cause or known.motion} on {known.surface}"


def _files(source: Path) -> list[Path]:
    if not source.exists():
        raise BadFile(source, "no such file or folder", "check the path")
    if not source.is_dir():
        return [source]
    found = sorted(source.glob(SAMPLES))
    if not found:
        raise UsageError(f"{source} has no labelled samples", "give folders of `grasp run acquire`")
    return found


def _of_split(collected: Recording, split: Split) -> Recording:
    known = collected.metadata or Metadata(
        set="slide", split=split, surface=OWN, motion=NO_MOTION, speed_mps=0.0, spin_radps=0.0,
        direction="", seed=0,
    )  # fmt: skip
    return msgspec.structs.replace(collected, metadata=msgspec.structs.replace(known, split=split))
