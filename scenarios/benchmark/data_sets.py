"""Reads data sets and labelled recordings for commands, and refuses what is none or incomplete.

`grasp dataset build` writes the number of recordings into ``dataset.json``. Folders without that
file, as of `grasp dataset collect`, count as complete.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from detector.recordings import SUFFIX, Recording, Split, read, read_dataset
from drivers.errors import BadFile, UsageError
from scenarios.acquire.datasets.build import INDEX, SAMPLES

RECORDINGS = f"[!.]*{SUFFIX}"  # a name with a leading dot is still being written
MCAP = ".mcap"
GO_ON = "`grasp dataset build` goes on with it"
Tell = Callable[[str], None]


class _Index(msgspec.Struct, frozen=True):
    recordings: int


def read_set(
    folder: Path, split: Split | None = None, tell: Tell = lambda line: None
) -> list[Recording]:
    """Recordings of one data set; ``tell`` takes a line if it is incomplete.

    Raises BadFile as ``read_dataset``, and for a folder of several sets."""
    require_one(folder)
    if lacks := _lacks(folder):
        tell(f"{folder}: {lacks}: {GO_ON}")
    return read_dataset(folder, split)


def require_whole(folders: Sequence[Path]) -> None:
    """Raises BadFile for an incomplete data set: no training learns from one."""
    for folder in folders:
        require_one(folder)
        if lacks := _lacks(folder):
            raise BadFile(folder, lacks, f"{GO_ON}; without its {INDEX} it is taken as it is")


def require_one(folder: Path) -> None:
    """Raises BadFile for a folder of data sets, and for a data set that contains another one."""
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
    """Sets that were built, at any depth, and folders of recordings beside them, which count as
    collected sets. Empty where none was built: then the folder itself is one set."""
    built = [path.parent for path in folder.rglob(INDEX)]
    if not built:
        return []
    others = [path for path in folder.iterdir() if path.is_dir() and any(path.rglob(RECORDINGS))]
    collected = [path for path in others if not any(b.is_relative_to(path) for b in built)]
    return sorted([*built, *collected])


def _lacks(folder: Path) -> str:
    """What an incomplete data set lacks; empty for a complete one."""
    try:
        wanted = msgspec.json.decode((folder / INDEX).read_bytes(), type=_Index).recordings
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ""  # `grasp dataset build` refuses a damaged one
    there = sum(1 for _ in folder.rglob(RECORDINGS))
    return f"{there} of {wanted} recordings are there" if there < wanted else ""


def read_labelled(path: Path) -> list[Recording]:
    """Recordings of a file of labelled samples, or of the folder of an acquisition. Raises BadFile,
    and UsageError for recordings without labels."""
    if path.is_dir():
        return [read(file) for file in _samples_in(path)]
    require_labelled(path)
    return [read(path)]


def require_labelled(path: Path) -> None:
    """Raises UsageError for the recording of a run, which has no labels."""
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
