"""Data sets as verbs take them: one a folder, all of it or told what is not there.

A folder that `grasp dataset build` filled says in ``dataset.json`` how many recordings it is to
have. Those of `grasp dataset collect` and those that somebody put together say nothing, and are
taken as they are.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from detector.recordings import SUFFIX, Recording, Split, read, read_dataset
from drivers.errors import BadFile, UsageError
from grasp.settings import file_of
from scenarios.acquire.datasets.build import INDEX
from scenarios.acquire.datasets.collect import SAMPLES
from scenarios.acquire.datasets.plan import SEEDS, load_dataset_config

RECORDINGS = f"[!.]*{SUFFIX}"  # one that begins with a dot is still being written
MCAP = ".mcap"
GO_ON = "`grasp dataset build` goes on with it"
Tell = Callable[[str], None]


LEARNT = ("paper", "confusers", "grasped-slip", "mallet")  # by the packaged networks, one or all


class _Index(msgspec.Struct, frozen=True):
    recordings: int


def read_set(
    folder: Path, split: Split | None = None, tell: Tell = lambda line: None
) -> list[Recording]:
    """As ``read_dataset``, of one data set; that some of it is not there is told.

    Raises BadFile for a folder of several, too."""
    require_one(folder)
    if lacks := _lacks(folder):
        tell(f"{folder}: {lacks}: {GO_ON}")
    return read_dataset(folder, split)


def learnt_from(recordings: Sequence[Recording]) -> int:
    """How many are of the sets that packaged networks have learnt from, and not of a split that was
    kept for a test."""
    seeds = {load_dataset_config(file_of("datasets", name)).seed for name in LEARNT}
    known = (r.metadata for r in recordings if r.metadata is not None)
    return sum(m.seed // SEEDS in seeds and m.split != "test" for m in known)


def require_whole(folders: Sequence[Path]) -> None:
    """Raises BadFile for a data set of which some is not there: what learns from it is not asked
    again whether it was all."""
    for folder in folders:
        require_one(folder)
        if lacks := _lacks(folder):
            raise BadFile(folder, lacks, f"{GO_ON}; without its {INDEX} it is taken as it is")


def require_one(folder: Path) -> None:
    """Raises BadFile for a folder of data sets, which is none itself, and for a data set with
    another one in it, whose recordings would be read as its own."""
    if (folder / INDEX).is_file():
        if inner := sorted(path.parent for path in folder.rglob(INDEX) if path.parent != folder):
            raise BadFile(folder, f"has another data set in it, {inner[0]}", "move that one out")
        return
    if not (found := _sets_in(folder)):
        return
    what = "a data set" if len(found) == 1 else f"{len(found)} data sets"
    names = " ".join(str(path) for path in found)
    raise BadFile(folder, f"holds {what}", f"name {'it' if len(found) == 1 else 'them'}: {names}")


def _sets_in(folder: Path) -> list[Path]:
    """Those that were built, wherever they lie, and beside them folders of recordings, each taken
    for one that was collected. None where none was built: then it is one, with folders in it."""
    built = [path.parent for path in folder.rglob(INDEX)]
    if not built:
        return []
    others = [path for path in folder.iterdir() if path.is_dir() and any(path.rglob(RECORDINGS))]
    collected = [path for path in others if not any(b.is_relative_to(path) for b in built)]
    return sorted([*built, *collected])


def _lacks(folder: Path) -> str:
    """How much of a data set is there, if it says that there is to be more."""
    try:
        wanted = msgspec.json.decode((folder / INDEX).read_bytes(), type=_Index).recordings
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ""  # `grasp dataset build` speaks of a damaged one
    there = sum(1 for _ in folder.rglob(RECORDINGS))
    return f"{there} of {wanted} recordings are there" if there < wanted else ""


def read_labelled(path: Path) -> list[Recording]:
    """Of a file of labelled samples, or of the folder of an acquisition; raises BadFile, and
    UsageError for what holds recordings of another kind."""
    if path.is_dir():
        return [read(file) for file in _samples_in(path)]
    require_labelled(path)
    return [read(path)]


def require_labelled(path: Path) -> None:
    """Raises UsageError for the recording of a whole run, in which nothing is labelled."""
    if path.suffix != MCAP:
        return
    beside = " ".join(str(file) for file in sorted(path.parent.glob(SAMPLES)))
    raise UsageError(
        f"{path} is the recording of a run, which has no labels",
        f"its labelled samples are {beside}" if beside else
        f"labelled are those of `grasp run acquire`, {SAMPLES} beside its recording",
    )  # fmt: skip


def _samples_in(folder: Path) -> list[Path]:
    found = sorted(folder.glob(SAMPLES))
    if found:
        return found
    if any(folder.rglob(RECORDINGS)):
        raise UsageError(f"{folder} is a folder of recordings", "give it with --data")
    raise UsageError(
        f"{folder} has no labelled samples", "give a folder of `grasp run acquire`, or a file"
    )
