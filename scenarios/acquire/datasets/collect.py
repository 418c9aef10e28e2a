"""A data set of a lab's own recordings: acquisitions and files of counts, each given to a split."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from detector.recordings import SUFFIX, Metadata, Recording, Split, read, write
from drivers.errors import BadFile, UsageError
from grasp.files import make_private_folder

SHARED_OUT: tuple[Split, ...] = ("train", "validation", "test", "train", "train")
LEAST = 3  # recordings, one a split: the first of SHARED_OUT
OWN: Final = "own"  # surface and motion of a file that names neither
NO_MOTION: Final = "none"
SAMPLES = f"samples*{SUFFIX}"  # of an acquisition's folder


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
    if out.exists() and any(out.iterdir()):
        raise UsageError(f"{out} is not empty", "give a new folder with --out")
    found = [read(path) for path in paths]
    _require_each_once(paths, found)
    if len(layouts := sorted({recording.taxels for recording in found})) > 1:
        mixed = " and ".join(map(str, layouts))
        raise UsageError(f"fingertips of {mixed} taxels make no data set", "collect one layout")
    kinds = [_kind(recording) for recording in found]
    splits = shared_out(kinds)
    make_private_folder(out)
    for number, (r, split) in enumerate(zip(found, splits, strict=True)):
        write(out / f"{number:03d}{SUFFIX}", _of_split(r, split))
    return Collected({s: splits.count(s) for s in SHARED_OUT[:LEAST]}, _lacking(kinds, splits))


def _require_each_once(paths: Sequence[Path], found: Sequence[Recording]) -> None:
    """One recording in two splits would be tested on what it was learnt from."""
    first: dict[str, Path] = {}
    for path, recording in zip(paths, found, strict=True):
        other = first.setdefault(hashlib.sha256(recording.counts.tobytes()).hexdigest(), path)
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


def _kind(recording: Recording) -> str:
    """What was done on what, as far as it is known."""
    known = recording.metadata
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


def _of_split(recording: Recording, split: Split) -> Recording:
    known = recording.metadata or Metadata(
        set="slide", split=split, surface=OWN, motion=NO_MOTION, speed_mps=0.0, spin_radps=0.0,
        direction="", seed=0,
    )  # fmt: skip
    return msgspec.structs.replace(recording, metadata=msgspec.structs.replace(known, split=split))
