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
GO_ON = "`grasp dataset build` goes on with it"
Tell = Callable[[str], None]


class _Index(msgspec.Struct, frozen=True):
    recordings: int


def read_set(
    folder: Path, split: Split | None = None, tell: Tell = lambda line: None
) -> list[Recording]:
    """Recordings of one data set; ``tell`` takes a line if it is incomplete.

    Raises BadFile as ``read_dataset``, and for a folder of several sets."""
    if lacks := _lacks(folder):
        tell(f"{folder}: {lacks}: {GO_ON}")
    return read_dataset(folder, split)


def require_whole(folders: Sequence[Path]) -> None:
    """Raises BadFile for an incomplete data set: no training learns from one."""
    for folder in folders:
        if lacks := _lacks(folder):
            raise BadFile(folder, lacks, f"{GO_ON}; without its {INDEX} it is taken as it is")


def _lacks(folder: Path) -> str:
    """What an incomplete data set lacks; empty for a complete one. Raises BadFile for a folder with
    data sets in it."""
    if inner := sorted(path.parent for path in folder.rglob(INDEX) if path.parent != folder):
        names = " ".join(map(str, inner))
        raise BadFile(folder, f"holds {len(inner)} data sets", f"name them: {names}")
    try:
        wanted = msgspec.json.decode((folder / INDEX).read_bytes(), type=_Index).recordings
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ""  # `grasp dataset build` refuses a damaged one
    there = sum(1 for _ in folder.rglob(RECORDINGS))
    return f"{there} of {wanted} recordings are there" if there < wanted else ""


def read_labelled(path: Path) -> list[Recording]:
    """Recordings of a file of labelled samples, or of the folder of an acquisition. Raises BadFile,
    and UsageError for recordings without labels."""
    if not path.is_dir():
        require_labelled(path)
        return [read(path)]
    if found := sorted(path.glob(SAMPLES)):
        return [read(file) for file in found]
    raise UsageError(
        f"{path} has no labelled samples",
        "give a folder of `grasp run acquire`, or a file; a folder of recordings with --data",
    )


def require_labelled(path: Path) -> None:
    """Raises UsageError for the recording of a run, which has no labels."""
    if path.suffix == ".mcap":
        raise UsageError(
            f"{path} is the recording of a run, which has no labels",
            f"labelled are those of `grasp run acquire`, {SAMPLES} beside its recording",
        )
