"""A data set of a lab's own recordings: acquisitions and files of counts, each given to a split."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from detector.recordings import SUFFIX, Metadata, Recording, Split, read, write
from drivers.errors import UsageError
from grasp.files import make_private_folder

SHARED_OUT: tuple[Split, ...] = ("train", "validation", "test", "train", "train")
SAMPLES = f"samples*{SUFFIX}"  # of an acquisition's folder


def collect(sources: Sequence[Path], out: Path) -> dict[Split, int]:
    """Copy the recordings of acquisitions' folders, and files, into a new folder; of each five,
    three are for training. Gives how many of each split.

    Raises BadFile for what is no recording, UsageError for fewer than three, for several layouts of
    taxels and for a folder that is not empty, OSError where nothing can be written.
    """
    paths = [path for source in sources for path in _files(source)]
    if len(paths) < len(set(SHARED_OUT)):
        raise UsageError(f"{len(paths)} recordings make no data set", "give three at least")
    if out.exists() and any(out.iterdir()):
        raise UsageError(f"{out} is not empty", "give a new folder with --out")
    found = [read(path) for path in paths]
    layouts = sorted({recording.taxels for recording in found})
    if len(layouts) > 1:
        mixed = " and ".join(str(taxels) for taxels in layouts)
        raise UsageError(
            f"fingertips of {mixed} taxels make no data set", "collect those of one layout"
        )
    make_private_folder(out)
    counts: dict[Split, int] = dict.fromkeys(SHARED_OUT, 0)
    for number, recording in enumerate(found):
        split = SHARED_OUT[number % len(SHARED_OUT)]
        write(out / f"{number:03d}{SUFFIX}", _of_split(recording, split))
        counts[split] += 1
    return counts


def _files(source: Path) -> list[Path]:
    if not source.is_dir():
        return [source]
    found = sorted(source.glob(SAMPLES))
    if not found:
        raise UsageError(f"{source} has no labelled samples", "give folders of `grasp run acquire`")
    return found


def _of_split(recording: Recording, split: Split) -> Recording:
    known = recording.metadata or Metadata(
        set="slide", split=split, surface="own", motion="none", speed_mps=0.0, spin_radps=0.0,
        direction="", seed=0,
    )  # fmt: skip
    return msgspec.structs.replace(recording, metadata=msgspec.structs.replace(known, split=split))
