"""Reading of data sets for commands, with checks for completeness.

`grasp dataset build` writes the number of recordings into ``dataset.json``. Folders without that
file, such as those of `grasp dataset collect`, count as complete.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from detector.recordings import INDEX, RECORDINGS, Recording, Split, read_dataset
from drivers.errors import BadFile
from scenarios.acquire.datasets.build import divided

CONTINUE = "`grasp dataset build` continues it"
Report = Callable[[str], None]


class _Index(msgspec.Struct, frozen=True):
    recordings: int


def read_set(
    folder: Path, split: Split | None = None, report: Report = lambda line: None
) -> list[Recording]:
    """Recordings of one data set, or of a folder of imports that ``divided`` divides; ``report``
    gets a line for that, and if the set is incomplete.

    Raises BadFile as ``read_dataset``, and for a folder of several sets."""
    if problem := _incomplete(folder):
        report(f"{folder}: {problem}: {CONTINUE}")
    own = divided(folder, report) if split in ("train", "validation") else None
    return own[split] if own and split else read_dataset(folder, split)


def require_whole(folders: Sequence[Path]) -> None:
    """Raise BadFile for an incomplete data set, because training needs complete ones."""
    for folder in folders:
        if problem := _incomplete(folder):
            remedy = f"{CONTINUE}; without its {INDEX} the folder counts as complete"
            raise BadFile(folder, problem, remedy)


def _incomplete(folder: Path) -> str:
    """Number of recordings of an incomplete data set, as a text; empty for a complete one. Raises
    BadFile for a folder that contains data sets."""
    if inner := sorted(path.parent for path in folder.rglob(INDEX) if path.parent != folder):
        names = " ".join(map(str, inner))
        raise BadFile(folder, f"holds {len(inner)} data sets", f"name them: {names}")
    try:
        planned = msgspec.json.decode((folder / INDEX).read_bytes(), type=_Index).recordings
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ""  # `grasp dataset build` refuses a damaged one
    present = sum(1 for _ in folder.rglob(RECORDINGS))
    return f"{present} of {planned} recordings exist" if present < planned else ""
