"""Labelled tactile recordings, and their file format (docs/data-formats.md).

A recording is one ``.npz`` file: the arrays of ``_ARRAYS`` and ``header``, a JSON text. Plain CSV
of one fingertip can be read too: ``t_s,p0,...,p5,slip`` and optionally ``slip_true``.
"""

import math
import os
from collections.abc import Iterable, Iterator
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, Literal
from zipfile import ZipFile

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.text_table import MOST_BYTES, TextTable, as_bad_file, read_table, require_file
from drivers.errors import BadFile, UsageError
from drivers.interfaces import CODE_MAX, KIT_TAXELS, PERIOD_S

GAP_PERIODS = 1.5  # a longer time between two samples means that samples were missed
MAX_MISSED = 5  # in a row; beyond that the sensor counts as stale and detectors are reset
COUNTS_LIMIT = CODE_MAX  # difference of two codes
SUFFIX = ".npz"
INDEX = "dataset.json"  # of a data set
SAMPLES = f"samples*{SUFFIX}"  # files in the folder of an acquisition
RECORDINGS = f"[!.]*{SUFFIX}"  # a name with a leading dot is still being written
LABEL = "slip"
OPTIONAL = "slip_true"
MAX_RATE_FACTOR = 1.2  # period of a CSV over the period of 10 ms, or its inverse
RATE_SAMPLES = 20  # fewer do not determine a rate
MIN_PERIOD_S = 1e-4  # no fingertip is sampled faster
UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9}  # of times, per second
UNIT_NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
IMPORT = "`grasp dataset import`"
UNLABELLED = (
    "move or leave out what has none, which only `grasp replay --tactile` and `grasp detector tune "
    f"--unlabelled` take; {IMPORT} --labels takes labels from a second file"
)
MOVED_M = 0.001  # a larger displacement has the label `moved`

LabelName = Literal["slip", "slip_true", "moved"]
Split = Literal["train", "validation", "test"]


