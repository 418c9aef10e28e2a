"""Tactile recordings with labels: the one owner of their file format.

A recording is one ``.npz`` file: the arrays of ``_ARRAYS`` and ``header``, a JSON text. Plain CSV
of one fingertip is read too: ``t_s,p0,...,p5,slip`` and optionally ``slip_true``. Described in
docs/data-formats.md.
"""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import BadFile
from drivers.interfaces import CODE_MAX, KIT_TAXELS, PERIOD_S

GAP_PERIODS = 1.5  # samples further apart than this have lost one between them
MAX_MISSED = 5  # in a row; beyond that the sensor counts as stale and detectors are reset
COUNTS_LIMIT = CODE_MAX  # difference of two codes
SUFFIX = ".npz"
LABEL = "slip"
OPTIONAL = "slip_true"
MOST_OFF = 1.2  # a period of a CSV against the detectors', either way
RATE_SAMPLES = 20  # from which a rate can be judged
MOVED_M = 0.001  # further than this has moved

LabelName = Literal["slip", "slip_true", "moved"]
Split = Literal["train", "validation", "test"]


class Act(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Something done to a held object, and what came of it."""

    t_s: float
    kind: str
    direction: str
    impulse_n_s: float = 0.0  # of an impact, shove or touch
    furthest_m: float = 0.0  # from where it was before, while it lasted
    moved_m: float = 0.0  # for good


class Metadata(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What was done, and all that is needed to do it again."""

    set: Literal["slide", "disturbances"]
    split: Split
    surface: str
    motion: Literal["primary", "oblique", "rotation", "none"]
    speed_mps: float  # commanded; 0 for a rotation
    spin_radps: float  # commanded; 0 for a translation
    direction: str  # degrees in the fingertip's plane, "0" to "315", or "cw", "ccw"; empty: none
    seed: int
    cause: str = ""  # of a `disturbances`: what shook the signal
    layout: str = ""  # of the taxels, by its name or path; empty: the kit's
    files: dict[str, str] = {}  # of one's own that it was made with, and a fingerprint of each
    part: str = ""  # of a data set that draws from several sets of ranges
    parameters: dict[str, float] = {}  # physical ones drawn for it, units in the names
    object: dict[str, float | str | bool | list[int]] = {}  # what the hand holds
    acts: tuple[Act, ...] = ()  # in the order of time
    commit: str = ""


class Recording(msgspec.Struct, frozen=True, eq=False):
    """Labelled frames at the times at which they came; nothing is resampled, arrays are read-only.

    ``slip`` is what the labelling rule says (in the paper: the fingertip faster than 3 mm/s or
    0.2 rad/s); ``slip_true`` says that the contact itself slides; ``moved_m`` is how far what is
    touched lies from where it last rested against the fingertips (docs/detectors.md). What nobody
    knows or measured is None.
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

    def label(self, name: LabelName) -> NDArray[np.bool_]:
        """(n,) by that name; ``moved``: further than MOVED_M. Raises BadFile for a lacking one."""
        moved = None if self.moved_m is None else self.moved_m > MOVED_M
        found = {"slip": self.slip, "slip_true": self.slip_true, "moved": moved}[name]
        if found is None:
            raise BadFile(self.source, f"has no {name}", "judge it by another label")
        return found

    @property
    def fingers(self) -> int:
        return int(self.counts.shape[1])

    @property
    def taxels(self) -> int:
        """Of a finger."""
        return int(self.counts.shape[2])


def missed_samples(t_s: NDArray[np.float64]) -> NDArray[np.intp]:
    """Samples lost between each two neighbours: (n,) times in seconds to (n - 1,)."""
    periods = np.diff(t_s) / PERIOD_S
    lost = np.maximum(np.rint(periods).astype(np.intp) - 1, 1)
    return np.where(periods > GAP_PERIODS, lost, 0)


def read(path: Path | str, labelled: bool = True) -> Recording:
    """Read a recording, ``.npz`` or CSV by its suffix; raises BadFile. Where no label is asked for,
    a CSV without one is read as if nothing slipped."""
    path = Path(path)
    if path.is_char_device():  # which may never end
        raise BadFile(path, "is no file", "give the path of a recording")
    return _read_npz(path) if path.suffix == SUFFIX else read_csv(path, labelled)


def write(path: Path | str, recording: Recording) -> None:
    """Write ``.npz``, all of it or nothing; equal recordings give equal files.

    Raises BadFile for one that could not be read back, OSError for what the disk refuses.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise BadFile(path, "wrong suffix", f"name the file *{SUFFIX}")
    arrays = {name: getattr(recording, name) for name in _ARRAYS}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    _check_arrays(arrays, str(path))
    header = msgspec.json.encode(_Header("grasp-recording", 2, recording.metadata)).decode()
    written = BytesIO()
    np.savez_compressed(written, header=np.array(header), **arrays)
    write_whole(path, written.getvalue(), mode=0o600)


def write_whole(path: Path, content: bytes, mode: int = 0o666) -> None:
    """All of it or nothing. Raises OSError with the file's name, which a full disk does not say."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "wb") as file:
            file.write(content)
        partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        partial.unlink(missing_ok=True)


def read_dataset(folder: Path | str, split: Split | None = None) -> list[Recording]:
    """All ``.npz`` recordings under a folder, sorted by path; with ``split`` those of it alone.

    Raises BadFile for the first file that is none, and when there is nothing to read.
    """
    folder = Path(folder)
    found = []
    for path in sorted(folder.rglob(f"[!.]*{SUFFIX}")):
        recording = read(path)
        if split is not None and recording.metadata is None:
            raise BadFile(path, "belongs to no split", "write it with metadata")
        if split is None or (recording.metadata and recording.metadata.split == split):
            found.append(recording)
    if not found:
        what = f"no {split} recordings" if split else "no recordings"
        what = what if folder.is_dir() else "no such folder"
        raise BadFile(folder, what, "name a folder of `grasp dataset build`, or `collect`")
    return found


class _Header(msgspec.Struct, frozen=True):
    format: Literal["grasp-recording"]
    version: Literal[2]
    metadata: Metadata | None


# dtype, shape after the samples (None: any number of fingers, of taxels), needed
_ARRAYS: dict[str, tuple[type[np.generic], tuple[int | None, ...], bool]] = {
    "t_s": (np.float64, (), True),
    "counts": (np.int16, (None, None), True),
    "slip": (np.bool_, (), True),
    "slip_true": (np.bool_, (), False),
    "contact_speed_mps": (np.float32, (), False),
    "contact_turn_radps": (np.float32, (), False),
    "velocity_mps": (np.float32, (2,), False),
    "spin_radps": (np.float32, (), False),
    "moved_m": (np.float32, (), False),
}


def _read_npz(path: Path) -> Recording:
    source = str(path)
    again = "copy or build the file again"
    with _readable(path, again), np.load(BytesIO(path.read_bytes()), allow_pickle=False) as file:
        stored = {name: file[name] for name in file.files}
    header = _header(stored.pop("header", None), source)
    unknown = sorted(stored.keys() - _ARRAYS.keys())
    if unknown:
        raise BadFile(source, f"unknown arrays {', '.join(unknown)}", "see docs/data-formats.md")
    _check_arrays(stored, source)
    return _read_only(stored, source, header.metadata)


@contextmanager
def _readable(path: Path, remedy: str) -> Iterator[None]:
    """What goes wrong in reading the file becomes a BadFile."""
    try:
        yield
    except FileNotFoundError:
        raise BadFile(path, "no such file", "check the path") from None
    except Exception as error:  # numpy and zipfile raise many kinds for damage
        problem = f"cannot be read: {str(error) or type(error).__name__}"
        raise BadFile(path, problem, remedy) from None


def _read_only(
    arrays: dict[str, NDArray[Any]], source: str, metadata: Metadata | None = None
) -> Recording:
    for array in arrays.values():
        array.flags.writeable = False
    known: dict[str, Any] = {"slip_true": None, **arrays}
    return Recording(**known, source=source, metadata=metadata)


def _header(stored: NDArray[Any] | None, source: str) -> _Header:
    again = "make it again with this version: `grasp dataset build` or `grasp run acquire`"
    if stored is None or stored.shape != () or stored.dtype.kind != "U":
        raise BadFile(source, "has no header: not a recording", again)
    try:
        return msgspec.json.decode(str(stored), type=_Header)
    except msgspec.DecodeError as error:
        raise BadFile(source, f"bad header: {error}", again) from None


def _check_arrays(arrays: dict[str, Any], source: str) -> None:
    """Raises BadFile unless these are the arrays of a recording."""

    def refuse(problem: str, remedy: str = "see docs/data-formats.md") -> None:
        raise BadFile(source, problem, remedy)

    missing = [name for name, (_, _, needed) in _ARRAYS.items() if needed and name not in arrays]
    if missing:
        refuse(f"{', '.join(missing)} missing")
    samples = arrays["t_s"].shape[0] if arrays["t_s"].ndim else 0
    if samples < 2:
        refuse(f"{samples} samples", "at least 2 are needed")
    for name, array in arrays.items():
        dtype, shape, _ = _ARRAYS[name]
        wanted = (samples, *shape)
        fits = array.ndim == len(wanted) and all(
            n == m if m is not None else n > 0 for n, m in zip(array.shape, wanted, strict=True)
        )
        if array.dtype != dtype or not fits:
            refuse(f"{name} is {array.dtype} {array.shape}, not {np.dtype(dtype)} {wanted}")
        if not np.isfinite(array).all():
            refuse(f"{name} holds values that are no finite numbers")
    if abs(arrays["counts"].astype(np.int32)).max() > COUNTS_LIMIT:
        refuse(f"counts beyond +-{COUNTS_LIMIT}", "write raw minus rest, unscaled")
    _check_times(arrays["t_s"], None, source)


def read_csv(path: Path | str, labelled: bool = True) -> Recording:
    """Read a recording of one fingertip; raises BadFile at the first thing that is wrong. One that
    is not ``labelled`` may lack the label, and then holds no slip."""
    source = str(path)
    with _readable(Path(path), "give a CSV file in UTF-8"):
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    columns = _columns(lines, source, labelled)
    rows = {i: line.split(",") for i, line in enumerate(lines[1:], start=2) if line.strip()}
    if len(rows) < 2:
        raise BadFile(source, f"{len(rows)} samples", "at least 2 are needed")
    for line, words in rows.items():
        if len(words) != len(columns):
            remedy = f"there must be {len(columns)}"
            raise BadFile(source, f"{len(words)} columns", remedy, line)
    table = {
        name: _column(name, {line: words[i].strip() for line, words in rows.items()}, source)
        for i, name in enumerate(columns)
    }
    t_s = table["t_s"]
    _check_rate(t_s, source)
    _check_times(t_s, list(rows), source)
    counts = np.column_stack([table[name] for name in columns if name.startswith("p")])
    labels = {name: table[name] == 1.0 for name in (LABEL, OPTIONAL) if name in table}
    arrays = {"t_s": t_s, "counts": counts.astype(np.int16)[:, None, :], **labels}
    return _read_only({LABEL: np.zeros(len(t_s), np.bool_), **arrays}, source)


def _columns(lines: list[str], source: str, labelled: bool) -> tuple[str, ...]:
    def names(taxels: int) -> tuple[str, ...]:
        return ("t_s", *(f"p{i}" for i in range(taxels)), LABEL)

    kit = ",".join(names(KIT_TAXELS))
    wanted = f"the first line must be {kit}, or of other taxels, with or without ,{OPTIONAL}"
    if not lines:
        raise BadFile(source, "empty", wanted)
    columns = tuple(word.strip() for word in lines[0].split(","))
    taxels = sum(name.startswith("p") for name in columns)
    known = [names(taxels), (*names(taxels), OPTIONAL)] + [names(taxels)[:-1]] * (not labelled)
    if taxels == 0 or columns not in known:
        raise BadFile(source, f"columns are {','.join(columns)}", wanted, 1)
    return columns


def _column(name: str, words: dict[int, str], source: str) -> NDArray[np.float64]:
    """Values (n,) of words by line; raises BadFile for the first that it may not have."""
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
            remedy = f"counts are raw minus rest, unscaled: whole, within +-{COUNTS_LIMIT}"
        if not good:
            raise BadFile(source, f"{name} is {word!r}", remedy, line)
    return np.array([float(word) for word in words.values()])


def _check_rate(t_s: NDArray[np.float64], source: str) -> None:
    """Raises BadFile for a recording at another rate than that for which detectors are made; a few
    lost or uneven samples are no other rate."""
    period_s = float(np.median(np.diff(t_s)))
    judged = len(t_s) >= RATE_SAMPLES and period_s > 0.0
    if judged and not 1.0 / MOST_OFF < period_s / PERIOD_S < MOST_OFF:
        raise BadFile(
            source, f"its samples are {period_s * 1e3:.3g} ms apart, {1.0 / period_s:.4g} Hz",
            f"record at {1.0 / PERIOD_S:.0f} Hz, or resample it (with a filter): detectors, rules "
            "and delays count samples of 10 ms",
        )  # fmt: skip


def _check_times(t_s: NDArray[np.float64], lines: list[int] | None, source: str) -> None:
    """``lines``: where each sample is in the file, if it has lines."""
    missed = missed_samples(t_s)
    for wrong, problem, remedy in (
        (np.diff(t_s) <= 0.0, "time does not increase",
         "write samples in the order in which they came, each once"),
        (missed > MAX_MISSED, f"{missed.max()} samples are missing before this",
         f"at most {MAX_MISSED} in a row may be: cut the recording in two here"),
    ):  # fmt: skip
        if wrong.any():
            sample = int(wrong.argmax()) + 1
            raise BadFile(source, problem, remedy, None if lines is None else lines[sample])