class AppliedDisturbance(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A disturbance of a held object, and the displacement that it caused."""

    t_s: float
    kind: str
    direction: str
    impulse_n_s: float = 0.0  # of an impact, shove or touch
    furthest_m: float = 0.0  # largest displacement
    moved_m: float = 0.0  # lasting displacement


class Metadata(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Conditions of a recording, sufficient to reproduce it."""

    set: Literal["slide", "disturbances"]
    split: Split
    surface: str
    motion: Literal["primary", "oblique", "rotation", "none"]
    speed_mps: float  # commanded; 0 for a rotation
    spin_radps: float  # commanded; 0 for a translation
    direction: str  # degrees in the fingertip's plane, "0" to "315", or "cw", "ccw"; empty: none
    seed: int
    cause: str = ""  # of the set `disturbances`: what changes the signal; or `imported`
    layout: str = ""  # of the taxels, by its name or path; empty: the kit's
    files: dict[str, str] = {}  # the user's files that it was made with, with their digests
    part: str = ""  # of a data set with several parts
    changes: tuple[str, ...] = ()  # of an imported recording: what the import changed
    parameters: dict[str, float] = {}  # random settings of this recording, units in the names
    object: dict[str, float | str | bool | list[int]] = {}  # held object
    disturbances: tuple[AppliedDisturbance, ...] = msgspec.field(default=(), name="acts")  # by time
    commit: str = ""


class Recording(msgspec.Struct, frozen=True, eq=False):
    """Labelled frames at their measured times, not resampled; arrays are read-only.

    ``slip`` is the label of the labelling rule (in the paper: the fingertip moves faster than
    3 mm/s or 0.2 rad/s). ``slip_true`` is True while the contact itself slides. ``moved_m`` is the
    distance of the touched object from its last position at rest against the fingertips
    (docs/detectors.md). Unknown quantities are None.
    """

    t_s: NDArray[np.float64]  # (n,)
    counts: NDArray[np.int16]  # (n, fingers, taxels)
    slip: NDArray[np.bool_]  # (n,)
    slip_true: NDArray[np.bool_] | None  # (n,)
    source: str
    metadata: Metadata | None = None
    contact_speed_mps: NDArray[np.float32] | None = None  # (n,) surface against pad, fastest finger
    contact_turn_radps: NDArray[np.float32] | None = None  # (n,) likewise, about the normal
    velocity_mps: NDArray[np.float32] | None = None  # (n, 2) fingertip, along its x and y
    spin_radps: NDArray[np.float32] | None = None  # (n,) fingertip, about its normal
    moved_m: NDArray[np.float32] | None = None  # (n,)
    labelled: bool = True  # False: `slip` is unknown, and False throughout

    def label(self, name: LabelName) -> NDArray[np.bool_]:
        """Label (n,); ``moved``: ``moved_m`` above MOVED_M. Raises BadFile for a missing one."""
        moved = None if self.moved_m is None else self.moved_m > MOVED_M
        label = {"slip": self.slip, "slip_true": self.slip_true, "moved": moved}[name]
        if label is None:
            raise BadFile(self.source, f"has no {name}", "use another label")
        return label

    @property
    def fingers(self) -> int:
        return int(self.counts.shape[1])

    @property
    def taxels(self) -> int:
        """Taxels per finger."""
        return int(self.counts.shape[2])


def missed_samples(t_s: NDArray[np.float64], period_s: float = PERIOD_S) -> NDArray[np.intp]:
    """Missed samples between neighbours (n - 1,), from times (n,) in seconds."""
    periods = np.diff(t_s) / period_s
    lost = np.maximum(np.rint(periods).astype(np.intp) - 1, 1)
    return np.where(periods > GAP_PERIODS, lost, 0)


def read(path: Path | str) -> Recording:
    """Read a recording, ``.npz`` or CSV by its suffix, labelled or not. Raises BadFile."""
    path = Path(path)
    require_file(path)
    return _read_npz(path) if path.suffix == SUFFIX else read_csv(path)


def write(path: Path | str, recording: Recording) -> None:
    """Write ``.npz`` atomically; equal recordings give equal files. Raises BadFile for a recording
    that could not be read back, OSError of the file system."""
    path = Path(path)
    if path.suffix != SUFFIX:
        raise BadFile(path, "wrong suffix", f"name the file *{SUFFIX}")
    arrays = {name: getattr(recording, name) for name in _ARRAYS}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    if not recording.labelled:
        del arrays[LABEL]
    _check_arrays(arrays, str(path))
    header = msgspec.json.encode(_Header("grasp-recording", 2, recording.metadata)).decode()
    written = BytesIO()
    np.savez_compressed(written, header=np.array(header), **arrays)
    write_whole(path, written.getvalue(), mode=0o600)


def write_whole(path: Path, content: bytes, mode: int = 0o666) -> None:
    """Write a file atomically. Raises OSError with the file's name, also for a full disk."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "wb") as file:
            file.write(content)
        partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        partial.unlink(missing_ok=True)


def files_in(folder: Path) -> list[Path]:
    """Files of labelled samples in the folder of an acquisition, else of all recordings in it."""
    return sorted(folder.glob(SAMPLES)) or sorted(folder.glob(RECORDINGS))


def files_of(source: Path) -> list[Path]:
    """The file itself, or the files of ``files_in``. Raises BadFile, and UsageError for the
    recording of a run and a folder without files."""
    if not source.exists():
        raise BadFile(source, "no such file or folder", "check the path")
    if source.suffix == ".mcap":
        raise UsageError(f"{source} is the recording of a run, not of a fingertip",
                         "`grasp run acquire` writes labelled samples beside it")  # fmt: skip
    if not (found := files_in(source) if source.is_dir() else [source]):
        raise UsageError(f"{source} has no recordings of a fingertip", "give a file, or a folder "
                         f"of `grasp run acquire` or {IMPORT}")  # fmt: skip
    return found


def read_all(sources: Iterable[Path]) -> Iterator[Recording]:
    """Read all labelled recordings of ``files_of`` these sources. Raises BadFile, after the last
    one with the names of all that have no label."""
    lacking = []
    for path in chain.from_iterable(map(files_of, sources)):
        recording = read(path)
        if recording.labelled:
            yield recording
        else:
            lacking.append(path)
    if lacking:
        more = f", nor {', '.join(path.name for path in lacking[1:])}" * (len(lacking) > 1)
        raise BadFile(lacking[0], f"has no label `{LABEL}`{more}", UNLABELLED)


def read_dataset(folder: Path | str, split: Split | None = None) -> list[Recording]:
    """All ``.npz`` recordings under a folder, sorted by path; with ``split`` only those of it.
    Raises BadFile for the first damaged file, and for a folder without recordings."""
    folder = Path(folder)
    recordings = []
    for recording in read_all(sorted(folder.rglob(RECORDINGS))):
        if split is not None and recording.metadata is None:
            raise BadFile(
                recording.source, "belongs to no split", "`grasp dataset collect` gives it one"
            )
        if split is None or (recording.metadata and recording.metadata.split == split):
            recordings.append(recording)
    if not recordings:
        problem = f"no {split} recordings" if split else "no recordings"
        problem = problem if folder.is_dir() else "no such folder"
        raise BadFile(folder, problem, "name one of `grasp dataset build`, `collect` or `import`")
    return recordings


class _Header(msgspec.Struct, frozen=True):
    format: Literal["grasp-recording"]
    version: Literal[2]
    metadata: Metadata | None


# dtype, shape after the samples (None: any number of fingers or taxels), required
_ARRAYS: dict[str, tuple[type[np.generic], tuple[int | None, ...], bool]] = {
    "t_s": (np.float64, (), True),
    "counts": (np.int16, (None, None), True),
    "slip": (np.bool_, (), False),  # only a recording that is not labelled lacks it
    "slip_true": (np.bool_, (), False),
    "contact_speed_mps": (np.float32, (), False),
    "contact_turn_radps": (np.float32, (), False),
    "velocity_mps": (np.float32, (2,), False),
    "spin_radps": (np.float32, (), False),
    "moved_m": (np.float32, (), False),
}


def _read_npz(path: Path) -> Recording:
    source = str(path)
    remedy = "copy or build the file again"
    with as_bad_file(path, remedy):
        with ZipFile(path) as archive:  # which reads no more than the sizes that it states
            size = sum(member.file_size for member in archive.infolist())
        if size > MOST_BYTES:
            raise ValueError(f"its arrays have {size} bytes, more than {MOST_BYTES}")
        file = np.load(BytesIO(path.read_bytes()), allow_pickle=False)
        stored = {name: file[name] for name in file.files}
    header = _header(stored.pop("header", None), source)
    unknown = sorted(stored.keys() - _ARRAYS.keys())
    if unknown:
        raise BadFile(source, f"unknown arrays {', '.join(unknown)}", "see docs/data-formats.md")
    _check_arrays(stored, source)
    return _read_only(stored, source, header.metadata)


def _read_only(
    arrays: dict[str, NDArray[Any]], source: str, metadata: Metadata | None = None
) -> Recording:
    for array in arrays.values():
        array.flags.writeable = False
    known: dict[str, Any] = {"slip_true": None, "labelled": LABEL in arrays, **arrays}
    known.setdefault(LABEL, np.zeros(len(arrays["t_s"]), np.bool_)).flags.writeable = False
    return Recording(**known, source=source, metadata=metadata)


def _header(stored: NDArray[Any] | None, source: str) -> _Header:
    remedy = "make it again with this version: `grasp dataset build` or `grasp run acquire`"
    if stored is None or stored.shape != () or stored.dtype.kind != "U":
        raise BadFile(source, "has no header: not a recording", remedy)
    try:
        return msgspec.json.decode(str(stored), type=_Header)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise BadFile(source, f"bad header: {error}", remedy) from None


def _check_arrays(arrays: dict[str, Any], source: str) -> None:
    """Raise BadFile unless these are the arrays of a recording."""

    def refuse(problem: str, remedy: str = "see docs/data-formats.md") -> None:
        raise BadFile(source, problem, remedy)

    missing = [name for name, (*_, required) in _ARRAYS.items() if required and name not in arrays]
    if missing:
        refuse(f"{', '.join(missing)} missing")
    samples = arrays["t_s"].shape[0] if arrays["t_s"].ndim else 0
    if samples < 2:
        refuse(f"{samples} samples", "at least 2 are needed")
    for name, array in arrays.items():
        dtype, shape, _ = _ARRAYS[name]
        expected = (samples, *shape)
        fits = array.ndim == len(expected) and all(
            n == m if m is not None else n > 0 for n, m in zip(array.shape, expected, strict=True)
        )
        if array.dtype != dtype or not fits:
            refuse(f"{name} is {array.dtype} {array.shape}, not {np.dtype(dtype)} {expected}")
        if not np.isfinite(array).all():
            refuse(f"{name} holds values that are not finite")
    if abs(arrays["counts"].astype(np.int32)).max() > COUNTS_LIMIT:
        refuse(f"counts beyond +-{COUNTS_LIMIT}", "write raw minus rest, unscaled")
    check_times(arrays["t_s"], None, source)


def read_csv(path: Path | str) -> Recording:
    """Read a recording of one fingertip. Raises BadFile for the first error."""
    text = read_table(Path(path))
    source, lines = text.source, text.lines[1:]
    if comma := text.decimal_comma():
        problem = f"{comma[0]!r} has a comma as the decimal sign"
        remedy = f"write numbers with a decimal point, or {IMPORT} reads them"
        raise BadFile(source, problem, remedy, comma[1])
    columns = _columns(text)
    if len(lines) < 2:
        raise BadFile(source, f"{len(lines)} samples", "at least 2 are needed")
    table = {
        name: _column(name, dict(zip(lines, words, strict=True)), source)
        for name, words in zip(columns, text.columns(1), strict=True)
    }
    t_s = table["t_s"]
    check_rate(t_s, source)
    check_times(t_s, lines, source)
    counts = np.column_stack([table[name] for name in columns if name.startswith("p")])
    labels = {name: table[name] == 1.0 for name in (LABEL, OPTIONAL) if name in table}
    arrays = {"t_s": t_s, "counts": counts.astype(np.int16)[:, None, :], **labels}
    return _read_only(arrays, source)


def _columns(text: TextTable) -> tuple[str, ...]:
    def names(taxels: int) -> tuple[str, ...]:
        return ("t_s", *(f"p{i}" for i in range(taxels)), LABEL)

    kit = ",".join(names(KIT_TAXELS))
    remedy = f"the first line must be {kit} (or more or fewer taxels), with or without ,{OPTIONAL}"
    if not text.rows:
        raise BadFile(text.source, "empty", remedy)
    columns = tuple(text.rows[0])
    taxels = sum(name.startswith("p") for name in columns)
    known = [names(taxels), (*names(taxels), OPTIONAL), names(taxels)[:-1]]
    if taxels == 0 or columns not in known:
        remedy = f"{remedy}, or {IMPORT} brings other layouts into this format"
        raise BadFile(text.source, f"columns are {','.join(columns)}", remedy, text.lines[0])
    return columns


def _column(name: str, words: dict[int, str], source: str) -> NDArray[np.float64]:
    """Values (n,) of words by line. Raises BadFile for the first that is not allowed."""
    for line, word in words.items():
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if name.startswith("slip"):
            good, remedy = value in (0.0, 1.0), "a label must be 0 or 1"
        elif name == "t_s":
            good, remedy = math.isfinite(value), "it must be a finite number"
        else:
            good = value.is_integer() and abs(value) <= COUNTS_LIMIT
            remedy = f"counts are raw minus rest: whole numbers within +-{COUNTS_LIMIT}"
        if not good:
            raise BadFile(source, f"{name} is {word!r}", remedy, line)
    return np.array([float(word) for word in words.values()])


def check_unit(
    t_s: NDArray[np.float64], source: str, how: str = f"convert them to seconds, or {IMPORT}"
) -> None:
    """Raise BadFile if the median interval shows that times (n,) are not in seconds; ``how``: the
    remedy before the option --unit."""
    period = float(np.median(np.diff(t_s)))
    if 0.0 < period < MIN_PERIOD_S:
        problem = f"its samples are {period:g} s apart"
        raise BadFile(source, problem, f"{how} --unit s, ms, us or ns, whichever they are in")
    if period >= 1.0:  # of a rate of 2 to 1000 Hz
        unit = "ms" if period < 500.0 else "us" if period < 500e3 else "ns"
        problem = f"timestamps look like {UNIT_NAMES[unit]}: the median interval is {period:g}"
        raise BadFile(source, problem, f"{how} --unit {unit}")


def check_rate(t_s: NDArray[np.float64], source: str) -> None:
    """Raise BadFile if the median rate is not near 100 Hz; missed samples are allowed."""
    check_unit(t_s, source)
    period_s = float(np.median(np.diff(t_s)))
    measurable = len(t_s) >= RATE_SAMPLES and period_s > 0.0
    if measurable and not 1.0 / MAX_RATE_FACTOR < period_s / PERIOD_S < MAX_RATE_FACTOR:
        problem = f"its samples are {period_s * 1e3:.3g} ms apart, {1.0 / period_s:.4g} Hz"
        remedy = f"record at {1.0 / PERIOD_S:.0f} Hz, or resample it ({IMPORT} --resample): "
        remedy += "detectors, rules and delays count samples of 10 ms"
        raise BadFile(source, problem, remedy)


def check_times(t_s: NDArray[np.float64], lines: list[int] | None, source: str) -> None:
    """Raise BadFile for bad times. ``lines``: line of each sample in a text file."""
    missed = missed_samples(t_s)
    for wrong, problem, remedy in (
        (np.diff(t_s) <= 0.0, "time does not increase",
         "write each sample once, in the order of time"),
        (missed > MAX_MISSED, f"{missed.max()} samples are missing before this",
         f"at most {MAX_MISSED} in a row may be missing: cut the recording in two here"),
    ):  # fmt: skip
        if wrong.any():
            sample = int(wrong.argmax()) + 1
            raise BadFile(source, problem, remedy, None if lines is None else lines[sample])
